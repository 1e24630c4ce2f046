"""Whether positions are possible, agree with each other, and lie where the test is."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.probes.gps.earth import distance_m, from_middle_m, meters, place
from atlantis_netcfg.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.probes.gps.record import Reception, Report
    from atlantis_netcfg.probes.gps.wanted import Wanted
    from atlantis_netcfg.site.model import Geofence

__all__ = ["misplaced"]

NULL_DEGREES = 1e-4
"""Ten metres around 0, 0."""
JUMP_M = 25.0
SPEED_M_S = 15.0
"""A position may move by this much more for each second: a vessel in tow, a UAV that is carried by car."""

_Positions = list[tuple[float, float]]


def misplaced(reception: Reception, wanted: Wanted) -> Iterator[Finding]:
    """Judge the fixes; one that is impossible says so and nothing else."""
    impossible = [one for one in reception.fixes if not one.possible]
    if impossible:
        where = place(impossible[0].latitude, impossible[0].longitude)
        message = f"{wanted.name}'s receiver claims a fix at {where}, which is no position"
        yield Finding(Verdict.FAIL, "position-impossible", message, "restart the receiver and its driver")
        return
    positions = [(one.latitude or 0.0, one.longitude or 0.0) for one in reception.fixes]
    if any(abs(latitude) < NULL_DEGREES and abs(longitude) < NULL_DEGREES for latitude, longitude in positions):
        message = f"{wanted.name}'s position is 0, 0: its driver fills in zeros where it has nothing"
        yield Finding(
            Verdict.FAIL, "position-null", message, "restart the driver; it must not claim a fix without a position"
        )
        return
    yield from _jumps(reception.fixes, positions, wanted)
    if wanted.fence is not None:
        yield from _outside(positions, wanted.fence, wanted)
    else:
        message = f"{wanted.name} is at {place(*positions[-1])}; nobody has declared where it should be"
        yield Finding(Verdict.WARN, "no-geofence", message, "declare `checklist.geofence` of the site")


def _jumps(fixes: Sequence[Report], positions: _Positions, wanted: Wanted) -> Iterator[Finding]:
    gaps = (then.at_s - one.at_s for one, then in pairwise(fixes))
    steps = [(distance_m(*one, *then), gap) for (one, then), gap in zip(pairwise(positions), gaps, strict=True)]
    wide = [step_m for step_m, gap in steps if step_m > JUMP_M + SPEED_M_S * gap]
    if wide:
        message = f"{wanted.name}'s position jumps by {meters(max(wide))} from one report to the next"
        yield Finding(
            Verdict.FAIL,
            "position-jumps",
            message,
            "move the antenna away from walls and water's edge, or wait for more satellites",
        )


def _outside(positions: _Positions, fence: Geofence, wanted: Wanted) -> Iterator[Finding]:
    outside = [one for one in positions if from_middle_m(fence, *one) > fence.radius_m]
    if not outside:
        return
    far = max(outside, key=lambda one: from_middle_m(fence, *one))
    if all(_inside(fence, longitude, latitude) for latitude, longitude in outside):
        told = f"{place(*far)} lies in the geofence the other way round"
        message = f"{wanted.name}'s latitude and longitude are swapped: {told}"
        hint = (
            "mend the driver or the converter that exchanges them: latitude comes first, longitudes west are negative"
        )
        yield Finding(Verdict.WARN, "position-swapped", message, hint)
        return
    away = meters(from_middle_m(fence, *far))
    message = f"{wanted.name} is at {place(*far)}, {away} from the middle of the geofence of {meters(fence.radius_m)}"
    yield Finding(Verdict.FAIL, "outside-geofence", message, _hint(fence, *far))


def _inside(fence: Geofence, latitude: float, longitude: float) -> bool:
    return abs(latitude) <= 90 and from_middle_m(fence, latitude, longitude) <= fence.radius_m  # noqa: PLR2004 - the poles


def _hint(fence: Geofence, latitude: float, longitude: float) -> str:
    if _inside(fence, latitude, -longitude):
        return "the sign of the longitude is lost: west is negative; mend the driver or the converter"
    if _inside(fence, -latitude, longitude):
        return "the sign of the latitude is lost: south is negative; mend the driver or the converter"
    return "compare it with the map: the receiver is wrong, or `checklist.geofence` of the site is"
