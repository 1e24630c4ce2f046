"""Whether positions are good enough to begin a test: there, fresh, in the right place, with the right time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.probes.gps._place import misplaced
from atlantis_netcfg.probes.gps._time import mistimed, stalled
from atlantis_netcfg.probes.gps.earth import from_middle_m, meters, place
from atlantis_netcfg.probes.gps.record import Nature
from atlantis_netcfg.probes.gps.silence import speechless
from atlantis_netcfg.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.probes.gps.record import Reception
    from atlantis_netcfg.probes.gps.wanted import Wanted

__all__ = ["judge"]

POOR_EPH_M = 50.0
"""gpsd makes it of the geometry, about 19 m for HDOP 1 without corrections: this is HDOP 3. Ours, not the report's."""
POOR_HDOP = 4.0
BAD_SHARE = 0.05
"""More sentences than this with a wrong checksum: a bad cable, or two talkers on one line."""


def judge(reception: Reception, wanted: Wanted) -> tuple[Finding, ...]:
    """Give all findings; a source that is well in every respect has one, which passes."""
    silent = speechless(reception, wanted)
    if silent is not None:
        return (silent,)
    found = tuple(_found(reception, wanted))
    return found or (_well(reception, wanted),)


def _found(reception: Reception, wanted: Wanted) -> Iterator[Finding]:
    yield from _held(reception, wanted)
    if reception.fixes:
        yield from _dimensions(reception, wanted)
        yield from misplaced(reception, wanted)
        yield from mistimed(reception, wanted)
        yield from _quality(reception, wanted)
    total = reception.good + reception.bad
    if reception.bad > 1 and reception.bad > BAD_SHARE * total:
        message = f"{reception.bad} of {total} lines from {wanted.end} are damaged"
        yield Finding(
            Verdict.WARN, "damaged", message, "look at the cable, the baud rate, and for a second talker on the line"
        )


def _held(reception: Reception, wanted: Wanted) -> Iterator[Finding]:
    """Whether there is a fix, and whether it stays."""
    sky = Verdict.FAIL if wanted.clear_sky else Verdict.INCONCLUSIVE
    roof = "" if wanted.clear_sky else ", and the antenna may be under a roof (`clear_sky: false`)"
    count, needed = len(reception.fixes), wanted.reports
    if not any(report.fixed for report in reception.reports):
        message = f"{wanted.name}'s receiver works and has no fix{roof}"
        yield Finding(
            sky, "no-fix", message, "bring the antenna under an open sky and wait a minute; then look at its cable"
        )
    elif not count or (reception.losses and count < needed):
        message = f"{wanted.name}'s receiver had a fix and lost it while we listened{roof}"
        yield Finding(
            sky, "fix-lost", message, "look at what stands over the antenna, at its cable, and for jammers near it"
        )
    elif reception.losses:
        message = f"{wanted.name}'s fix was lost and came back while we listened, {_times(reception.losses)}"
        yield Finding(Verdict.WARN, "fix-unsteady", message, "look at what stands over the antenna, and at its cable")
    elif count < needed and not reception.single and stalled(reception, wanted) is None:
        message = f"{count} of {needed} positions came in {reception.ended_s:.0f} s"
        yield Finding(
            Verdict.WARN, "few-reports", message, "let the receiver report once a second, or repeat this item"
        )


def _times(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def _dimensions(reception: Reception, wanted: Wanted) -> Iterator[Finding]:
    if wanted.three and reception.fixes[-1].mode == 2:  # noqa: PLR2004 - 2D
        message = f"{wanted.name} has a 2D fix and flies: its height is not measured"
        yield Finding(Verdict.FAIL, "fix-2d", message, "wait under an open sky until the fix has three dimensions")


def _quality(reception: Reception, wanted: Wanted) -> Iterator[Finding]:
    nature, eph_m, hdop = reception.fixes[-1].nature, reception.fixes[-1].eph_m, reception.hdop
    if nature is not Nature.MEASURED:
        code = f"position-{nature.name.lower().replace('_', '-')}"
        message = f"{wanted.name}'s position is {nature}, not measured"
        yield Finding(Verdict.WARN, code, message, _NATURES[nature])
    if eph_m is not None and eph_m > POOR_EPH_M:
        message = f"{wanted.name}'s position is uncertain: the receiver's estimate is {eph_m:.0f} m"
        yield Finding(
            Verdict.WARN, "position-uncertain", message, "wait for more satellites, or clear the antenna's view"
        )
    elif hdop is not None and hdop > POOR_HDOP:
        message = f"{wanted.name}'s satellites stand badly: HDOP {hdop:.1f}"
        yield Finding(
            Verdict.WARN, "position-uncertain", message, "wait for more satellites, or clear the antenna's view"
        )


_NATURES = {
    Nature.DEAD_RECKONING: "bring the antenna under an open sky: satellites are not used now",
    Nature.MANUAL: "take the receiver out of its fixed-position mode",
    Nature.SIMULATED: "stop the simulator, or the replayed log, that feeds the receiver's port",
}


def _well(reception: Reception, wanted: Wanted) -> Finding:
    last = reception.fixes[-1]
    count = "" if reception.satellites is None else f" of {reception.satellites} satellites"
    where = place(last.latitude, last.longitude)
    if wanted.fence is not None and last.latitude is not None and last.longitude is not None:
        where += (
            f", {meters(from_middle_m(wanted.fence, last.latitude, last.longitude))} from the middle of the geofence"
        )
    return Finding(Verdict.PASS, "fix", f"{wanted.name} has a {last.mode}D fix{count} at {where}")
