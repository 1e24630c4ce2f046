"""Positions by sound: listened for, and asked for only by a step of its own that a person agrees to.

Whether a USBL works shows in the fixes that it tells while somebody pings; hearing none proves nothing, so silence is
never a failure. A ping of our own is for SeaTrac beacons, in the water, and behind the beacon's depth.

How it could be fooled, and what stops it:

==============================================  ====================================================================
one fix told again and again, a log in a loop   each measurement counts once and none comes back: `repeated`
a fix that is old, or of the future             the modem's own two times: `stale`, `time-impossible`
fixes that ended before the listening did       the age of the last one: `ended`
a log of another day, a set clock               times since 1970 against the listening clock: `clock-differs`
fixes kept back, or a log at another pace       the modem's clock against ours while fixes come: `out-of-step`
zeros for what was not measured                 a range or position of nothing: `position-null`
a ship kilometres away, an echo                 the geofence's width, the maker's reach: `too-far`, `far-away`
a position that the sound's time denies         no sound speed of water explains it: `range-mismatch`
accuracy, integrity or signal of nothing        values that no reception has: `values-impossible`
any modem where nobody is declared              `hears` is missing: `whose-unknown`
the modem of somebody else at our address       its own address, and that of the acoustic column: `wrong-address`
answers for another beacon, or of itself        addressee and sender in the fix: `other-beacon`, `own-address`
a beacon without a direction (X110)             flags of the fix: `range-only`; with nothing valid it is no fix
one good fix among bad ones                     the good ones have to be more: else the last bad one speaks
an answer to somebody else's ping               only what comes behind our own ping's acknowledgement counts
==============================================  ====================================================================

Not stopped: a log of this very modem, at its own pace, by something that answers our queries as well, where its clock
counts from when it was switched on. A SeaTrac tells no times at all. A person sees whether it follows the vehicle.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.probes.acoustic.modem import declared_address, modem_of, question
from atlantis_netcfg.probes.step import Step
from atlantis_netcfg.probes.usbl._fixes import Fixes
from atlantis_netcfg.probes.usbl._ping import Ping, ping_consent
from atlantis_netcfg.report.checklist import Kind, Phase
from atlantis_netcfg.site.model import AcousticDriver

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.probes.acoustic.modem import Modem
    from atlantis_netcfg.probes.cell import Cell
    from atlantis_netcfg.site.model import UsblEndpoint

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
