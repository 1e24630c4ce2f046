"""What a router watches by itself: `check-gateway` of routes, and `/tool/netwatch` with its scripts.

Parity. Documented (Manual, IP Routing; Manual, Netwatch; the manual of version 2, Netwatch, for `unknown`):

* `check-gateway` asks every 10 s, waits 1 s, gives a next hop up after 2 misses and takes it back at the first answer;
  from 7.21 `/routing/settings` has other numbers. It belongs to the next hop: all routes by it share its fate.
* Netwatch: a test begins every `interval`; `simple` sends one packet, `icmp` sends `packet-count` of them,
  `packet-interval` apart; `timeout` bounds the waiting. A status that becomes `up` or `down`, from `unknown` too, runs
  its script; every test ends with the `test-script`. A row that was set, enabled or disabled is `unknown` and begins
  anew after `start-delay`; after a start of the router `startup-delay` comes before that. Scripts run as `*sys` with
  the policies read, write, test and reboot; `sent-count` and `response-count` are variables of theirs.

To be seen on a device: the rhythm counts from the beginning of a test; a test whose last packet is answered
ends with it; the state's script runs before the test's script; `start-delay` is added to `startup-delay`; several rows
may have one host; a disabled row stops at once; a next hop that cannot be resolved is not asked and not given up; `arp`
keeps the same time as `ping`. Round trips take no time here, so no threshold but the loss is ever passed. Types of
probes other than `simple` and `icmp` stay `unknown`.

Assumption: netwatch-rhythm
Assumption: failover-recursion
"""

from __future__ import annotations

from ipaddress import AddressValueError, IPv4Address
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.answers import Caller
from atlantis_netcfg.emulator.routeros.console.run import run_script
from atlantis_netcfg.emulator.routeros.core import NETWATCH_GROUP, Core, NetwatchState, NextHop
from atlantis_netcfg.emulator.routeros.network.path import receives
from atlantis_netcfg.emulator.routeros.values import seconds

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.store import StoredItem, Table


_ROWS, _ROUTES, _SETTINGS = "/tool/netwatch", "/ip/route", "/routing/settings"
_NETWATCH = Caller(0, "*sys", NETWATCH_GROUP, "local", "", 0.0)
_LOSS_PERCENT = 85.0
_TYPES = ("simple", "icmp")


def next_watch(core: Core) -> float | None:
    """When, on the core's `now`, something is to be sent or given up; None if nothing is watched."""
    _align(core, core.now())
    moments = [each.at for each in core.watched.rows.values()]
    return min([*moments, *(each.at for each in core.watched.gateways.values())], default=None)


def watch(core: Core) -> None:
    """Do everything that has become due, in its order and each at its own time, however late we look."""
    now = core.now()
    while (due := next_watch(core)) is not None and due <= now:
        hop = next((hop for hop, each in core.watched.gateways.items() if each.at == due), None)
        if hop is not None:
            _ask(core, hop, core.watched.gateways[hop])
        else:
            number = next(number for number, each in core.watched.rows.items() if each.at == due)
            _test(core, number, core.watched.rows[number])
        _align(core, due)


def _align(core: Core, at: float) -> None:
    """Begin with what is new in the configuration, forget what has gone."""
    watched = core.watched
    if watched.revision == core.store.revision:
        return
    started = watched.revision is None
    watched.revision = core.store.revision
    table = core.store.table(_ROWS) if core.schema.has_menu(_ROWS) else None
    rows = {} if table is None else {item.id: item for item in table.items if _watches(core, table, item)}
    for number in [number for number in watched.rows if number not in rows]:
        del watched.rows[number]
    for number, item in rows.items():
        known = watched.rows.get(number)
        if table is not None and (known is None or known.values != item.values):
            begin = _span(core, table, item, "start-delay")
            begin += core.started + _span(core, table, item, "startup-delay") if started else at
            watched.rows[number] = NetwatchState(dict(item.values), begin, begin, since=at)
    hops = _checked(core)
    for hop in [hop for hop in watched.gateways if hop not in hops]:
        del watched.gateways[hop]
    _bury(core, core.dead & hops)
    for hop in hops - set(watched.gateways):
        watched.gateways[hop] = NextHop(at + _check(core, "interval"))


def _watches(core: Core, table: Table, item: StoredItem) -> bool:
    return core.store.text(table, item, "disabled") != "yes" and core.store.text(table, item, "type") in _TYPES


def _span(core: Core, table: Table, item: StoredItem, name: str) -> float:
    return seconds(core.store.text(table, item, name) or "0s") or 0.0


# --- check-gateway -------------------------------------------------------------------------------------------------


def _checked(core: Core) -> set[IPv4Address]:
    """Return the next hops that enabled routes have watched; those that are interfaces cannot be."""
    table = core.store.table(_ROUTES)
    result = set()
    for item in table.items:
        checks = core.store.text(table, item, "check-gateway") in ("ping", "arp")
        if checks and core.store.text(table, item, "disabled") != "yes":
            hop = (core.store.text(table, item, "gateway") or "").partition("@")[0].partition("%")[0]
            try:
                result.add(IPv4Address(hop))
            except AddressValueError:
                continue
    return result


def _check(core: Core, what: str) -> float:
    """Return one of the numbers of `check-gateway`: of the settings where the version has them."""
    fixed = {"interval": 10.0, "timeout": 1.0, "count": 2.0}
    name = f"check-gateway-ping-{what}"
    table = core.store.table(_SETTINGS) if core.schema.has_menu(_SETTINGS) else None
    if table is None or name not in table.args or not table.items:
        return fixed[what]
    return seconds(core.store.text(table, table.items[0], name) or "") or fixed[what]


def _ask(core: Core, hop: IPv4Address, gateway: NextHop) -> None:
    interval, timeout = _check(core, "interval"), _check(core, "timeout")
    if gateway.waiting:
        gateway.waiting = False
        gateway.at += interval - timeout
        gateway.missed += 1
        if gateway.missed >= _check(core, "count"):
            _bury(core, core.dead | {hop})
        return
    resolved = any(route.gateway == hop and route.way for route in core.topology.routes)
    if resolved and hop in core.silent:
        gateway.waiting = True
        gateway.at += timeout
        return
    gateway.missed = 0
    gateway.at += interval
    _bury(core, core.dead - {hop})


def _bury(core: Core, dead: frozenset[IPv4Address]) -> None:
    if dead != core.dead:
        core.dead = dead
        core.store.revision += 1


# --- netwatch ------------------------------------------------------------------------------------------------------


def _test(core: Core, number: int, row: NetwatchState) -> None:
    """Send the next packet, or see that the last ones are not answered any more."""
    table = core.store.table(_ROWS)
    item = table.find(number)
    if item is None:
        return
    icmp = core.store.text(table, item, "type") == "icmp"
    count = int(core.store.text(table, item, "packet-count") or 1) if icmp else 1
    if not row.waiting:
        answered = _answered(core, table, item)
        row.sent += 1
        row.answered += answered
        if row.sent < count:
            row.at += _span(core, table, item, "packet-interval")
            return
        if not answered:
            row.waiting = True
            row.at += _span(core, table, item, "timeout")
            return
    _finish(core, table, item, row)


def _answered(core: Core, table: Table, item: StoredItem) -> bool:
    try:
        host = IPv4Address(core.store.text(table, item, "host") or "")
    except AddressValueError:
        return False
    return core.topology.is_local(host) or receives(core, host, core.store.text(table, item, "src-address"))


def _finish(core: Core, table: Table, item: StoredItem, row: NetwatchState) -> None:
    """End a test: tell what it has shown, run what hangs on it, and wait for the next one."""
    ended = row.at
    lost = 100 * (row.sent - row.answered) / row.sent
    limit = core.store.text(table, item, "thr-loss-percent") if row.sent > 1 else None
    status = "down" if lost > float((limit or f"{_LOSS_PERCENT}").rstrip("%")) else "up"
    row.done, row.failed, row.last = row.done + 1, row.failed + (status == "down"), (row.sent, row.answered)
    changed, row.status = row.status != status, status
    row.since = ended if changed else row.since
    row.begun = max(row.begun + _span(core, table, item, "interval"), ended)
    row.at, row.sent, row.answered, row.waiting = row.begun, 0, 0, False
    scripts = [f"{status}-script"] if changed and not _ignored(core, table, item, row, status) else []
    for name in (*scripts, "test-script"):
        if script := core.store.text(table, item, name):
            _run(core, script, row)


def _ignored(core: Core, table: Table, item: StoredItem, row: NetwatchState, status: str) -> bool:
    """From 7.17 the first status may be told not to run its script."""
    return row.done == 1 and core.store.text(table, item, f"ignore-initial-{status}") == "yes"


def _run(core: Core, script: str, row: NetwatchState) -> None:
    sent, answered = row.last
    variables = {"sent-count": str(sent), "response-count": str(answered), "status": row.status}
    error = run_script(core, _NETWATCH, script, variables).error
    if error is not None:
        core.note("script,error", error)
