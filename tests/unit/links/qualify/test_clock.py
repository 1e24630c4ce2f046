"""What the kernel says of a clock, and what is concluded of it; no clock is changed."""

import ctypes
import time

import pytest

from atlantis_netcfg.links.qualify.reflector.clock import (
    LEAST_ERROR_S,
    UNKNOWN,
    ClockState,
    Timex,
    kernel_clock,
    state_of,
)
from atlantis_netcfg.links.qualify.reflector.stamp import error_estimate, error_s, is_synchronised


@pytest.mark.parametrize(
    ("returned", "status", "maxerror_us", "expected"),
    [
        (0, 0x2001, 1_500, ClockState(is_synchronised=True, error_s=LEAST_ERROR_S)),
        (0, 0x2001, 480_000, ClockState(is_synchronised=True, error_s=0.48)),
        (0, 0x2041, 1_500, UNKNOWN),
        (5, 0x2001, 1_500, UNKNOWN),
        (-1, 0, 0, UNKNOWN),
    ],
)
def test_clock_state_follows_the_kernel_status(
    returned: int, status: int, maxerror_us: int, expected: ClockState
) -> None:
    assert state_of(returned, Timex(status=status, maxerror=maxerror_us)) == expected


def test_kernel_clock_structure_is_read_correctly() -> None:
    timex = Timex()
    assert ctypes.CDLL(None).adjtimex(ctypes.byref(timex)) >= 0
    assert abs(timex.time.seconds - time.time()) < 60
    assert 9_000 <= timex.tick <= 11_000
    assert kernel_clock().error_s >= LEAST_ERROR_S


def test_clock_error_is_encoded_in_the_estimate() -> None:
    state = ClockState(is_synchronised=True, error_s=0.48)
    estimate = error_estimate(state.error_s, is_synced=state.is_synchronised)
    assert is_synchronised(estimate)
    assert error_s(estimate) == pytest.approx(0.48, rel=0.01)
