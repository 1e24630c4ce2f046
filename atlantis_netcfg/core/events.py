"""Events of a run for subscribers (progress line, journal, JSON), and verdicts; the engine never prints.

The six verdicts rate anything that was checked, worst last.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any


class Stage(StrEnum):
    """Stage of a device in its run, in the order shown to the user."""

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
    """One event of one device; `done_count` of `total` actions are confirmed.

    `limit_s`: the device times out after that many seconds without another event; 0: no limit.
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
    """Ignore an event."""


class Verdict(StrEnum):
    """Verdict of one check."""

    SKIP = "SKIP"
    """Not applicable; a reason is given."""
    PASS = "PASS"  # noqa: S105 - a verdict
    """Observed to be as expected."""
    WARN = "WARN"
    """It works, but outside the preferred range, or the evidence is weak."""
    INCONCLUSIVE = "INCONCLUSIVE"
    """Not observable: there was no response, which does not prove a fault."""
    FAIL = "FAIL"
    """Observed not to be as expected."""
    ERROR = "ERROR"
    """Error in the toolkit itself."""


_ORDER = tuple(Verdict)


def worst(verdicts: Iterable[Verdict]) -> Verdict:
    """Return the worst verdict; SKIP if there is none."""
    return max(verdicts, key=_ORDER.index, default=Verdict.SKIP)
