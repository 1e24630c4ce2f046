"""Map a command's path to its handler, and check the session's rights.

Assumption: api-ping-path
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros import access
from atlantis_netcfg.emulator.routeros.answers import Category, Trap
from atlantis_netcfg.emulator.routeros.commands import certificate, files, lte, radio, read, system, write
from atlantis_netcfg.emulator.routeros.commands._checks import unknown
from atlantis_netcfg.emulator.routeros.commands._computed import COMPUTED_MENUS
from atlantis_netcfg.emulator.routeros.spec import Deviation

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.core import Call, CallResult, Core, Handler

_SPECIAL: dict[str, tuple[Handler, str]] = {
    "/certificate/import": (certificate.import_certificate, "policy"),
    "/certificate/sign": (certificate.sign, "policy"),
    "/console/inspect": (read.inspect, "read"),
    "/execute": (files.execute, "write"),
    "/export": (files.export, "read"),
    "/file/add": (files.add, "write"),
    "/file/read": (files.read, "read"),
    "/file/remove": (files.remove, "write"),
    "/file/set": (files.set_, "write"),
    "/import": (files.import_, "write"),
    "/interface/comment": (system.interface, "write"),
    "/interface/disable": (system.interface, "write"),
    "/interface/enable": (system.interface, "write"),
    "/interface/ethernet/monitor": (system.ethernet, "read"),
    "/interface/ethernet/poe/monitor": (system.monitor, "read"),
    "/interface/ethernet/poe/set": (system.poe, "write"),
    "/interface/lte/monitor": (lte.monitor, "read"),
    "/interface/lte/show-capabilities": (lte.capabilities, "read"),
    "/interface/ovpn-client/import-ovpn-configuration": (certificate.import_profile, "write"),
    "/interface/set": (system.interface, "write"),
    "/interface/wifi/monitor": (radio.monitor, "read"),
    "/interface/wireless/monitor": (radio.monitor, "read"),
    "/ip/firewall/connection/remove": (system.remove_connections, "write"),
    "/log/debug": (system.log, "write"),
    "/log/error": (system.log, "write"),
    "/log/info": (system.log, "write"),
    "/log/warning": (system.log, "write"),
    "/ping": (system.ping, "test"),
    "/redo": (system.redo, "write"),
    "/safe-mode/release": (system.release, "write"),
    "/safe-mode/take": (system.take, "write"),
    "/safe-mode/toggle": (system.toggle, "write"),
    "/safe-mode/unroll": (system.unroll, "write"),
    "/system/backup/load": (files.load, "policy"),
    "/system/backup/save": (files.save, "policy"),
    "/system/device-mode/update": (system.update_mode, "policy"),
    "/system/reboot": (system.reboot, "reboot"),
    "/tool/ping": (system.ping, "test"),
    "/undo": (system.undo, "write"),
    "/user/active/remove": (system.logout, "policy"),
    "/user/active/request-logout": (system.logout, "policy"),
}
_ROWS: dict[str, tuple[Handler, str]] = {
    "add": (write.add, "write"),
    "comment": (write.comment, "write"),
    "disable": (write.disable, "write"),
    "enable": (write.enable, "write"),
    "export": (files.export, "read"),
    "find": (read.find, "read"),
    "get": (read.get, "read"),
    "getall": (read.print_, "read"),
    "move": (write.move, "write"),
    "print": (read.print_, "read"),
    "remove": (write.remove, "write"),
    "set": (write.set_, "write"),
    "unset": (write.unset, "write"),
}
_READ_ONLY = ("export", "find", "get", "getall", "print")


def dispatch(core: Core, call: Call) -> CallResult:
    """Run one command. Raises Trap with the router's text."""
    if not core.schema.has_menu(call.menu):
        raise Trap("no such command prefix", Category.MISSING)
    is_missing = call.path == "/tool/ping" and core.deviates(Deviation.NO_PING)
    if is_missing or not core.schema.has_command(call.menu, call.command):
        raise Trap("no such command", Category.MISSING)
    feature = access.COMMANDS.get(call.path)
    if feature is not None and not access.is_allowed(core.spec, feature):
        raise Trap(access.NOT_ALLOWED)
    handler, policy = _handler(core, call)
    _require_policy(core, call, policy)
    return handler(core, call)


def _handler(core: Core, call: Call) -> tuple[Handler, str]:
    special = _SPECIAL.get(call.path)
    # At the root `find` and `set` are words of the scripting language.
    row = _ROWS.get(call.command) if call.menu != "/" else None
    if special is None and row is not None and (call.menu not in COMPUTED_MENUS or call.command in _READ_ONLY):
        return row
    _check_names(core, call)
    if special is None and call.command == "add":
        write.check_needed(core, call, call.arguments)
    if special is None:
        if call.menu not in COMPUTED_MENUS:
            write.check_rows(core, call)
        raise Trap(f"not rehearsed by the twin: {call.path}")
    return special


def _check_names(core: Core, call: Call) -> None:
    """Refuse unknown arguments, before any other check."""
    argument_names = core.schema.arguments(call.menu, call.command)
    api = {".id", ".proplist"} if {"number", "numbers"} & argument_names else {".proplist"}
    for name in call.arguments:
        if name not in argument_names | api:
            raise unknown(name)


def _require_policy(core: Core, call: Call, policy: str) -> None:
    policies = core.policies(call.caller)
    required_policies = {policy, "policy"} if policy == "write" and call.menu.startswith("/user") else {policy}
    if not required_policies <= policies:
        raise Trap("not enough permissions (9)")
