"""The bytes beside a look: what the ports have carried this month, and what the look itself costs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.bearers.cost import bill
from atlantis_netcfg.bearers.policy import probe_commands
from atlantis_netcfg.journal import Counters, MonthBytes
from atlantis_netcfg.operations.bearers import LAN
from atlantis_netcfg.operations.costs import links_of
from atlantis_netcfg.operations.links._router import PINGS
from atlantis_netcfg.routeros.estimate import on_the_wire

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from datetime import datetime

    from atlantis_netcfg.bearers.cost import Bill
    from atlantis_netcfg.bearers.policy import Way
    from atlantis_netcfg.journal import Usage
    from atlantis_netcfg.operations.links._ask import Round
    from atlantis_netcfg.operations.links._router import RouterReading

__all__ = ["bills", "months", "ping_bytes"]


def ping_bytes(ways: Sequence[Way]) -> Mapping[str, int]:
    """Bearer to what its pings come to on the wire if all are answered."""
    costs: dict[str, int] = {}
    for probe in probe_commands(ways, count=PINGS):
        costs[probe.bearer] = costs.get(probe.bearer, 0) + probe.wire_bytes
    return costs


def months(
    usage: Usage, device: str, reading: RouterReading | None, ways: Sequence[Way], now: datetime
) -> dict[str, MonthBytes]:
    """Keep the counters of this look, and say what is known of the month. Raises JournalFailed, StateDamaged."""
    for name, counters in _counters(device, reading, ways, now):
        usage.record(name, counters)
    return {way.name: usage.month(way.name, now) for way in ways}


def _counters(
    device: str, reading: RouterReading | None, ways: Sequence[Way], now: datetime
) -> Iterator[tuple[str, Counters]]:
    if reading is None or reading.ports is None:
        return
    for way in ways:
        port = reading.ports.get(way.port or "")
        if port is None or way.port is None or port.rx_bytes is None or port.tx_bytes is None:
            continue
        yield (
            way.name,
            Counters(
                device=device,
                interface=way.port,
                rx_bytes=port.rx_bytes,
                tx_bytes=port.tx_bytes,
                at=reading.at or now,
                uptime_s=reading.uptime_s,
            ),
        )


def bills(turn: Round, active: tuple[str, ...] | None, seconds: float) -> dict[str, Bill]:
    """Price the sessions with RouterOS devices that went over metered links, by bearer.

    Whoever works over a link of the site really goes where its default route leads; an emulated device is behind the
    link that is declared, whatever its routes say.
    """
    links = links_of(turn.declaration, turn.router.site)
    spent: dict[str, int] = {}
    for name, door in turn.doors.items():
        link = turn.carrier(turn.declaration.hosts[name]).name
        if link != LAN.name and active is not None and len(active) == 1 and not turn.request.rehearsed:
            link = active[0]
        if links[link].metered and door.spent:
            spent[link] = spent.get(link, 0) + on_the_wire(door.bytes, door.connections)
    return {name: bill(nbytes, seconds, links[name].tariff) for name, nbytes in spent.items()}
