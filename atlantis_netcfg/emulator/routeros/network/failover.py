"""Probes of the router: `check-gateway` of routes, and `/tool/netwatch` with its scripts.

Parity. Documented (Manual, IP Routing; Manual, Netwatch; the manual of version 2, Netwatch, for `unknown`):

* `check-gateway` probes every 10 s, waits 1 s, marks a next hop dead after 2 misses and alive at the first response;
  from 7.21 `/routing/settings` has other numbers. The state belongs to the next hop and applies to all its routes.
* Netwatch: a test begins every `interval`; `simple` sends one packet, `icmp` sends `packet-count` of them,
  `packet-interval` apart; `timeout` limits the wait. A status that becomes `up` or `down`, from `unknown` too, runs
  its script; every test ends with the `test-script`. A row that was set, enabled or disabled is `unknown` and begins
  anew after `start-delay`; after a start of the router `startup-delay` comes before that. Scripts run as `*sys` with
  the policies read, write, test and reboot; they have the variables `sent-count` and `response-count`.

With a live data plane (`dataplane/live.py`) a probe is a packet, and a row of type `tcp-conn` opens a connection, which
counts up to `thr-tcp-conn-time`. A response that comes within some milliseconds counts at once; others at the timeout.

Assumed, to be checked on a device: the interval counts from the beginning of a test; a test ends with the response to
its last packet; the state's script runs before the test's script; `start-delay` is added to `startup-delay`; several
rows may have one host; a disabled row stops at once; an unresolvable next hop is neither probed nor marked dead; `arp`
has the same timing as `ping`. Of the thresholds only that for loss is ever exceeded. Other types of probes stay
`unknown`.

Assumption: netwatch-rhythm
Assumption: failover-recursion
"""

from __future__ import annotations

from ipaddress import AddressValueError, IPv4Address
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.answers import Caller
from atlantis_netcfg.emulator.routeros.console.run import run_script
from atlantis_netcfg.emulator.routeros.core import NETWATCH_GROUP, Core, NetwatchState, NextHop
from atlantis_netcfg.emulator.routeros.dataplane.live import GRACE_S
from atlantis_netcfg.emulator.routeros.network.path import receives
from atlantis_netcfg.emulator.routeros.values import seconds

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.store import StoredItem, Table


_ROWS, _ROUTES, _SETTINGS = "/tool/netwatch", "/ip/route", "/routing/settings"
_NETWATCH = Caller(0, "*sys", NETWATCH_GROUP, "local", "", 0.0)
_LOSS_PERCENT = 85.0
_TYPES = ("simple", "icmp")
_TCP = "tcp-conn"


def next_watch(core: Core) -> float | None:
    """Return when the next probe or timeout is due, on the core's `now`; None without probes."""
    _align(core, core.now())
    moments = [each.at for each in core.watched.rows.values()]
    return min([*moments, *(each.at for each in core.watched.gateways.values())], default=None)


def watch(core: Core) -> None:
    """Process all due probes in order, each at its own time, even if called late."""
    now = core.now()
    while (due := next_watch(core)) is not None and due <= now:
        hop = next((hop for hop, each in core.watched.gateways.items() if each.at == due), None)
        if hop is not None:
            _check_gateway(core, hop, core.watched.gateways[hop])
        else:
            number = next(number for number, each in core.watched.rows.items() if each.at == due)
            _test(core, number, core.watched.rows[number])
        _align(core, due)


def _align(core: Core, at: float) -> None:
    """Start probes that are new in the configuration, and drop removed ones."""
    watch_state = core.watched
    if watch_state.revision == core.store.revision:
        return
    is_start = watch_state.revision is None
    watch_state.revision = core.store.revision
    table = core.store.table(_ROWS) if core.schema.has_menu(_ROWS) else None
    rows = {} if table is None else {item.id: item for item in table.items if _is_watched(core, table, item)}
    for number in [number for number in watch_state.rows if number not in rows]:
        del watch_state.rows[number]
    for number, item in rows.items():
        state = watch_state.rows.get(number)
        if table is not None and (state is None or state.values != item.values):
            begin = _read_seconds(core, table, item, "start-delay")
            begin += core.started + _read_seconds(core, table, item, "startup-delay") if is_start else at
            watch_state.rows[number] = NetwatchState(dict(item.values), begin, begin, since=at)
    hops = _checked_hops(core)
    for hop in [hop for hop in watch_state.gateways if hop not in hops]:
        del watch_state.gateways[hop]
    _set_dead(core, core.dead & hops)
    for hop in hops - set(watch_state.gateways):
        watch_state.gateways[hop] = NextHop(at + _check(core, "interval"))


def _is_watched(core: Core, table: Table, item: StoredItem) -> bool:
    types = _TYPES if core.live is None else (*_TYPES, _TCP)
    return core.store.text(table, item, "disabled") != "yes" and core.store.text(table, item, "type") in types


def _read_seconds(core: Core, table: Table, item: StoredItem, name: str) -> float:
    return seconds(core.store.text(table, item, name) or "0s") or 0.0


# --- check-gateway -------------------------------------------------------------------------------------------------


def _checked_hops(core: Core) -> set[IPv4Address]:
    """Return the next hops of enabled routes with `check-gateway`; interfaces cannot be checked."""
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
    """Return a number of `check-gateway`, from the settings if the version has them."""
    defaults = {"interval": 10.0, "timeout": 1.0, "count": 2.0}
    name = f"check-gateway-ping-{what}"
    table = core.store.table(_SETTINGS) if core.schema.has_menu(_SETTINGS) else None
    if table is None or name not in table.args or not table.items:
        return defaults[what]
    return seconds(core.store.text(table, table.items[0], name) or "") or defaults[what]


def _check_gateway(core: Core, hop: IPv4Address, gateway: NextHop) -> None:
    interval, timeout = _check(core, "interval"), _check(core, "timeout")
    if gateway.waiting:
        gateway.waiting = False
        gateway.at += interval - timeout
        if gateway.probe is not None and gateway.probe.has_response():
            gateway.missed_count = 0
            _set_dead(core, core.dead - {hop})
            return
        gateway.missed_count += 1
        if gateway.missed_count >= _check(core, "count"):
            _set_dead(core, core.dead | {hop})
        return
    is_resolved = any(route.gateway == hop and route.way for route in core.topology.routes)
    gateway.probe = core.live.echo(hop, None, timeout) if is_resolved and core.live is not None else None
    if is_resolved and (hop in core.silent if gateway.probe is None else not gateway.probe.has_response(GRACE_S)):
        gateway.waiting = True
        gateway.at += timeout
        return
    gateway.missed_count = 0
    gateway.at += interval
    _set_dead(core, core.dead - {hop})


def _set_dead(core: Core, dead: frozenset[IPv4Address]) -> None:
    if dead != core.dead:
        core.dead = dead
        core.store.revision += 1


# --- netwatch ------------------------------------------------------------------------------------------------------


def _test(core: Core, number: int, row: NetwatchState) -> None:
    """Send the next packet, or finish the test after the timeout."""
    table = core.store.table(_ROWS)
    item = table.find(number)
    if item is None:
        return
    icmp = core.store.text(table, item, "type") == "icmp"
    count = int(core.store.text(table, item, "packet-count") or 1) if icmp else 1
    if not row.waiting:
        has_answer = _has_answer(core, table, item, row)
        row.sent_count += 1
        row.answer_count += has_answer
        if row.sent_count < count:
            row.at += _read_seconds(core, table, item, "packet-interval")
            return
        if not has_answer:
            row.waiting = True
            row.at += _read_seconds(core, table, item, "timeout")
            return
    row.answer_count += sum(probe.has_response(None if row.waiting else 0.0) for probe in row.open_probes)
    row.open_probes.clear()
    _finish(core, table, item, row)


def _has_answer(core: Core, table: Table, item: StoredItem, row: NetwatchState) -> bool:
    """Return whether a packet is answered at once; one of a live data plane that is not becomes an open probe."""
    try:
        host = IPv4Address(core.store.text(table, item, "host") or "")
    except AddressValueError:
        return False
    source = core.store.text(table, item, "src-address")
    if core.live is None:
        return core.topology.is_local(host) or receives(core, host, source)
    timeout = _read_seconds(core, table, item, "timeout")
    if core.store.text(table, item, "type") == _TCP:
        timeout = min(timeout, _read_seconds(core, table, item, "thr-tcp-conn-time") or timeout)
        probe = core.live.connect(host, int(core.store.text(table, item, "port") or 0), source, timeout)
    else:
        probe = core.live.echo(host, source, timeout)
    has_answer = probe.has_response(GRACE_S)
    row.open_probes += [] if has_answer else [probe]
    return has_answer


def _finish(core: Core, table: Table, item: StoredItem, row: NetwatchState) -> None:
    """Finish a test: update the status, run its scripts, and schedule the next one."""
    end = row.at
    loss_percent = 100 * (row.sent_count - row.answer_count) / row.sent_count
    limit = core.store.text(table, item, "thr-loss-percent") if row.sent_count > 1 else None
    status = "down" if loss_percent > float((limit or f"{_LOSS_PERCENT}").rstrip("%")) else "up"
    row.test_count, row.failure_count, row.last = (
        row.test_count + 1,
        row.failure_count + (status == "down"),
        (row.sent_count, row.answer_count),
    )
    has_changed, row.status = row.status != status, status
    row.since = end if has_changed else row.since
    row.start = max(row.start + _read_seconds(core, table, item, "interval"), end)
    row.at, row.sent_count, row.answer_count, row.waiting = row.start, 0, 0, False
    scripts = [f"{status}-script"] if has_changed and not _is_ignored(core, table, item, row, status) else []
    for name in (*scripts, "test-script"):
        if script := core.store.text(table, item, name):
            _run(core, script, row)


def _is_ignored(core: Core, table: Table, item: StoredItem, row: NetwatchState, status: str) -> bool:
    """Return whether the script of the first status is suppressed (from 7.17)."""
    return row.test_count == 1 and core.store.text(table, item, f"ignore-initial-{status}") == "yes"


def _run(core: Core, script: str, row: NetwatchState) -> None:
    sent_count, answer_count = row.last
    variables = {"sent-count": str(sent_count), "response-count": str(answer_count), "status": row.status}
    error = run_script(core, _NETWATCH, script, variables).error
    if error is not None:
        core.note("script,error", error)
