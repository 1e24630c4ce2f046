"""Stop signals of a command: Ctrl-C, `kill` and a closed terminal.

Between `install_handlers` and `ignore` a signal raises KeyboardInterrupt, so that the command can clean up and
report. During the import of a module it waits until the import ends: extension modules panic, or raise another error,
when their imports are interrupted. Once the result is known, `ignore` lets it be printed completely.
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
"""Seconds until a stop that could not be raised is tried again."""

_pending: list[str] = []


def pending_stop() -> str:
    """Return the first signal received, such as `SIGINT`, or an empty string; libraries may hide the exception."""
    return _pending[0] if _pending else ""


def install_handlers() -> None:
    """Handle stop signals from now on; signals ignored at start (`nohup`) stay ignored."""
    _pending.clear()
    if threading.current_thread() is not threading.main_thread():
        return
    for number in STOP_SIGNALS:
        if signal.getsignal(number) in {signal.SIG_DFL, signal.default_int_handler, _hold}:
            signal.signal(number, _handle_stop)
    if getattr(sys.unraisablehook, "func", None) is not _repeat_lost_stop:
        sys.unraisablehook = partial(_repeat_lost_stop, sys.unraisablehook)


def handlers() -> dict[int, Any]:
    """Return the current signal handlers, for `restore`."""
    return {number: signal.getsignal(number) for number in STOP_SIGNALS}


def restore(before: Mapping[int, Any]) -> None:
    """Restore signal handlers, and discard pending signals."""
    if threading.current_thread() is threading.main_thread():
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in before.items():
            signal.signal(number, handler)
    _pending.clear()


def ignore() -> None:
    """Ignore further stop signals, so that the result decides the exit code."""
    if threading.current_thread() is threading.main_thread():
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number in STOP_SIGNALS:
            if signal.getsignal(number) is _handle_stop:
                signal.signal(number, _hold)


def _handle_stop(number: int, frame: FrameType | None) -> None:
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
    """Retry soon by a kernel timer: no thread can be started where `threading` itself was interrupted."""
    signal.signal(signal.SIGALRM, _raise_or_wait)
    signal.setitimer(signal.ITIMER_REAL, _REPEAT_S)


def _hold(_number: int, _frame: FrameType | None) -> None:
    """Ignore a signal; unlike SIG_IGN, a handler is not inherited by child programs."""


def _repeat_lost_stop(before: Callable[[Any], object], unraisable: Any) -> None:  # noqa: ANN401 - sys.UnraisableHookArgs
    """Raise a stop again that was lost in a callback where Python cannot raise (garbage collection)."""
    if isinstance(unraisable.exc_value, KeyboardInterrupt) and unraisable.exc_value.args:
        _repeat()
    else:
        before(unraisable)
