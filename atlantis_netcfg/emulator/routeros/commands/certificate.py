"""`/certificate`: sign a template, import a file (Manual, Certificates). Keys stay with their row.

No public source has the words of the refusals. A certificate that is there already is not taken a second time, and a
key without its certificate is not taken at all.

Assumption: refusal-words
Assumption: certificate-import
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros import certificates
from atlantis_netcfg.emulator.routeros.answers import Category, Trap
from atlantis_netcfg.emulator.routeros.commands._call import MissingArgument, Result, no_such_item, unknown
from atlantis_netcfg.emulator.routeros.commands.write import located

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.emulator.routeros.commands._call import Call
    from atlantis_netcfg.emulator.routeros.core import Core
    from atlantis_netcfg.emulator.routeros.store import Item

_MENU = "/certificate"
_SELECTORS = ("numbers", "number", ".id")


def sign(core: Core, call: Call) -> Result:
    """Make the key of a template and sign it, by itself or by `ca=`."""
    _known(core, call)
    named = next((call.arguments[name] for name in _SELECTORS if name in call.arguments), None)
    if named is None:
        raise MissingArgument("number")
    item = _row(core, call, named)
    if item.id in core.keys:
        raise Trap("failure: certificate already signed")
    authority = None
    if "ca" in call.arguments:
        authority = core.keys.get(_row(core, call, call.arguments["ca"]).id)
        if authority is None or not certificates.known(authority).authority:
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
    return Result(rows=[{"progress": "done"}], text="  progress: done")


def import_(core: Core, call: Call) -> Result:
    """Take certificates and keys from a PEM file; a key joins the certificate that it belongs to."""
    _known(core, call)
    name = call.arguments.get("file-name")
    if name is None:
        raise MissingArgument("file-name")
    file = core.files.get(name)
    if file is None:
        raise no_such_item()
    stem = call.arguments.get("name", name)
    trusted = call.arguments.get("trusted", "yes")
    try:
        made, keys = take(core, str(file.contents), lambda _authority, number: f"{stem}_{number}", trusted)
    except ValueError as error:
        raise Trap("failure: unable to decode file") from error
    counts = {"certificates-imported": len(made), "private-keys-imported": keys}
    row = {word: str(count) for word, count in (counts | {"files-imported": 1, "decryption-failures": 0}).items()}
    return Result(rows=[row], text="\n".join(f"  {word}: {count}" for word, count in row.items()))


def take(core: Core, text: str, name: Callable[[bool, int], str], trusted: str = "yes") -> tuple[list[Item], int]:
    """Make rows of the certificates in a PEM text, and let keys join theirs; rows made, and keys taken.

    `name` is given whether a certificate is an authority's, and its number in the text. Raises ValueError.
    """
    found, keys = certificates.split(text)
    there = {certificates.known(core.keys[number]).fingerprint for number in _signed(core)}
    made = []
    for number, pem in enumerate(found):
        about = certificates.known(pem)
        if about.fingerprint in there:
            continue
        row = {"name": name(about.authority, number), "common-name": about.common_name, "trusted": trusted}
        made.append(core.store.insert(_MENU, row))
        core.keys[made[-1].id] = pem
    core.store.changes.clear()
    return made, sum(_join(core, key) for key in keys)


def _join(core: Core, key: str) -> bool:
    """Put a key to the certificate that it belongs to."""
    for number in _signed(core):
        pem = core.keys[number]
        if "PRIVATE KEY" not in pem and certificates.belongs(key, pem):
            core.keys[number] = key + pem
            return True
    return False


def _signed(core: Core) -> list[int]:
    """The rows that are more than templates; what is kept of removed ones, an undo may need."""
    return [item.id for item in core.store.table(_MENU).items if item.id in core.keys]


def _row(core: Core, call: Call, named: str) -> Item:
    item = located(core, core.store.table(_MENU), named, console=call.console)
    if item is None:
        raise no_such_item()
    return item


def _known(core: Core, call: Call) -> None:
    known = core.schema.arguments(call.menu, call.command) | {*_SELECTORS}
    for name in call.arguments:
        if name not in known:
            raise unknown(name)
