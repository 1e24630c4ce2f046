"""Stop signals of one command line: Ctrl-C, `kill` and a terminal that is closed.

From `take` to `ignore` a signal raises KeyboardInterrupt, so that the command settles and tells what is known. While a
module is imported it waits until the module is there: extension modules panic, or make another error of it, when their
imports are interrupted. Once the result is known, `ignore` lets it be printed whole: a stop would change nothing but
the last words.
"""

from __future__ import annotations

import signal
import sys
import threading
from functools import partial
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from types import FrameType

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_REPEAT_S = 0.01
"""How soon a stop that could not be raised is tried again."""

_pending: list[str] = []


def pending_stop() -> str:
    """Return the first signal that came, as `SIGINT`; empty: none. A library may have made another error of it."""
    return _pending[0] if _pending else ""


def take() -> None:
    """Answer them from now on. Signals that we were told to ignore (`nohup`) stay ignored."""
    _pending.clear()
    if threading.current_thread() is not threading.main_thread():
        return
    for number in STOP_SIGNALS:
        if signal.getsignal(number) in {signal.SIG_DFL, signal.default_int_handler, _hold}:
            signal.signal(number, _stop)
    if getattr(sys.unraisablehook, "func", None) is not _repeat_lost_stop:
        sys.unraisablehook = partial(_repeat_lost_stop, sys.unraisablehook)


def handlers() -> dict[int, Any]:
    """Return what answers them now, for `restore`."""
    return {number: signal.getsignal(number) for number in STOP_SIGNALS}


def restore(before: Mapping[int, Any]) -> None:
    """Let them be answered as before, and forget what came."""
    if threading.current_thread() is threading.main_thread():
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in before.items():
            signal.signal(number, handler)
    _pending.clear()


def ignore() -> None:
    """Let the command end as its result says."""
    if threading.current_thread() is threading.main_thread():
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number in STOP_SIGNALS:
            if signal.getsignal(number) is _stop:
                signal.signal(number, _hold)


def _stop(number: int, frame: FrameType | None) -> None:
    _pending.append(signal.Signals(number).name)
    _raise_or_wait(number, frame)


def _raise_or_wait(_number: int, frame: FrameType | None) -> None:
    if _is_importing(frame):
        _repeat()
        return
    raise KeyboardInterrupt(pending_stop())


def _is_importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def _repeat() -> None:
    """Try again soon. By the kernel's timer: a thread cannot be started where `threading` itself was interrupted."""
    signal.signal(signal.SIGALRM, _raise_or_wait)
    signal.setitimer(signal.ITIMER_REAL, _REPEAT_S)


def _hold(_number: int, _frame: FrameType | None) -> None:
    """Go on: unlike an ignored signal it is not inherited by the programs that we start."""


def _repeat_lost_stop(before: Callable[[Any], object], unraisable: Any) -> None:  # noqa: ANN401 - sys.UnraisableHookArgs
    """Raise a stop again that came where Python cannot raise it, in a callback of garbage collection."""
    if isinstance(unraisable.exc_value, KeyboardInterrupt) and unraisable.exc_value.args:
        _repeat()
    else:
        before(unraisable)
