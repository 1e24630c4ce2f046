"""Wait for events with one long limit, which only catches what hangs, however busy the machine is."""

import time
from collections.abc import Callable
from typing import TypeVar

_Value = TypeVar("_Value")
HANG_S = 300.0


def wait_until(condition: Callable[[], _Value], why: Callable[[], object] = str, every_s: float = 0.02) -> _Value:
    """Poll until `condition` returns a true value, and return it."""
    end = time.monotonic() + HANG_S
    while not (value := condition()):
        assert time.monotonic() < end, f"timed out after {HANG_S:.0f} s: {why()}"
        time.sleep(every_s)
    return value


def measure(judge: Callable[[], None]) -> None:
    """Repeat a real-time measurement until `judge` passes: load disturbs some attempts, a defect all."""
    end = time.monotonic() + HANG_S
    while time.monotonic() < end:
        try:
            return judge()
        except AssertionError:
            continue
    return judge()
