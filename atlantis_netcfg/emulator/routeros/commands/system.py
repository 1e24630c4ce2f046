"""Commands without rows: reboot, ping, connections, log, device-mode, `/interface`, safe mode, undo and redo.

Manual, Ethernet; Manual, PoE-Out; Manual, Configuration Management: Safe Mode. The API's response to a second session
that takes safe mode is not published; the text is the console's question as an error.

Assumption: safe-mode-second-taker
"""

from __future__ import annotations

from dataclasses import replace
from ipaddress import IPv4Address
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.access import FEATURES
from atlantis_netcfg.emulator.routeros.answers import Category, Trap
from atlantis_netcfg.emulator.routeros.commands import _checks, write
from atlantis_netcfg.emulator.routeros.commands._computed import connections
from atlantis_netcfg.emulator.routeros.core import Call, CallResult, Core, notify_holder_lost
from atlantis_netcfg.emulator.routeros.environment import load_of
from atlantis_netcfg.emulator.routeros.network.path import answers
from atlantis_netcfg.emulator.routeros.network.traffic import count_echoes
from atlantis_netcfg.emulator.routeros.spec import Deviation, DeviceModeName
from atlantis_netcfg.emulator.routeros.values import id_text

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from atlantis_netcfg.emulator.routeros.store import StoredItem

_PING_SIZE = "56"


def reboot(core: Core, _call: Call) -> CallResult:
    """Request a reboot, carried out by the owner of the sockets."""
    core.wants_reboot = True
    core.note("system,info", "router rebooted")
    return CallResult()


def ping(core: Core, call: Call) -> CallResult:
    """Send echo requests: packets of a live data plane, else the spec and the configuration decide who responds."""
    argument_names = core.schema.arguments(call.menu, call.command)
    for name in call.arguments:
        if name not in argument_names:
            raise _checks.unknown(name)
    if "address" not in call.arguments:
        raise _checks.MissingArgument("address")
    target = _target(call.arguments["address"])
    count = call.arguments.get("count", "1")
    if not count.isdecimal() or int(count) < 1:
        raise Trap("invalid value for argument count", Category.ARGUMENT)
    source = call.arguments.get("src-address")
    if call.arguments.get("arp-ping") == "yes":
        # Who answers ARP on a link of its own is nobody's packet on the way out, and needs no route.
        return CallResult(
            rows=_echoes(core, target, _model_echoes(int(count), reachable=str(target) in core.spec.answering))
        )
    if core.live is not None:
        return CallResult(rows=_echoes(core, target, core.live.ping(target, source, int(count))))
    reachable = answers(core, target, source)
    count_echoes(core, target, source, int(count), has_answer=reachable)
    return CallResult(rows=_echoes(core, target, _model_echoes(int(count), reachable=reachable)))


def remove_connections(core: Core, call: Call) -> CallResult:
    """Remove tracked connections; without a live data plane there are none."""
    rows = {row[".id"]: row for row in connections(core, call)}
    numbers = call.arguments.get("numbers") or call.arguments.get(".id") or ""
    for number in filter(None, numbers.split(",")):
        if number not in rows:
            raise _checks.no_such_item()
        if core.live is not None:
            core.live.forget_connections(rows[number])
    return CallResult()


def _target(text: str) -> IPv4Address:
    try:
        return IPv4Address(text)
    except ValueError as error:
        raise Trap("failure: resolve failed" if text[:1].isalpha() else "invalid value for argument address") from error


def _model_echoes(count: int, *, reachable: bool) -> list[tuple[float, int] | None]:
    return [(0.001, 64) if reachable else None] * count


def _echoes(core: Core, host: IPv4Address, results: Sequence[tuple[float, int] | None]) -> list[dict[str, str]]:
    """Return a row for each echo request; results are round-trip time in seconds and TTL, None after a timeout."""
    rows, times = [], list[float]()
    for number, result in enumerate(results):
        row = {"seq": str(number), "host": str(host)}
        if result is None:
            row["status"] = "timeout"
        else:
            times.append(result[0])
            row |= {"size": _PING_SIZE, "ttl": str(result[1]), "time": _time(core, result[0])}
        loss_percent = 100 * (number + 1 - len(times)) // (number + 1)
        row |= {"sent": str(number + 1), "received": str(len(times)), "packet-loss": str(loss_percent)}
        if times:
            figures = {"min-rtt": min(times), "avg-rtt": sum(times) / len(times), "max-rtt": max(times)}
            row |= {name: _time(core, value) for name, value in figures.items()}
        rows.append(row)
    return rows


def _time(core: Core, value_s: float) -> str:
    """Format a round-trip time: `1ms204us`, before version 7 `1ms`."""
    milliseconds, microseconds = divmod(round(value_s * 1e6), 1000)
    if not core.schema.at_least("7.0"):
        return f"{milliseconds}ms"
    return (f"{milliseconds}ms" if milliseconds else "") + (f"{microseconds}us" if microseconds else "") or "0us"


def log(core: Core, call: Call) -> CallResult:
    """Write a line to the log (`/log/info message=...`)."""
    if "message" not in call.arguments:
        raise _checks.MissingArgument("message")
    core.note(f"script,{call.command}", call.arguments["message"])
    return CallResult()


def logout(core: Core, call: Call) -> CallResult:
    """End another session as if its client had closed it: `/user/active/request-logout`, `remove` from 7.20."""
    numbers = {f"*{number:X}": number for number in core.sessions}
    selector = call.arguments.get(".id") or call.arguments.get("numbers") or ""
    if selector not in numbers:
        raise _checks.no_such_item()
    core.ended.add(numbers[selector])
    return CallResult()


def update_mode(core: Core, call: Call) -> CallResult:
    """Request a button press, which cannot be emulated: nothing changes (Manual, Device-mode)."""
    argument_names = core.schema.arguments(call.menu, call.command)
    for name in call.arguments:
        if name not in argument_names:
            raise _checks.unknown(name)
    mode = call.arguments.get("mode")
    if mode is not None and mode not in list(DeviceModeName):
        raise Trap("input does not match any value of mode", Category.ARGUMENT)
    for name in call.arguments:
        if name in FEATURES and call.arguments[name] not in ("yes", "no", "true", "false"):
            raise Trap(f"invalid value for argument {name}", Category.ARGUMENT)
    window = call.arguments.get("activation-timeout", "5m")
    text = f"turn off power or reboot by pressing reset or mode button in {window} to activate changes"
    return CallResult(rows=[{"update": text}])


def interface(core: Core, call: Call) -> CallResult:
    """Change rows of `/interface` in the menu that defines them."""
    selector = call.arguments.get(".id") or call.arguments.get("numbers")
    if selector is None:
        raise _checks.MissingArgument(".id" if not call.console else "numbers")
    if call.command not in _ROW_COMMANDS:
        raise Trap(f"not rehearsed by the twin: {call.path}")
    argument_names = core.schema.arguments("/interface", call.command) | {".id"}
    for name in call.arguments:
        if name not in argument_names:
            raise _checks.unknown(name)
    for part in selector.split(","):
        rest = {name: value for name, value in call.arguments.items() if name != "numbers"}
        _ROW_COMMANDS[call.command](core, replace(call, menu=_find_menu(core, part), arguments=rest | {".id": part}))
    return CallResult()


def _find_menu(core: Core, selector: str) -> str:
    for table in core.store.space_tables("interface"):
        if write.find_item(core, table, selector) is not None:
            return table.menu.path
    raise _checks.no_such_item()


_ROW_COMMANDS = {
    "set": write.set_,
    "enable": write.enable,
    "disable": write.disable,
    "comment": write.comment,
}


def poe(core: Core, call: Call) -> CallResult:
    """Set PoE values through `/interface/ethernet/poe`; they are stored in `/interface/ethernet`."""
    argument_names = core.schema.arguments(call.menu, "set") | {".id"}
    for name in call.arguments:
        if name not in argument_names:
            raise _checks.unknown(name)
    return write.set_(core, replace(call, menu="/interface/ethernet"))


_SELECTORS = ("numbers", ".id")


def monitor(core: Core, call: Call) -> CallResult:
    """Emulate `poe/monitor <ports> once` for PoE ports."""
    return CallResult(
        rows=[_row(core, _port(core, part, core.spec.poe_ports)) for part in _monitored_ports(core, call)]
    )


def ethernet(core: Core, call: Call) -> CallResult:
    """Emulate `monitor <ports> once`; without link there is no rate. All links have 1 Gbit/s."""
    return CallResult(rows=[_link(core, _port(core, part, core.spec.ports)) for part in _monitored_ports(core, call)])


def _monitored_ports(core: Core, call: Call) -> list[str]:
    """Return the ports to monitor; `once` is required, because the command would not end."""
    argument_names = core.schema.arguments(call.menu, call.command) | {*_SELECTORS, ".proplist"}
    for name in call.arguments:
        if name not in argument_names:
            raise _checks.unknown(name)
    selector = next((call.arguments[name] for name in _SELECTORS if name in call.arguments), None)
    if selector is None:
        raise _checks.MissingArgument("numbers")
    if "once" not in call.arguments:
        raise Trap(f"not rehearsed by the twin: {call.path} without once")
    return selector.split(",")


def _port(core: Core, selector: str, ports: Collection[str]) -> StoredItem:
    """Return the port with that name or id, if its factory name is among `ports`."""
    table = core.store.table("/interface/ethernet")
    for item in table.items:
        there = (item.factory or {}).get("name") in ports
        if there and selector in {id_text(item.id), core.store.text(table, item, "name")}:
            return item
    raise _checks.no_such_item()


def _link(core: Core, item: StoredItem) -> dict[str, str]:
    """Return a port's status; fields are from a monitor posted in MikroTik's forum (thread 103445)."""
    name = core.store.text(core.store.table("/interface/ethernet"), item, "name") or ""
    if not core.topology.interfaces[item.id].running:
        return {"name": name, "status": "no-link", "auto-negotiation": "incomplete"}
    row = {"name": name, "status": "link-ok", "auto-negotiation": "done", "rate": "1Gbps", "full-duplex": "yes"}
    return row | {"tx-flow-control": "no", "rx-flow-control": "no"}


def _row(core: Core, item: StoredItem) -> dict[str, str]:
    table = core.store.table("/interface/ethernet")
    setting = core.store.text(table, item, "poe-out") or "auto-on"
    local = {"name": core.store.text(table, item, "name") or "", "poe-out": setting}
    return local | load_of(core, (item.factory or {})["name"], setting)


def _check_arguments(core: Core, call: Call) -> None:
    for name in (*call.arguments, *call.unset):
        if name not in core.schema.arguments(call.menu, call.command):
            raise _checks.unknown(name)


def take(core: Core, call: Call) -> CallResult:
    """Enter safe mode; only one session may hold it."""
    _check_arguments(core, call)
    holder = core.history.holder
    if holder is not None and holder.number != call.caller.number:
        if core.deviates(Deviation.SECOND_TAKER):
            notify_holder_lost(core, call.caller)
            core.history.take(call.caller)
            return CallResult()
        raise Trap(f"failure: safe mode is held by {holder.via}:{holder.user}@{holder.address}")
    if holder is None:
        core.history.take(call.caller)
        core.note("system,info", f"safe mode taken by {call.caller.user}")
    return CallResult()


def release(core: Core, call: Call) -> CallResult:
    """Release safe mode and keep its changes; any session may do that."""
    _check_arguments(core, call)
    if core.history.holder is not None:
        notify_holder_lost(core, call.caller)
        core.history.release()
        core.note("system,info", f"safe mode released by {call.caller.user}")
    return CallResult()


def unroll(core: Core, call: Call) -> CallResult:
    """Undo all changes and leave safe mode; the session continues."""
    _check_arguments(core, call)
    if core.history.holder is not None:
        notify_holder_lost(core, call.caller)
        core.history.unroll(core.store)
        core.note("system,info", f"safe mode unrolled by {call.caller.user}")
    return CallResult(text="Unrolling Safe Mode... Success!")


def toggle(core: Core, call: Call) -> CallResult:
    """Toggle safe mode."""
    return take(core, call) if core.history.holder is None else release(core, call)


def undo(core: Core, _call: Call) -> CallResult:
    """Undo the last action."""
    if not core.history.undo(core.store):
        raise Trap("failure: nothing to undo")
    return CallResult()


def redo(core: Core, _call: Call) -> CallResult:
    """Redo the action that was undone last."""
    if not core.history.redo(core.store):
        raise Trap("failure: nothing to redo")
    return CallResult()
