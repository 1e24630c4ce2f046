"""Positions by sound: listened for, and asked for only by a step of its own that a person agrees to.

Whether a USBL works shows in the fixes that it tells while somebody pings; hearing none proves nothing, so silence is
never a failure. A ping of our own is for SeaTrac beacons, in the water, and behind the beacon's depth.

How it could be fooled, and what stops it, stands in docs/probes.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes.acoustic.modem import declared_address, modem_of, question
from atlantis_netcfg.checklist.probes.step import Step
from atlantis_netcfg.checklist.probes.usbl._fixes import Fixes
from atlantis_netcfg.checklist.probes.usbl._ping import Ping, ping_consent
from atlantis_netcfg.checklist.report import Kind, Phase
from atlantis_netcfg.declaration.model import AcousticDriver

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.checklist.probes.acoustic.modem import Modem
    from atlantis_netcfg.checklist.probes.cell import Cell
    from atlantis_netcfg.declaration.model import UsblEndpoint

__all__ = ["steps"]


def steps(cell: Cell) -> tuple[Step, ...]:
    """Fixes that are told, and a ping where a beacon for it is declared."""
    modem, endpoint = modem_of(cell), cell.endpoints.usbl
    if modem is None or endpoint is None:
        return (_by_a_person(cell),)
    passive = Step(
        name="",
        title=f"The USBL of {cell.name} tells fresh fixes",
        kind=Kind.AUTOMATIC,
        phase=Phase.WATER,
        probe=Fixes(
            modem,
            cell.name,
            endpoint.hears,
            endpoint.max_age_s,
            question(cell, modem),
            declared_address(cell, modem),
            _width_m(cell),
        ),
    )
    return (passive, *_ping(cell, modem, endpoint))


def _width_m(cell: Cell) -> float | None:
    fence = cell.declared.checklist.geofence
    return None if fence is None else 2 * fence.radius_m


def _ping(cell: Cell, modem: Modem, endpoint: UsblEndpoint) -> Iterator[Step]:
    if endpoint.ping is None:
        return
    if modem.driver is not AcousticDriver.SEATRAC:
        yield _pinged_by_a_person(cell, endpoint.ping)
        return
    consent = ping_consent(cell.name, endpoint.ping)
    yield Step(
        name="ping",
        title=f"The beacon {endpoint.ping} answers a ping of {cell.name}",
        kind=Kind.ACTIVE,
        phase=Phase.WATER,
        probe=Ping(modem, cell.name, endpoint.ping, consent, declared_address(cell, modem), _width_m(cell)),
        consent=consent,
    )


def _pinged_by_a_person(cell: Cell, beacon: int) -> Step:
    """A modem that is no SeaTrac beacon measures ranges with its messages; this tool pings by SeaTrac only."""
    return Step(
        name="ping",
        title=f"The modem with the address {beacon} answers {cell.name}",
        kind=Kind.PERSON,
        phase=Phase.WATER,
        do=f"With both in the water, let the software of {cell.name} locate the modem with the address {beacon}.",
        look_for="A position comes, and its range is about that on the chart.",
    )


def _by_a_person(cell: Cell) -> Step:
    declared = cell.endpoints.usbl is not None
    why = "has no address at this site" if declared else "is not declared"
    return Step(
        name="",
        title=f"The USBL of {cell.name} gives its position",
        kind=Kind.PERSON,
        phase=Phase.WATER,
        do=f"The USBL of {cell.name} {why}, so nobody can listen to it. With both transducers in the water, and never "
        "in air, let the vehicle be located from its base, some metres away and in a known direction.",
        look_for="A new position comes every few seconds, in the right direction, and its range is about that which is "
        "seen; it follows when the vehicle moves.",
    )
