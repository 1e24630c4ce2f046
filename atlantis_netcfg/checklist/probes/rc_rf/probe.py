"""The probes of the remote control: both only listen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes.rc_rf._stream_judged import armed, doubts, unusable
from atlantis_netcfg.checklist.probes.rc_rf.evidence import evidence, movement
from atlantis_netcfg.checklist.probes.rc_rf.judge import judge
from atlantis_netcfg.checklist.probes.rc_rf.stick_movement import judge_moved
from atlantis_netcfg.checklist.probes.rc_rf.stream import enough, read
from atlantis_netcfg.checklist.probes.requests import Listen, Place, Question
from atlantis_netcfg.checklist.probes.results import Transcript
from atlantis_netcfg.checklist.probes.step import Judged
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from atlantis_netcfg.bearers import Finding
    from atlantis_netcfg.checklist.probes.rc_rf.stream import Heard
    from atlantis_netcfg.checklist.probes.rc_rf.wanted import Wanted
    from atlantis_netcfg.checklist.probes.results import Answer

__all__ = ["RcHeard", "SticksMoved"]

LISTEN_S = 8.0
STICKS_S = 12.0
"""Time for both sticks to go round twice."""


@dataclass(frozen=True, slots=True)
class RcHeard:
    """The autopilot hears its remote control, and is disarmed."""

    wanted: Wanted
    place: Place

    def asks(self) -> tuple[Question, ...]:
        """Listen until enough of the vehicle was heard."""
        return (_listen("stream", self.wanted, self.place, LISTEN_S, enough(self.wanted.system_id)),)

    def judge(self, results: Mapping[str, Answer]) -> Judged:
        """Judge the stream."""
        return _judged(results["stream"], self.wanted, judge)


@dataclass(frozen=True, slots=True)
class SticksMoved:
    """The channels follow the pilot's sticks, and the vehicle stays disarmed."""

    wanted: Wanted
    place: Place

    def asks(self) -> tuple[Question, ...]:
        """Listen for as long as the pilot moves the sticks: it may be armed at any moment of it."""
        return (_listen("sticks", self.wanted, self.place, STICKS_S, b""),)

    def judge(self, results: Mapping[str, Answer]) -> Judged:
        """Judge the movement."""
        return _judged(
            results["sticks"], self.wanted, lambda stream, expected: (judge_moved(stream, expected),), moved=True
        )


def _listen(name: str, expected: Wanted, place: Place, listen_s: float, until: bytes) -> Listen:
    return Listen(name=name, place=place, transport="udp", port=expected.port, listen_s=listen_s, enough=until)


def _judged(
    answer: Answer,
    expected: Wanted,
    judge_stream: Callable[[Heard, Wanted], tuple[Finding, ...]],
    *,
    moved: bool = False,
) -> Judged:
    assert isinstance(answer, Transcript)  # noqa: S101 - what Listen gives
    stream = read(answer, expected.address)
    hot, silent = armed(stream, expected), unusable(answer, stream, expected)
    first = () if hot is None else (hot,)
    if silent is None:
        first = (*first, *doubts(stream, expected))
    found = (silent,) if silent is not None else judge_stream(stream, expected)
    found = (*first, *(finding for finding in found if not first or finding.verdict is not Verdict.PASS))
    seen = (*evidence(stream, expected), *(movement(stream, expected) if moved else ()))
    return Judged(found, seen)
