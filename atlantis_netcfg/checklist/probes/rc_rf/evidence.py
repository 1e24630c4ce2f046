"""What was seen of a stream, for the report."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes.rc_rf.stick_movement import ranges
from atlantis_netcfg.checklist.probes.rc_rf.stream import RSSI_UNKNOWN, System
from atlantis_netcfg.checklist.report import Evidence, EvidenceType

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.checklist.probes.rc_rf.stream import Heard
    from atlantis_netcfg.checklist.probes.rc_rf.wanted import Wanted

__all__ = ["evidence", "movement"]

_READ, _MEASURED = EvidenceType.READ, EvidenceType.MEASURED


def evidence(received: Heard, expected: Wanted) -> tuple[Evidence, ...]:
    """Give the stream, the systems in it, and what the expected one says."""
    return tuple(_seen(received, expected)) if received.heard_bytes else ()


def _seen(received: Heard, expected: Wanted) -> Iterator[Evidence]:
    versions = " and ".join(map(str, received.versions)) or "of no known version"
    stream = f"MAVLink {versions}, {received.good} frames and {received.bad} damaged pieces in {received.ended_s:.0f} s"
    yield Evidence(type=_MEASURED, what=f"stream at {expected.end}", value=stream)
    listed = ", ".join(map(str, received.autopilots)) or "none"
    yield Evidence(type=_READ, what="system ids with an autopilot", value=listed)
    system = received.systems.get(expected.system_id, System())
    if any(system.senders):
        yield Evidence(type=_MEASURED, what="its stream comes from", value=", ".join(system.senders))
    if system.beats:
        state = "armed" if any(beat.armed for beat in system.beats) else "disarmed"
        yield Evidence(type=_READ, what="autopilot", value=f"{state}, {len(system.beats)} heartbeats")
    if system.channels:
        last = system.channels[-1]
        yield Evidence(type=_READ, what="channels", value=f"{last.count}, {_values(last.values)}")
        yield Evidence(type=_READ, what="rssi", value=_rssi([channel.rssi for channel in system.channels]))
    if system.receiver:
        receiver = system.receiver[-1]
        words = (("present", receiver.present), ("enabled", receiver.enabled), ("healthy", receiver.healthy))
        text = ", ".join(word if holds else f"not {word}" for word, holds in words)
        yield Evidence(type=_READ, what="receiver", value=text)


def movement(received: Heard, expected: Wanted) -> Iterator[Evidence]:
    """Give the way of each channel that moved."""
    for number, (low, high) in ranges(received.systems.get(expected.system_id, System()).channels).items():
        yield Evidence(type=_MEASURED, what=f"channel {number}", value=f"{low} to {high} us")


def _values(values: tuple[int | None, ...]) -> str:
    return " ".join("-" if value is None else str(value) for value in values) or "no values"


def _rssi(result: list[int]) -> str:
    known = [rssi for rssi in result if rssi != RSSI_UNKNOWN]
    if not known:
        return "not known (255)"
    return f"{min(known)} to {max(known)} in a scale of its own"
