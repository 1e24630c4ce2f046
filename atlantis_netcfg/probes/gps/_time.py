"""Whether positions are of now: their age, whether their time goes on, and whether it agrees with the clock."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.probes.gps.record import DAY_S
from atlantis_netcfg.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.probes.gps.record import Reception
    from atlantis_netcfg.probes.gps.wanted import Wanted

__all__ = ["clock_words", "mistimed", "stalled"]

CLOCK_S = 5.0
"""A receiver's time may differ from the computer's by this much: serial lines and drivers take a second or two."""
ROLLOVER_S = 1024 * 7 * 86_400
"""GPS counts weeks in ten bits: an old receiver is wrong by a multiple of this (IS-GPS-200)."""
ZONE_S = 900
"""Time zones differ by multiples of a quarter of an hour."""
STANDS_S = 1.5
"""gpsd and NMEA tell one position several times within a second; longer than this, its time stands still."""


def mistimed(reception: Reception, wanted: Wanted) -> Iterator[Finding]:
    """Judge the fixes; a position that is not of now says so, and nothing of the clock."""
    stale = stalled(reception, wanted)
    if stale is not None:
        yield stale
        return
    if all(one.time is None for one in reception.fixes):
        if reception.fixes[-1].of_day is not None:
            message = f"{wanted.name}'s positions have a time and no date: GGA alone has none"
            yield Finding(Verdict.WARN, "no-date", message, "let the receiver send RMC or ZDA as well")
        else:
            message = f"{wanted.name}'s positions have no time"
            yield Finding(Verdict.WARN, "no-time", message, "let the receiver send RMC or ZDA as well")
    yield from _clock(reception, wanted)


def stalled(reception: Reception, wanted: Wanted) -> Finding | None:
    """Say that the last fix is old, because no more came or the same is told again and again."""
    fixes = reception.fixes
    gaps = [then.at_s - one.at_s for one, then in pairwise(fixes)]
    age_s = reception.ended_s - fixes[-1].at_s
    # Whoever reports rarely is late between two reports, and is told that it is slow.
    if age_s > wanted.max_age_s and age_s > 1.5 * max(gaps, default=0.0):
        message = f"{wanted.name}'s last position is {age_s:.0f} s old: no more came"
        return Finding(Verdict.FAIL, "fix-stale", message, "look whether the receiver and its driver still run")
    first = len(fixes) - 1
    while first and fixes[first - 1].stamp == fixes[-1].stamp is not None:
        first -= 1
    repeats = len(fixes) - first
    if repeats < min(3, wanted.reports):
        return None
    if repeats >= wanted.reports or fixes[-1].at_s - fixes[first].at_s > STANDS_S:
        message = f"{wanted.name}'s receiver tells the same position again and again: its time stands still"
        return Finding(Verdict.FAIL, "fix-stale", message, "restart the receiver; its driver repeats what it had last")
    return None


def _clock(reception: Reception, wanted: Wanted) -> Iterator[Finding]:
    ahead_s = reception.clock_ahead_s
    if ahead_s is None or abs(ahead_s) <= CLOCK_S:
        return
    if reception.single and _zone(ahead_s):
        # The manual of RouterOS does not say in which time zone it tells the receiver's time.
        return
    message = f"{wanted.name}'s receiver is {clock_words(ahead_s)} the clock of {wanted.place}"
    hint = f"see which of the two is wrong: compare both with a third clock, {wanted.place} with its time server"
    if _multiple(ahead_s, ROLLOVER_S):
        hint = (
            "the receiver's week number has rolled over: it needs newer firmware, its positions are right all the same"
        )
    elif abs(ahead_s) > DAY_S:
        hint = f"see whether a recorded log is replayed to its port; else compare {wanted.place} with a third clock"
    elif _zone(ahead_s):
        hint = "one of them runs in a time zone: receivers and computers keep UTC here"
    yield Finding(Verdict.WARN, "clock-differs", message, hint)


def _zone(ahead_s: float) -> bool:
    return abs(ahead_s) <= 14 * 3600 + CLOCK_S and _multiple(ahead_s, ZONE_S)


def _multiple(value: float, of: float) -> bool:
    return round(value / of) != 0 and abs(value - of * round(value / of)) <= CLOCK_S


def clock_words(ahead_s: float) -> str:
    """`3.2 s behind`, `2 h ahead of`."""
    size = abs(ahead_s)
    for unit_s, unit in ((86_400 * 2, "days"), (7200, "h"), (120, "min")):
        if size >= unit_s:
            told = f"{size / (86_400 if unit == 'days' else 3600 if unit == 'h' else 60):.0f} {unit}"
            break
    else:
        told = f"{size:.1f} s"
    return f"{told} {'behind' if ahead_s < 0 else 'ahead of'}"
