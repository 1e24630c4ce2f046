"""RC RF: whether a pilot's remote control reaches the vehicle.

If the autopilot uses MAVLink, the probes listen to its stream and never send: the heartbeat of the expected system,
channels that arrive and, when the pilot is asked to move the sticks, change; an armed vehicle ends the probe at once.
What no stream shows (failsafe works, range is sufficient) a person tests, for every vehicle.

docs/engineers/probes.md describes how it could be deceived, and what prevents that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist import report
from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.checklist.probes.rc_rf.judge import (
    RcExpectation,
    check_disarmed,
    doubts,
    judge,
    judge_moved,
    ranges,
    unusable,
)
from atlantis_netcfg.checklist.probes.rc_rf.stream import RSSI_UNKNOWN, Stream, System, enough, read
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, conjunction, join, msg

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from atlantis_netcfg.inventory.model import RcRfEndpoint
    from atlantis_netcfg.links import LinkFinding

__all__ = ["RcExpectation", "RcHeard", "StickMovementProbe", "steps"]


_READ, _MEASUREMENT = report.EvidenceType.READ, report.EvidenceType.MEASURED


def evidence(stream: Stream, expectation: RcExpectation) -> tuple[report.Evidence, ...]:
    """Return the stream, the systems in it, and the data of the expected system."""
    return tuple(_find_evidence(stream, expectation)) if stream.heard_bytes else ()


def _find_evidence(source: Stream, expectation: RcExpectation) -> Iterator[report.Evidence]:
    versions = conjunction(source.versions) or "of unknown version"
    stream = msg(
        f"MAVLink {arg(versions)}, {arg(source.good)} frames and {arg(source.bad)} corrupted pieces in "
        f"{arg(source.ended_s):.0f} s"
    )
    yield report.Evidence(type=_MEASUREMENT, what=msg(f"stream at {arg(expectation.end)}"), value=stream)
    autopilots = join(", ", map(str, source.autopilots)) or "none"
    yield report.Evidence(type=_READ, what="system ids with an autopilot", value=autopilots)
    system = source.systems.get(expectation.system_id, System())
    if any(system.senders):
        yield report.Evidence(type=_MEASUREMENT, what="source of its stream", value=join(", ", system.senders))
    if system.beats:
        state = "armed" if any(beat.is_armed for beat in system.beats) else "disarmed"
        yield report.Evidence(
            type=_READ, what="autopilot", value=msg(f"{arg(state)}, {arg(len(system.beats))} heartbeats")
        )
    if system.channels:
        last = system.channels[-1]
        yield report.Evidence(type=_READ, what="channels", value=msg(f"{arg(last.count)}, {arg(_values(last.values))}"))
        yield report.Evidence(
            type=_READ, what="rssi", value=_describe_rssi([channel.rssi for channel in system.channels])
        )
    if system.receiver:
        receiver = system.receiver[-1]
        words = (("present", receiver.present), ("enabled", receiver.is_enabled), ("healthy", receiver.healthy))
        text = join(", ", (word if holds else msg(f"not {arg(word)}") for word, holds in words))
        yield report.Evidence(type=_READ, what="receiver", value=text)


def movement(stream: Stream, expectation: RcExpectation) -> Iterator[report.Evidence]:
    """Yield the range of each channel that moved."""
    for number, (low, high) in ranges(stream.systems.get(expectation.system_id, System()).channels).items():
        yield report.Evidence(
            type=_MEASUREMENT, what=msg(f"channel {arg(number)}"), value=msg(f"{arg(low)} to {arg(high)} us")
        )


def _values(values: tuple[int | None, ...]) -> str:
    return " ".join("-" if value is None else str(value) for value in values) or "no values"


def _describe_rssi(result: list[int]) -> str:
    known_rssi = [rssi for rssi in result if rssi != RSSI_UNKNOWN]
    if not known_rssi:
        return "unknown (255)"
    return msg(f"{arg(min(known_rssi))} to {arg(max(known_rssi))} on its own scale")


LISTEN_S = 8.0
STICKS_S = 12.0
"""Time for both sticks to go round twice."""


@dataclass(frozen=True, slots=True)
class RcHeard:
    """Check that the autopilot receives its remote control, and is disarmed."""

    expectation: RcExpectation
    place: base.Place

    def asks(self) -> tuple[base.Question, ...]:
        """Listen until enough data of the vehicle were received."""
        return (_listen("stream", self.expectation, self.place, LISTEN_S, enough(self.expectation.system_id)),)

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        """Judge the stream."""
        return _judge_answer(results["stream"], self.expectation, judge)


@dataclass(frozen=True, slots=True)
class StickMovementProbe:
    """Check that the channels follow the pilot's sticks, and that the vehicle stays disarmed."""

    expectation: RcExpectation
    place: base.Place

    def asks(self) -> tuple[base.Question, ...]:
        """Listen for the whole time that the pilot moves the sticks: the vehicle may be armed at any moment."""
        return (_listen("sticks", self.expectation, self.place, STICKS_S, b""),)

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        """Judge the movement."""
        return _judge_answer(
            results["sticks"],
            self.expectation,
            lambda stream, expectation: (judge_moved(stream, expectation),),
            with_movement=True,
        )


def _listen(name: str, expectation: RcExpectation, place: base.Place, listen_s: float, until: bytes) -> base.Listen:
    return base.Listen(name=name, place=place, transport="udp", port=expectation.port, listen_s=listen_s, enough=until)


def _judge_answer(
    answer: base.Answer,
    expectation: RcExpectation,
    judge_stream: Callable[[Stream, RcExpectation], tuple[LinkFinding, ...]],
    *,
    with_movement: bool = False,
) -> base.ProbeResult:
    assert isinstance(answer, base.Transcript)  # noqa: S101 - what Listen gives
    stream = read(answer, expectation.address)
    hot, silent = check_disarmed(stream, expectation), unusable(answer, stream, expectation)
    first = () if hot is None else (hot,)
    if silent is None:
        first = (*first, *doubts(stream, expectation))
    findings = (silent,) if silent is not None else judge_stream(stream, expectation)
    findings = (*first, *(finding for finding in findings if not first or finding.verdict is not Verdict.PASS))
    all_evidence = (*evidence(stream, expectation), *(movement(stream, expectation) if with_movement else ()))
    return base.ProbeResult(findings, all_evidence)


def steps(cell: base.Cell) -> tuple[base.Step, ...]:
    """Return the steps of a cell: listening and sticks (by a person without an endpoint), failsafe, range."""
    endpoint = cell.endpoints.rc_rf
    first = (_manual_step(cell),) if endpoint is None else _stream_steps(cell, endpoint)
    return (*first, _failsafe(cell), _range(cell))


def _stream_steps(cell: base.Cell, endpoint: RcRfEndpoint) -> tuple[base.Step, ...]:
    place = cell.place(endpoint.seen_from)
    gateway = cell.gateway.name if place is base.Place.GATEWAY and cell.gateway is not None else ""
    place_name, address = gateway or "this computer", cell.address(endpoint.address)
    expectation = RcExpectation(cell.name, place_name, endpoint.port, endpoint.system_id, endpoint.rssi_low, address)
    concerns = (gateway,) if gateway else ()
    return (
        base.Step(
            name="",
            title=msg(f"{arg(cell.name)} receives its remote control, and is disarmed"),
            kind=report.ItemKind.AUTOMATIC,
            phase=report.Phase.BENCH,
            probe=RcHeard(expectation, place),
            concerns=concerns,
        ),
        base.Step(
            name="sticks",
            title=msg(f"The channels of {arg(cell.name)} follow the sticks"),
            kind=report.ItemKind.ACTIVE,
            phase=report.Phase.BENCH,
            probe=StickMovementProbe(expectation, place),
            consent=base.Consent(
                question=msg(
                    f"the propellers are off {arg(cell.name)}, or it is disarmed and secured; nobody is near it"
                ),
                # Held in a corner, a stick arms or disarms.
                prompt=msg(
                    f"ask the pilot of {arg(cell.name)} to move both sticks in circles, without holding them in a "
                    "corner"
                ),
            ),
            concerns=concerns,
        ),
    )


def _manual_step(cell: base.Cell) -> base.Step:
    return base.Step(
        name="",
        title=msg(f"{arg(cell.name)} receives its remote control"),
        kind=report.ItemKind.PERSON,
        phase=report.Phase.BENCH,
        do=msg(
            f"Remove the propellers from {arg(cell.name)}, or leave it disarmed and secured. Switch the transmitter "
            "on, and move both sticks and every switch, one after the other."
        ),
        look_for=(
            "The channels in the operator's program follow each stick and switch over the full range; the program "
            "shows a good link; the vehicle stays disarmed."
        ),
    )


def _failsafe(cell: base.Cell) -> base.Step:
    return base.Step(
        name="failsafe",
        title=msg(f"{arg(cell.name)} goes to failsafe when its remote control is lost"),
        kind=report.ItemKind.PERSON,
        phase=report.Phase.BENCH,
        do=msg(
            f"Remove the propellers from {arg(cell.name)} and secure it. Switch the transmitter off, wait ten seconds, "
            "and switch it on again."
        ),
        look_for=(
            "Within a few seconds its program reports the loss and the failsafe agreed for this test. Nothing "
            "moves. With the transmitter on, the link returns by itself."
        ),
    )


def _range(cell: base.Cell) -> base.Step:
    return base.Step(
        name="range",
        title=msg(f"The remote control of {arg(cell.name)} has enough range"),
        kind=report.ItemKind.PERSON,
        phase=report.Phase.QUAY,
        do=msg(
            f"Leave {arg(cell.name)} disarmed and secured. Set the transmitter to its reduced power for range tests. "
            "Walk 30 m away in line of sight, turn round once, and move the sticks."
        ),
        look_for=(
            "The channels follow without interruption in every direction, and no failsafe is reported; set the "
            "transmitter back to full power afterwards."
        ),
    )
