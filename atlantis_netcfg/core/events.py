"""What happens during a run, told to whoever subscribes: progress line, journal, JSON. The engine never prints.

The six words in which anything that was looked at is judged, worst last.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any


class Stage(StrEnum):
    """Where a device is in its run, in the order in which a person sees it."""

    CONNECTING = "connecting"
    OBSERVED = "observed"
    PLANNED = "planned"
    PROTECTED = "protected"
    APPLYING = "applying"
    VERIFYING = "verifying"
    CONFIRMED = "confirmed"
    UNROLLED = "unrolled"
    WAITING = "waiting"
    FAILED = "failed"
    DONE = "done"


@dataclass(frozen=True, slots=True)
class Event:
    """One thing that happened to one device; `done_count` of `total` actions are confirmed.

    `limit_s`: after so many seconds without another event it is given up; 0 where there is no such limit.
    """

    device: str
    stage: Stage
    message: str
    done_count: int = 0
    total: int = 0
    data: Mapping[str, Any] = field(default_factory=dict)
    limit_s: float = 0.0


Subscriber = Callable[[Event], None]


def ignore(_event: Event) -> None:
    """The subscriber of those who do not want to know."""


class Verdict(StrEnum):
    """What is known of one thing that was to hold."""

    SKIP = "SKIP"
    """It does not apply; the reason stands beside it."""
    PASS = "PASS"  # noqa: S105 - a verdict
    """It was seen to hold."""
    WARN = "WARN"
    """It works, but outside the preferred band, or the evidence is weak."""
    INCONCLUSIVE = "INCONCLUSIVE"
    """It could not be observed: silence where silence proves nothing."""
    FAIL = "FAIL"
    """It was seen not to hold."""
    ERROR = "ERROR"
    """We ourselves failed."""


_ORDER = tuple(Verdict)


def worst(verdicts: Iterable[Verdict]) -> Verdict:
    """Return the worst of them; of none, SKIP."""
    return max(verdicts, key=_ORDER.index, default=Verdict.SKIP)
