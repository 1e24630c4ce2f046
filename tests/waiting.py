"""Waiting for what has to come: one limit for all, which ends only what hangs, however busy the machine is."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

_Found = TypeVar("_Found")
HANG_S = 300.0


def wait_until(holds: Callable[[], _Found], why: Callable[[], object] = str, every_s: float = 0.02) -> _Found:
    """Wait until something is so, or is there; give it."""
    end = time.monotonic() + HANG_S
    while not (found := holds()):
        assert time.monotonic() < end, f"it never came: {why()}"
        time.sleep(every_s)
    return found


def measure(judge: Callable[[], None], attempts: int = 8) -> None:
    """Repeat a measurement in real time until it holds: a busy machine disturbs some of them, a fault of ours all."""
    for _ in range(attempts - 1):
        try:
            return judge()
        except AssertionError:
            continue
    return judge()
