"""The kernel's state of this computer's clock: whether a program disciplines it, and its maximum error.

It is only read. NTP and PTP programs tell the kernel that they discipline the clock; if one does not (chrony without
`rtcsync`), the state is unknown, which is not reported as synchronised. systemd-timesyncd does not tell the kernel the
distance to its server, so a minimum error is assumed.
"""

from __future__ import annotations

import ctypes
from typing import NamedTuple

_LIBC = ctypes.CDLL(None, use_errno=True)
_STA_UNSYNC = 0x40
"""STA_UNSYNC of adjtimex(2)."""
_TIME_ERROR = 5
LEAST_ERROR_S = 0.1
UNKNOWN_ERROR_S = 1.0
"""Error in seconds that is reported for an unsynchronised clock; a nominal value only."""


class ClockState(NamedTuple):
    """The clock state for the error estimate of a test packet (RFC 4656, 4.1.2)."""

    is_synchronised: bool
    """Whether the clock is synchronised to UTC by an external source."""
    error_s: float


UNKNOWN = ClockState(False, UNKNOWN_ERROR_S)


class _Timeval(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("fraction", ctypes.c_long))


class Timex(ctypes.Structure):
    """The C type `struct timex`; with `modes` 0 nothing is changed."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        ("offset", ctypes.c_long),
        ("freq", ctypes.c_long),
        ("maxerror", ctypes.c_long),
        ("esterror", ctypes.c_long),
        ("status", ctypes.c_int),
        ("constant", ctypes.c_long),
        ("precision", ctypes.c_long),
        ("tolerance", ctypes.c_long),
        ("time", _Timeval),
        ("tick", ctypes.c_long),
        ("rest", ctypes.c_byte * 256),
    )


def state_of(return_code: int, timex: Timex) -> ClockState:
    """Convert the result of adjtimex(2) to a clock state."""
    if return_code < 0 or return_code == _TIME_ERROR or timex.status & _STA_UNSYNC:
        return UNKNOWN
    return ClockState(True, max(LEAST_ERROR_S, timex.maxerror / 1e6))


def kernel_clock() -> ClockState:
    """Read the clock state from the kernel; UNKNOWN if that fails."""
    timex = Timex()
    try:
        return_code = _LIBC.adjtimex(ctypes.byref(timex))
    except AttributeError:
        return UNKNOWN
    return state_of(return_code, timex)
