"""Judge whether positions are good enough to start a test: present, current, in the right place, measured."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes.gps import record
from atlantis_netcfg.checklist.report import Evidence, EvidenceType
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory.model import Geofence, GpsDriver
from atlantis_netcfg.links import LinkFinding

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence


RADIUS_M = 6_371_008.8
"""Mean radius of WGS 84."""


def distance_m(latitude: float, longitude: float, other_latitude: float, other_longitude: float) -> float:
    """Return the great-circle distance by the haversine formula: within 0.5 % of the ellipsoid."""
    north, east = math.radians(other_latitude - latitude), math.radians(other_longitude - longitude)
    both = math.cos(math.radians(latitude)) * math.cos(math.radians(other_latitude))
    half = math.sin(north / 2) ** 2 + both * math.sin(east / 2) ** 2
    return 2 * RADIUS_M * math.asin(min(1.0, math.sqrt(half)))


def from_middle_m(fence: Geofence, latitude: float, longitude: float) -> float:
    """Return the distance of a position from the centre of a geofence."""
    return distance_m(fence.latitude, fence.longitude, latitude, longitude)


def place(latitude: float | None, longitude: float | None) -> str:
    """Format a position to five decimals: about a metre."""
    return msg("nowhere" if latitude is None or longitude is None else f"{arg(latitude):.5f}, {arg(longitude):.5f}")


def meters(value: float) -> str:
    """Format a distance."""
    return msg(f"{arg(value):.0f} m" if value < 10_000 else f"{arg(value / 1000):.0f} km")  # noqa: PLR2004 - from 10 km on in km


POOR_EPH_M = 50.0
"""gpsd computes it from geometry, about 19 m for HDOP 1 without corrections: this is HDOP 3. Not from the report."""
POOR_HDOP, NO_HDOP = 4.0, 20.0
"""From the second on, the position means nothing; many receivers report 99.99 if they have none."""
LEAST_SATELLITES = 3
"""Fewer satellites give no position, not even in two dimensions."""
FEWEST = 3
"""Fewer reports do not show whether they continue."""
BAD_SHARE, WORST_SHARE = 0.05, 0.5
"""Share of damaged lines: above the first, a bad cable or two talkers; from the second on, nothing is sure."""
CLOCK_S = 5.0
"""A receiver's time may differ from the computer's by this much: serial lines and drivers take a second or two."""
UNEVEN_S = 10.0
"""How much that difference may change while listening."""
BACK_S = 0.5
"""How far a time may go back: sentences of one epoch round it differently."""
ROLLOVER_S = 1024 * 7 * 86_400
"""GPS counts weeks in ten bits: an old receiver is wrong by a multiple of this (IS-GPS-200)."""
ZONE_S = 900
"""Time zones differ by multiples of a quarter of an hour."""
STANDS_S = 1.5
"""gpsd and NMEA report one position several times within a second; after this time it has stopped."""
NULL_DEGREES = 1e-4
"""About ten metres around latitude 0, longitude 0."""
JUMP_M = 25.0
SPEED_M_S = 15.0
"""Additional distance that is allowed per second: a vessel in tow, a UAV that is carried by car."""
MOVES_M_S, MOVES_S = 1.0, 2.0
"""A receiver that moves at this speed for so long is somewhere else."""
RIVAL_M = 100.0
"""Largest distance between two receivers of one vehicle."""

_Positions = list[tuple[float, float]]


def judge(reception: record.Reception, expectation: record.GpsExpectation) -> tuple[LinkFinding, ...]:
    """Return all findings; for a source without problems, a single one that passes."""
    silent = record.speechless(reception, expectation)
    if silent is not None:
        return (silent,)
    findings = tuple(_find_problems(reception, expectation))
    return findings or (_good_finding(reception, expectation),)


def _find_problems(reception: record.Reception, expectation: record.GpsExpectation) -> Iterator[LinkFinding]:
    yield from _fix_findings(reception, expectation)
    if reception.fixes:
        yield from _dimensions(reception, expectation)
        yield from _check_position(reception, expectation)
        yield from _check_time(reception, expectation)
        yield from _nature(reception, expectation)
        yield from _quality(reception, expectation)
    total = reception.good + reception.bad
    if reception.bad > 1 and reception.bad > BAD_SHARE * total:
        message = msg(f"{arg(reception.bad)} of {arg(total)} lines from {arg(expectation.end)} are corrupt")
        verdict = Verdict.FAIL if reception.bad > WORST_SHARE * total else Verdict.WARN
        hint = "check the cable, the baud rate, and whether a second device sends on the line"
        yield LinkFinding(verdict, "damaged", message, hint)


def _fix_findings(reception: record.Reception, expectation: record.GpsExpectation) -> Iterator[LinkFinding]:
    """Yield findings about whether there is a fix, and whether it persists."""
    sky = Verdict.FAIL if expectation.clear_sky else Verdict.INCONCLUSIVE
    roof = "" if expectation.clear_sky else ", and the antenna may be under a roof (`clear_sky: false`)"
    count, required_count = len(reception.fixes), expectation.reports
    if not any(report.has_fix for report in reception.reports):
        message = msg(f"the receiver of {arg(expectation.name)} works but has no fix{arg(roof)}")
        yield LinkFinding(
            sky, "no-fix", message, "bring the antenna under an open sky and wait a minute; then check its cable"
        )
    elif not count or (reception.losses and count < required_count):
        message = msg(f"the receiver of {arg(expectation.name)} lost its fix during the check{arg(roof)}")
        yield LinkFinding(
            sky, "fix-lost", message, "check for obstructions over the antenna, its cable, and jammers nearby"
        )
    elif reception.losses:
        message = msg(
            f"{arg(expectation.name)} lost its fix and regained it during the check, "
            f"{arg(_times_text(reception.losses))}"
        )
        yield LinkFinding(
            Verdict.WARN, "fix-unsteady", message, "check for obstructions over the antenna, and its cable"
        )
    elif count < required_count and not reception.single and _check_stall(reception, expectation) is None:
        message = msg(f"received {arg(count)} of {arg(required_count)} positions in {arg(reception.ended_s):.0f} s")
        hint = "set the receiver to report once a second, or repeat this item"
        few = count < min(FEWEST, required_count)
        yield LinkFinding(Verdict.INCONCLUSIVE if few else Verdict.WARN, "few-reports", message, hint)


def _times_text(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def _dimensions(reception: record.Reception, expectation: record.GpsExpectation) -> Iterator[LinkFinding]:
    if expectation.three and reception.fixes[-1].mode == 2:  # noqa: PLR2004 - 2D
        message = msg(f"{arg(expectation.name)} flies and has only a 2D fix: its height is not measured")
        yield LinkFinding(Verdict.FAIL, "fix-2d", message, "wait under an open sky for a 3D fix")


def _check_position(reception: record.Reception, expectation: record.GpsExpectation) -> Iterator[LinkFinding]:
    """Judge the positions of the fixes; an impossible one yields a single finding."""
    impossible = [report for report in reception.fixes if not report.possible]
    if impossible:
        where = place(impossible[0].latitude, impossible[0].longitude)
        message = msg(
            f"the receiver of {arg(expectation.name)} reports a fix at {arg(where)}, which is not a valid position"
        )
        yield LinkFinding(Verdict.FAIL, "position-impossible", message, "restart the receiver and its driver")
        return
    positions = [_position(fix) for fix in reception.fixes]
    if any(abs(latitude) < NULL_DEGREES and abs(longitude) < NULL_DEGREES for latitude, longitude in positions):
        message = msg(f"the position of {arg(expectation.name)} is 0, 0: its driver reports zeros for missing values")
        yield LinkFinding(
            Verdict.FAIL, "position-null", message, "restart the driver; it must not report a fix without a position"
        )
        return
    yield from _jumps(reception.fixes, positions, expectation)
    yield from _frozen(reception.fixes, positions, expectation)
    yield from _rivals(reception, positions[-1], expectation)
    if expectation.fence is not None:
        yield from _outside(positions, expectation.fence, expectation)
    else:
        message = msg(
            f"{arg(expectation.name)} is at {arg(place(*positions[-1]))}; the inventory does not say where it should be"
        )
        yield LinkFinding(Verdict.WARN, "no-geofence", message, "set `checklist.geofence` of the site")


def _position(report: record.Report) -> tuple[float, float]:
    return report.latitude or 0.0, report.longitude or 0.0


def _jumps(
    fixes: Sequence[record.Report], positions: _Positions, expectation: record.GpsExpectation
) -> Iterator[LinkFinding]:
    gaps = (then.at_s - report.at_s for report, then in pairwise(fixes))
    steps = [(distance_m(*item, *then), gap) for (item, then), gap in zip(pairwise(positions), gaps, strict=True)]
    wide = [step_m for step_m, gap in steps if step_m > JUMP_M + SPEED_M_S * gap]
    if wide:
        message = msg(f"the position of {arg(expectation.name)} jumps by {arg(meters(max(wide)))} between two reports")
        yield LinkFinding(
            Verdict.FAIL,
            "position-jumps",
            message,
            "move the antenna away from walls and the water's edge, or wait for more satellites",
        )


def _frozen(
    fixes: Sequence[record.Report], positions: _Positions, expectation: record.GpsExpectation
) -> Iterator[LinkFinding]:
    """Yield a finding for a driver that repeats a position while time and speed change."""
    speeds = [fix.speed_m_s for fix in fixes]
    lasted_s = fixes[-1].at_s - fixes[0].at_s
    if lasted_s < MOVES_S or len(set(positions)) > 1 or any(item is None or item < MOVES_M_S for item in speeds):
        return
    speed = min(entry for entry in speeds if entry is not None)
    message = msg(f"the position of {arg(expectation.name)} does not change while its speed is {arg(speed):.1f} m/s")
    yield LinkFinding(Verdict.FAIL, "position-frozen", message, "restart the driver: it repeats an old position")


def _rivals(
    reception: record.Reception, position: tuple[float, float], expectation: record.GpsExpectation
) -> Iterator[LinkFinding]:
    """Yield a finding if another receiver at the same endpoint reports a different position."""
    apart = [distance_m(*position, *_position(rival)) for rival in reception.rivals if rival.possible]
    if apart and max(apart) > RIVAL_M:
        message = msg(
            f"two positions come from {arg(expectation.end)}, {arg(meters(max(apart)))} apart; which one is "
            f"{arg(expectation.name)}'s is unknown"
        )
        hint = "give each receiver its own port, and put the one that the vehicle uses in the inventory"
        yield LinkFinding(Verdict.INCONCLUSIVE, "positions-differ", message, hint)


def _outside(positions: _Positions, fence: Geofence, expectation: record.GpsExpectation) -> Iterator[LinkFinding]:
    outside = [position for position in positions if from_middle_m(fence, *position) > fence.radius_m]
    if not outside:
        return
    far = max(outside, key=lambda item: from_middle_m(fence, *item))
    if all(_is_inside(fence, longitude, latitude) for latitude, longitude in outside):
        text = msg(f"{arg(place(*far))} is inside the geofence with latitude and longitude swapped")
        message = msg(f"latitude and longitude of {arg(expectation.name)} are swapped: {arg(text)}")
        hint = "fix the driver or the converter that swaps them: latitude comes first, west longitudes are negative"
        yield LinkFinding(Verdict.FAIL, "position-swapped", message, hint)
        return
    away = meters(from_middle_m(fence, *far))
    message = msg(
        f"{arg(expectation.name)} is at {arg(place(*far))}, {arg(away)} from the centre of the geofence of "
        f"{arg(meters(fence.radius_m))}"
    )
    yield LinkFinding(Verdict.FAIL, "outside-geofence", message, _sign_hint(fence, *far))


def _is_inside(fence: Geofence, latitude: float, longitude: float) -> bool:
    return abs(latitude) <= 90 and from_middle_m(fence, latitude, longitude) <= fence.radius_m  # noqa: PLR2004 - the poles


def _sign_hint(fence: Geofence, latitude: float, longitude: float) -> str:
    if _is_inside(fence, latitude, -longitude):
        return "the sign of the longitude is missing: west is negative; fix the driver or the converter"
    if _is_inside(fence, -latitude, longitude):
        return "the sign of the latitude is missing: south is negative; fix the driver or the converter"
    return "compare it with the map: either the receiver or `checklist.geofence` of the site is wrong"


def _check_time(reception: record.Reception, expectation: record.GpsExpectation) -> Iterator[LinkFinding]:
    """Judge whether the fixes are current; a stalled position yields a single finding, without a clock check."""
    stale = _check_stall(reception, expectation)
    if stale is not None:
        yield stale
        return
    if all(item.time is None for item in reception.fixes):
        hint = "configure the receiver to send RMC or ZDA as well"
        if all(fix.of_day is None for fix in reception.fixes):
            message = msg(f"the positions of {arg(expectation.name)} have no time: they may be old")
            yield LinkFinding(Verdict.INCONCLUSIVE, "no-time", message, hint)
        else:
            message = msg(f"the positions of {arg(expectation.name)} have a time but no date: GGA and GLL have none")
            yield LinkFinding(Verdict.WARN, "no-date", message, hint)
    back_s = max((_backward_step_s(report, then) for report, then in pairwise(reception.fixes)), default=0.0)
    if back_s > BACK_S:
        message = msg(
            f"the time of {arg(expectation.name)} goes back by {arg(_format_duration(back_s))} between two positions"
        )
        hint = "check whether two receivers send on this line, or a recorded log is replayed in a loop"
        yield LinkFinding(Verdict.FAIL, "time-goes-back", message, hint)
        return
    yield from _clock(reception, expectation)


def _backward_step_s(report: record.Report, then: record.Report) -> float:
    if report.time is not None and then.time is not None:
        return report.time - then.time
    if report.of_day is not None and then.of_day is not None:
        return record.at_day(report.of_day - then.of_day)
    return 0.0


def _check_stall(reception: record.Reception, expectation: record.GpsExpectation) -> LinkFinding | None:
    """Return a finding if the last fix is old: no more arrived, or the same is repeated."""
    fixes = reception.fixes
    gaps = [then.at_s - report.at_s for report, then in pairwise(fixes)]
    age_s = reception.ended_s - fixes[-1].at_s
    # Whoever reports rarely is late between two reports, and is told that it is slow.
    if age_s > expectation.max_age_s and age_s > 1.5 * max(gaps, default=0.0):
        message = msg(f"the last position of {arg(expectation.name)} is {arg(age_s):.0f} s old: none came after it")
        return LinkFinding(
            Verdict.FAIL, "fix-stale", message, "check whether the receiver and its driver are still running"
        )
    first = len(fixes) - 1
    while first and fixes[first - 1].stamp == fixes[-1].stamp is not None:
        first -= 1
    repeats = len(fixes) - first
    if repeats < min(3, expectation.reports):
        return None
    if repeats >= expectation.reports or fixes[-1].at_s - fixes[first].at_s > STANDS_S:
        message = msg(f"the receiver of {arg(expectation.name)} repeats one position: its time does not advance")
        return LinkFinding(
            Verdict.FAIL, "fix-stale", message, "restart the receiver; its driver repeats the last value"
        )
    return None


def _clock(reception: record.Reception, expectation: record.GpsExpectation) -> Iterator[LinkFinding]:
    """Compare the receiver's time with the listening clock: an old time fails, other differences only warn."""
    ahead_s, uneven_s = reception.clock_ahead_s, reception.clock_uneven_s
    whose = clock_of(reception, expectation)
    if ahead_s is None:
        if any(fix.stamp is not None for fix in reception.fixes):
            message = msg(f"the time of the receiver of {arg(expectation.name)} was not compared with a clock")
            yield LinkFinding(Verdict.INCONCLUSIVE, "clock-unknown", message, "repeat this item")
        return
    if uneven_s > UNEVEN_S:
        message = msg(
            f"the time of {arg(expectation.name)} drifts from the clock of {arg(whose)}: by "
            f"{arg(_format_duration(uneven_s))}"
        )
        hint = "check whether a recorded log is replayed at this endpoint at another speed"
        yield LinkFinding(Verdict.FAIL, "time-uneven", message, hint)
        return
    if abs(ahead_s) <= CLOCK_S or (reception.zone_s and abs(ahead_s - reception.zone_s) <= CLOCK_S):
        return
    message = msg(f"{arg(expectation.name)}'s receiver is {arg(clock_words(ahead_s))} the clock of {arg(whose)}")
    verdict = Verdict.FAIL if ahead_s < 0 else Verdict.INCONCLUSIVE
    hint = msg(
        f"find out which of the two is wrong: compare both with a third clock, and {arg(whose)} with its time server"
    )
    if _is_multiple(ahead_s, ROLLOVER_S):
        verdict = Verdict.INCONCLUSIVE
        hint = (
            "after a week-number rollover its positions are still right: compare one with the map, override this "
            "item with that reason, and update the firmware"
        )
    elif _is_zone_offset(ahead_s):
        verdict = Verdict.INCONCLUSIVE
        hint = "one of them is set to a time zone (receivers and computers use UTC here), or an old log is replayed"
    elif abs(ahead_s) > record.DAY_S:
        hint = msg(
            f"check whether a recorded log is replayed to its port; otherwise compare {arg(whose)} with a third clock"
        )
    yield LinkFinding(verdict, "clock-differs", message, hint)


def clock_of(reception: record.Reception, expectation: record.GpsExpectation) -> str:
    """Return the clock used for comparison: for a router, the time of its response on this computer."""
    return "this computer" if reception.single else expectation.place


def _is_zone_offset(ahead_s: float) -> bool:
    return abs(ahead_s) <= 14 * 3600 + CLOCK_S and _is_multiple(ahead_s, ZONE_S)


def _is_multiple(value: float, of: float) -> bool:
    return round(value / of) != 0 and abs(value - of * round(value / of)) <= CLOCK_S


def _format_duration(seconds: float) -> str:
    for unit_s, unit in ((86_400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2 * unit_s:
            return f"{seconds / unit_s:.0f} {unit}"
    return f"{seconds:.1f} s"


def clock_words(ahead_s: float) -> str:
    """Format a clock difference: `3.2 s behind`, `2 h ahead of`."""
    return msg(f"{arg(_format_duration(abs(ahead_s)))} {'behind' if ahead_s < 0 else 'ahead of'}")


def _nature(reception: record.Reception, expectation: record.GpsExpectation) -> Iterator[LinkFinding]:
    """Yield a finding if any position was not measured but, for example, dead-reckoned or simulated."""
    natures = {fix.nature for fix in reception.fixes}
    nature = next((item for item in _NATURES if item in natures), None)
    if nature is not None:
        verdict, hint = _NATURES[nature]
        code = f"position-{nature.name.lower().replace('_', '-')}"
        yield LinkFinding(
            verdict, code, msg(f"the position of {arg(expectation.name)} is {arg(nature)}, not measured"), hint
        )
        return
    count = reception.satellites
    if count is not None and count < LEAST_SATELLITES:
        message = msg(
            f"the receiver of {arg(expectation.name)} reports a fix from {arg(count)} satellites: at least "
            f"{arg(LEAST_SATELLITES)} are needed"
        )
        hint = "find out where the position comes from: a simulator, a fixed position, or a driver that fills it in"
        # gpsd counts by numbers that some receivers give otherwise in GSA than in GSV (geos-1m of its own logs).
        verdict = Verdict.WARN if expectation.driver is GpsDriver.GPSD else Verdict.FAIL
        yield LinkFinding(verdict, "no-satellites", message, hint)


_NATURES = {
    record.Nature.SIMULATED: (Verdict.FAIL, "stop the simulator or the log replay that feeds the receiver's port"),
    record.Nature.MANUAL: (
        Verdict.INCONCLUSIVE,
        "disable the receiver's fixed-position mode; for a surveyed mast, override this item with that reason",
    ),
    record.Nature.DEAD_RECKONING: (Verdict.WARN, "bring the antenna under an open sky: satellites are not in use now"),
}
"""Nature of a position -> verdict and hint, worst first."""


def _quality(reception: record.Reception, expectation: record.GpsExpectation) -> Iterator[LinkFinding]:
    eph_m, hdop = reception.fixes[-1].eph_m, reception.hdop
    hint = "wait for more satellites, or clear the view of the antenna"
    # Written so that what is no number is poor, too.
    if eph_m is not None and not 0 <= eph_m <= POOR_EPH_M:
        nothing = expectation.fence is not None and not 0 <= eph_m <= expectation.fence.radius_m
        message = msg(
            f"the position of {arg(expectation.name)} is uncertain: the receiver estimates an error of "
            f"{arg(meters(eph_m))}"
        )
        yield LinkFinding(Verdict.INCONCLUSIVE if nothing else Verdict.WARN, "position-uncertain", message, hint)
    elif hdop is not None and not 0 <= hdop <= POOR_HDOP:
        message = msg(f"{arg(expectation.name)} has a poor satellite geometry: HDOP {arg(hdop):.1f}")
        verdict = Verdict.WARN if 0 <= hdop <= NO_HDOP else Verdict.INCONCLUSIVE
        yield LinkFinding(verdict, "position-uncertain", message, hint)


def _good_finding(reception: record.Reception, expectation: record.GpsExpectation) -> LinkFinding:
    last = reception.fixes[-1]
    count = msg("" if reception.satellites is None else f" from {arg(reception.satellites)} satellites")
    where = place(last.latitude, last.longitude)
    if expectation.fence is not None and last.latitude is not None and last.longitude is not None:
        where += msg(
            f", {arg(meters(from_middle_m(expectation.fence, last.latitude, last.longitude)))} from the centre of "
            "the geofence"
        )
    return LinkFinding(
        Verdict.PASS, "fix", msg(f"{arg(expectation.name)} has a {arg(last.mode)}D fix{arg(count)} at {arg(where)}")
    )


_READ, _MEASUREMENT, _INVENTORY = EvidenceType.READ, EvidenceType.MEASURED, EvidenceType.DECLARED


def evidence(reception: record.Reception, expectation: record.GpsExpectation) -> tuple[Evidence, ...]:
    """Return source, position, fix, age, clock, number of reports, and the geofence."""
    version = f" {reception.version}" if reception.version else ""
    device = msg(f", {arg(reception.device)}" if reception.device else "")
    source = expectation.source.replace("gpsd", f"gpsd{version}", 1) + device
    items = [Evidence(type=_READ, what="source", value=source)]
    if reception.others:
        items.append(Evidence(type=_READ, what="other receivers, ignored", value=join(", ", reception.others)))
    items += [
        Evidence(type=_READ, what="error reported by the source", value=words) for words in reception.complaints[:3]
    ]
    if reception.reports:
        items += _reception_evidence(reception, expectation)
    return tuple(items)


def _reception_evidence(reception: record.Reception, expectation: record.GpsExpectation) -> Iterator[Evidence]:
    last = reception.fixes[-1] if reception.fixes else reception.reports[-1]
    if last.has_fix:
        yield Evidence(type=_READ, what="position", value=place(last.latitude, last.longitude))
    yield Evidence(type=_READ, what="fix", value=_fix(last, reception))
    if last.has_fix:
        yield Evidence(
            type=_MEASUREMENT, what="age of the last position", value=f"{reception.ended_s - last.at_s:.1f} s"
        )
    ahead_s = reception.clock_ahead_s
    if ahead_s is not None:
        value = msg(f"{arg(clock_words(ahead_s))} the clock of {arg(clock_of(reception, expectation))}")
        yield Evidence(type=_MEASUREMENT, what="receiver time", value=value)
    yield Evidence(type=_MEASUREMENT, what="reports", value=_count(reception))
    yield Evidence(type=_INVENTORY, what="geofence", value=_fence(last, expectation))


def _fix(last: record.Report, reception: record.Reception) -> str:
    words = [f"{last.mode}D" if last.has_fix else "none"]
    if reception.satellites is not None:
        words.append(msg(f"{arg(reception.satellites)} satellites"))
    if reception.hdop is not None:
        words.append(f"HDOP {reception.hdop:.1f}")
    return join(", ", words)


def _count(reception: record.Reception) -> str:
    if reception.single:
        return "1: a RouterOS device reports only its latest position"
    total, text = len(reception.reports), msg(f"in {arg(reception.ended_s):.0f} s")
    return msg(f"{arg(len(reception.fixes))} fixes in a row at the end of {arg(total)} reports {arg(text)}")


def _fence(last: record.Report, expectation: record.GpsExpectation) -> str:
    fence = expectation.fence
    if fence is None:
        return "none in the inventory"
    words = msg(f"{arg(place(fence.latitude, fence.longitude))}, radius {arg(meters(fence.radius_m))}")
    if last.has_fix and last.possible and last.latitude is not None and last.longitude is not None:
        words += msg(
            f"; the position is {arg(meters(from_middle_m(fence, last.latitude, last.longitude)))} from its centre"
        )
    return words
