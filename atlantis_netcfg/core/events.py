"""What happens during a run, told to whoever subscribes: progress line, journal, JSON. The engine never prints."""

from __future__ import annotations

from collections.abc import Callable, Mapping
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
    """One thing that happened to one device; `done` of `total` actions are confirmed."""

    device: str
    stage: Stage
    message: str
    done: int = 0
    total: int = 0
    data: Mapping[str, Any] = field(default_factory=dict)


Subscriber = Callable[[Event], None]


def ignore(_event: Event) -> None:
    """The subscriber of those who do not want to know."""
