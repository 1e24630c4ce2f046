"""Whether channels change while the pilot moves the sticks."""

from __future__ import annotations

from statistics import correlation
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.rc_rf.judge import no_channels
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.checklist.probes.rc_rf.stream import Channels, Heard
    from atlantis_netcfg.checklist.probes.rc_rf.wanted import Wanted

__all__ = ["judge_moved", "ranges"]

MOVED_US = 100
"""More than noise and trims: a tenth of a stick's way."""
AXES = 4
"""Of two sticks."""
AS_ONE = 0.98
"""From this correlation on two channels are one movement; a hand does not hold two axes so well together."""
NEEDED = 3
"""Fewer sets of channels say nothing of a movement."""


def ranges(channels: Sequence[Channels]) -> dict[int, tuple[int, int]]:
    """Channel to the lowest and highest value, of those that moved."""
    found = {}
    for number in range(max((channel.count for channel in channels), default=0)):
        values = [item.values[number] for item in channels if number < item.count]
        known = [value for value in values if value is not None]
        if known and max(known) - min(known) >= MOVED_US:
            found[number + 1] = (min(known), max(known))
    return found


def judge_moved(received: Heard, expected: Wanted) -> Finding:
    """Judge a stream in which the vehicle is heard, disarmed."""
    channels = received.systems[expected.system_id].channels
    if not channels:
        return no_channels(received, expected)
    if len(channels) < NEEDED:
        message = f"{expected.name}'s channels came {len(channels)} times only while the sticks were moved"
        return Finding(
            Verdict.INCONCLUSIVE, "few-channels", message, "let its people send RC_CHANNELS four times a second"
        )
    moved = ranges(channels)
    if not moved:
        message = f"none of {expected.name}'s {channels[-1].count} channels moved while the pilot moved the sticks"
        hint = "is the transmitter on, and bound to this vehicle and no other? then repeat"
        return Finding(Verdict.FAIL, "no-movement", message, hint)
    listed = ", ".join(map(str, moved))
    axes = [number for number in moved if number <= AXES]
    if len(axes) < AXES:
        message = f"channels that moved: {listed}; two sticks have {AXES} axes"
        return Finding(Verdict.WARN, "few-moved", message, "repeat, and move both sticks over their whole way")
    if _as_one(channels, axes):
        message = (
            f"channels {', '.join(map(str, axes))} of {expected.name} move as one, which two sticks in circles do not"
        )
        hint = "is a joystick, or a program, at work in place of the remote control? Repeat, each stick in circles"
        return Finding(Verdict.INCONCLUSIVE, "lockstep", message, hint)
    return Finding(Verdict.PASS, "moved", f"{expected.name}'s channels follow the sticks: {listed}")


def _as_one(channels: Sequence[Channels], axes: Sequence[int]) -> bool:
    """Whether every axis follows the first, the same way or the other."""
    rows = [[channel.values[axis - 1] for axis in axes] for channel in channels if channel.count >= max(axes)]
    whole = [values for row in rows if len(values := tuple(item for item in row if item is not None)) == len(axes)]
    ways = [*zip(*whole, strict=True)] if len(whole) >= NEEDED else []
    if not ways or any(len({*way}) == 1 for way in ways):
        return True  # they were never seen to move beside each other
    first, *others = ways
    return all(abs(correlation(first, other)) >= AS_ONE for other in others)
