"""How far a long step is: bytes, speed, time left; told now and then, not with every block."""

from __future__ import annotations

import time
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["Meter", "Progress", "Step"]


class Step(StrEnum):
    """What takes long."""

    UNPACKING = "unpacking the image"
    CLEARING = "clearing what must be empty"
    WRITING = "writing"
    COMPARING = "reading back"


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a step is."""

    step: Step
    done: int
    total: int
    """Bytes."""
    elapsed_s: float

    @property
    def rate_bps(self) -> float:
        """Bytes a second since the step began; 0 while no time has passed."""
        return self.done / self.elapsed_s if self.elapsed_s > 0 else 0.0

    @property
    def left_s(self) -> float | None:
        """Seconds to the end at this speed; None while there is no speed."""
        return (self.total - self.done) / self.rate_bps if self.rate_bps > 0 else None

    @property
    def words(self) -> str:
        """For people."""
        share = 100 * self.done // self.total if self.total else 100
        left = "" if self.left_s is None else f", {self.left_s:.0f} s left"
        return f"{self.step} {share} % of {self.total / 1e6:.0f} MB, {self.rate_bps / 1e6:.1f} MB/s{left}"


class Meter:
    """Tells the progress of one step, at most once in so many seconds, and once its end."""

    def __init__(
        self,
        step: Step,
        tell: Callable[[Progress], None],
        *,
        every_s: float = 2.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._step = step
        self._tell = tell
        self._every_s = every_s
        self._clock = clock
        self._began = self._told = clock()
        self._ended = False

    def __call__(self, done: int, total: int) -> None:
        """So many of so many bytes are done."""
        at = self._clock()
        if self._ended:
            return
        self._ended = done >= total
        if self._ended or at - self._told >= self._every_s:
            self._told = at
            self._tell(Progress(self._step, done, total, at - self._began))
