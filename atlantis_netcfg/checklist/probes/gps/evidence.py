"""What was seen of a receiver, for the report."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes.gps.geodesy import from_middle_m, meters, place
from atlantis_netcfg.checklist.probes.gps.judge import clock_of, clock_words
from atlantis_netcfg.checklist.report import Evidence, EvidenceType

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.checklist.probes.gps.record import Reception, Report, Wanted

__all__ = ["evidence"]

_READ, _MEASURED, _DECLARED = EvidenceType.READ, EvidenceType.MEASURED, EvidenceType.DECLARED


def evidence(reception: Reception, expected: Wanted) -> tuple[Evidence, ...]:
    """Give source, position, fix, age, clock, number of reports, and the geofence."""
    version = f" {reception.version}" if reception.version else ""
    device = f", {reception.device}" if reception.device else ""
    source = expected.source.replace("gpsd", f"gpsd{version}", 1) + device
    seen = [Evidence(type=_READ, what="source", value=source)]
    if reception.others:
        seen.append(Evidence(type=_READ, what="other receivers, left aside", value=", ".join(reception.others)))
    seen += [Evidence(type=_READ, what="complaint of the source", value=words) for words in reception.complaints[:3]]
    if reception.reports:
        seen += _heard(reception, expected)
    return tuple(seen)


def _heard(reception: Reception, expected: Wanted) -> Iterator[Evidence]:
    last = reception.fixes[-1] if reception.fixes else reception.reports[-1]
    if last.fixed:
        yield Evidence(type=_READ, what="position", value=place(last.latitude, last.longitude))
    yield Evidence(type=_READ, what="fix", value=_fix(last, reception))
    if last.fixed:
        yield Evidence(type=_MEASURED, what="age of the last position", value=f"{reception.ended_s - last.at_s:.1f} s")
    ahead_s = reception.clock_ahead_s
    if ahead_s is not None:
        value = f"{clock_words(ahead_s)} the clock of {clock_of(reception, expected)}"
        yield Evidence(type=_MEASURED, what="time of the receiver", value=value)
    yield Evidence(type=_MEASURED, what="reports", value=_count(reception))
    yield Evidence(type=_DECLARED, what="geofence", value=_fence(last, expected))


def _fix(last: Report, reception: Reception) -> str:
    words = [f"{last.mode}D" if last.fixed else "none"]
    if reception.satellites is not None:
        words.append(f"{reception.satellites} satellites")
    if reception.hdop is not None:
        words.append(f"HDOP {reception.hdop:.1f}")
    return ", ".join(words)


def _count(reception: Reception) -> str:
    if reception.single:
        return "1: a RouterOS device tells its latest position only"
    total, text = len(reception.reports), f"in {reception.ended_s:.0f} s"
    return f"{len(reception.fixes)} fixes in a row at the end of {total} reports {text}"


def _fence(last: Report, expected: Wanted) -> str:
    fence = expected.fence
    if fence is None:
        return "none is declared"
    words = f"{place(fence.latitude, fence.longitude)}, {meters(fence.radius_m)} around"
    if last.fixed and last.possible and last.latitude is not None and last.longitude is not None:
        words += f"; the position is {meters(from_middle_m(fence, last.latitude, last.longitude))} from its middle"
    return words
