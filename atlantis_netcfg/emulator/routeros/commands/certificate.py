"""`/certificate` and `/interface/ovpn-client`: sign, import a certificate, import a profile (Manual, Certificates).

No public source has the error texts, except for the unsupported option of a profile.

Assumption: refusal-words
Assumption: certificate-import
Assumption: ovpn-import
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros import certificates
from atlantis_netcfg.emulator.routeros.answers import Category, Trap
from atlantis_netcfg.emulator.routeros.commands import _checks
from atlantis_netcfg.emulator.routeros.commands.write import find_item
from atlantis_netcfg.emulator.routeros.core import Call, CallResult, Core
from atlantis_netcfg.emulator.routeros.values import BadValue, reference

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.emulator.routeros.store import StoredItem


_MENU = "/certificate"
_SELECTORS = ("numbers", "number", ".id")


def sign(core: Core, call: Call) -> CallResult:
    """Make the key of a template and sign it, self-signed or by `ca=`.

    Keys are stored with their row.
    """
    _check_arguments(core, call)
    selector = next((call.arguments[name] for name in _SELECTORS if name in call.arguments), None)
    if selector is None:
        raise _checks.MissingArgument("number")
    item = _row(core, call, selector)
    if item.id in core.keys:
        raise Trap("failure: certificate already signed")
    authority = None
    if "ca" in call.arguments:
        authority = core.keys.get(_row(core, call, call.arguments["ca"]).id)
        if authority is None or not certificates.read_certificate(authority).authority:
            raise Trap("failure: invalid CA")
    values = {name: value for name, value in item.values.items() if isinstance(value, str)}
    try:
        core.keys[item.id] = certificates.issue(values, now=core.time(), authority=authority)
    except certificates.BadRequest as bad:
        raise Trap(f"invalid value for argument {bad}", Category.ARGUMENT) from bad
    if "name" in call.arguments:
        core.store.update(_MENU, item, {**item.values, "name": call.arguments["name"]})
        core.store.changes.clear()
    core.store.revision += 1
    return CallResult(rows=[{"progress": "done"}], text="  progress: done")


def import_certificate(core: Core, call: Call) -> CallResult:
    """Import certificates and keys from a PEM file; a key is stored with its certificate.

    An existing certificate is not imported again, and a key without its certificate not at all.
    """
    _check_arguments(core, call)
    name = call.arguments.get("file-name")
    if name is None:
        raise _checks.MissingArgument("file-name")
    file = core.files.get(name)
    if file is None:
        raise _checks.no_such_item()
    stem = call.arguments.get("name", name)
    trust = call.arguments.get("trusted", "yes")
    try:
        items, keys = take(core, str(file.contents), lambda _authority, number: f"{stem}_{number}", trust)
    except ValueError as error:
        raise Trap("failure: unable to decode file") from error
    counts = {"certificates-imported": len(items), "private-keys-imported": keys}
    row = {word: str(count) for word, count in (counts | {"files-imported": 1, "decryption-failures": 0}).items()}
    return CallResult(rows=[row], text="\n".join(f"  {word}: {count}" for word, count in row.items()))


def take(core: Core, text: str, name: Callable[[bool, int], str], trust: str = "yes") -> tuple[list[StoredItem], int]:
    """Add certificates of a PEM text as rows and attach keys; return new rows and the number of keys.

    `name` receives whether a certificate is an authority's, and its number in the text. Raises ValueError.
    """
    pems, keys = certificates.split(text)
    there = {certificates.read_certificate(core.keys[number]).fingerprint for number in _certificate_ids(core)}
    items = []
    for number, pem in enumerate(pems):
        about = certificates.read_certificate(pem)
        if about.fingerprint in there:
            continue
        row = {"name": name(about.authority, number), "common-name": about.common_name, "trusted": trust}
        items.append(core.store.insert(_MENU, row))
        core.keys[items[-1].id] = pem
    core.store.changes.clear()
    return items, sum(_join(core, key) for key in keys)


def _join(core: Core, key: str) -> bool:
    """Attach a key to its certificate."""
    for number in _certificate_ids(core):
        pem = core.keys[number]
        if "PRIVATE KEY" not in pem and certificates.belongs(key, pem):
            core.keys[number] = key + pem
            return True
    return False


def _certificate_ids(core: Core) -> list[int]:
    """Return the ids of issued certificates (no templates); removed ones are kept for undo."""
    return [item.id for item in core.store.table(_MENU).items if item.id in core.keys]


def _row(core: Core, call: Call, selector: str) -> StoredItem:
    item = find_item(core, core.store.table(_MENU), selector, console=call.console)
    if item is None:
        raise _checks.no_such_item()
    return item


def _check_arguments(core: Core, call: Call) -> None:
    allowed_names = core.schema.arguments(call.menu, call.command) | {*_SELECTORS}
    for name in call.arguments:
        if name not in allowed_names:
            raise _checks.unknown(name)


_CLIENTS = "/interface/ovpn-client"
_TRUE = ("", "yes", "true")


def import_profile(core: Core, call: Call) -> CallResult:
    """Import a profile; nothing is created if any part is refused.

    It creates an interface, its certificates and its hidden key; `read_ovpn` defines what the file may contain.
    """
    name = call.arguments.get("file-name")
    if name is None:
        raise _checks.MissingArgument("file-name")
    if name not in core.files:
        raise _checks.no_such_item()
    if not call.arguments.get("ovpn-user"):
        raise _checks.MissingArgument("ovpn-user")
    try:
        read = certificates.read_ovpn(
            core.files[name].contents, wraps=core.schema.at_least(certificates.TLS_CRYPT_SINCE)
        )
    except certificates.OvpnError as refused:
        raise Trap(f"failure: {refused}") from refused
    stem = _stem(core)
    account = {"name": stem, "user": call.arguments["ovpn-user"], "password": call.arguments.get("ovpn-password", "")}
    values = {**_parse_values(core, {**read.values, **account}), "disabled": "yes"}
    _checks.check(core, _CLIENTS, values, None)
    if call.arguments.get("skip-cert-import", "no") not in _TRUE and read.certificates:
        _import_certificates(core, read.certificates, stem, values)
    _checks.complete(core, _CLIENTS, values)
    item = core.store.insert(_CLIENTS, values)
    if read.wrap is not None:
        core.wraps[item.id] = read.wrap
    _checks.record_addition(core, Call(call.caller, _CLIENTS, "add", console=call.console), item)
    return CallResult(rows=[{"progress": "done"}], text="  progress: done")


def _stem(core: Core) -> str:
    """Return `ovpn-import` with the second of the router's clock; the next second if it is taken."""
    second = int(core.time().timestamp())
    while core.store.id_of("interface", f"ovpn-import{second}") is not None:
        second += 1
    return f"ovpn-import{second}"


def _parse_values(core: Core, values: dict[str, str]) -> dict[str, str]:
    args = core.store.table(_CLIENTS).args
    try:
        return {name: args[name].kind.parse(text, core.store) for name, text in values.items()}
    except BadValue as error:
        raise Trap("failure: invalid value in the configuration") from error


def _import_certificates(core: Core, pem: str, stem: str, values: dict[str, str]) -> None:
    try:
        rows, _keys = take(core, pem, lambda authority, _number: f"{'ca' if authority else 'cert'}_{stem}")
    except ValueError as error:
        raise Trap("failure: unable to decode file") from error
    for row in rows:
        if "PRIVATE KEY" in core.keys[row.id]:
            values["certificate"] = reference("certificate", row.id)
