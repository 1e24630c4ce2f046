"""`/interface/ovpn-client/import-ovpn-configuration`: an interface, its certificates and its hidden key out of a file.

What the file may hold stands in `twin.ovpn`. Of the refusals only the unsupported option's words are known.

Assumption: ovpn-import
Assumption: refusal-words
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.answers import Trap
from atlantis_netcfg.emulator.routeros.commands import _checks
from atlantis_netcfg.emulator.routeros.commands._call import Call, MissingArgument, Result, no_such_item
from atlantis_netcfg.emulator.routeros.commands._checks import check
from atlantis_netcfg.emulator.routeros.commands._complete import complete
from atlantis_netcfg.emulator.routeros.commands.certificate import take
from atlantis_netcfg.emulator.routeros.ovpn import TLS_CRYPT_SINCE, OvpnRefused, read_ovpn
from atlantis_netcfg.emulator.routeros.values import BadValue, reference

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.core import Core

_MENU = "/interface/ovpn-client"
_TRUE = ("", "yes", "true")


def import_(core: Core, call: Call) -> Result:
    """Make what the file says; nothing is made where any of it is refused."""
    name = call.arguments.get("file-name")
    if name is None:
        raise MissingArgument("file-name")
    if name not in core.files:
        raise no_such_item()
    if not call.arguments.get("ovpn-user"):
        raise MissingArgument("ovpn-user")
    try:
        read = read_ovpn(core.files[name].contents, wraps=core.schema.at_least(TLS_CRYPT_SINCE))
    except OvpnRefused as refused:
        raise Trap(f"failure: {refused}") from refused
    stem = _stem(core)
    given = {"name": stem, "user": call.arguments["ovpn-user"], "password": call.arguments.get("ovpn-password", "")}
    values = {**_parsed(core, {**read.values, **given}), "disabled": "yes"}
    check(core, _MENU, values, None)
    if call.arguments.get("skip-cert-import", "no") not in _TRUE and read.certificates:
        _certificates(core, read.certificates, stem, values)
    complete(core, _MENU, values)
    item = core.store.insert(_MENU, values)
    if read.wrap is not None:
        core.wraps[item.id] = read.wrap
    _checks.added(core, Call(call.caller, _MENU, "add", console=call.console), item)
    return Result(rows=[{"progress": "done"}], text="  progress: done")


def _stem(core: Core) -> str:
    """`ovpn-import` and the second of the router's clock; the next one where two are made in a second."""
    second = int(core.time().timestamp())
    while core.store.id_of("interface", f"ovpn-import{second}") is not None:
        second += 1
    return f"ovpn-import{second}"


def _parsed(core: Core, values: dict[str, str]) -> dict[str, str]:
    args = core.store.table(_MENU).args
    try:
        return {name: args[name].kind.parse(text, core.store) for name, text in values.items()}
    except BadValue as error:
        raise Trap("failure: invalid value in the configuration") from error


def _certificates(core: Core, pem: str, stem: str, values: dict[str, str]) -> None:
    try:
        rows, _keys = take(core, pem, lambda authority, _number: f"{'ca' if authority else 'cert'}_{stem}")
    except ValueError as error:
        raise Trap("failure: unable to decode file") from error
    for row in rows:
        if "PRIVATE KEY" in core.keys[row.id]:
            values["certificate"] = reference("certificate", row.id)
