"""What the playbook that runs in this process has to know of its caller: must it stop, was it cut off.

Ansible makes callback plugins by itself and hands them nothing. So the play that `provision` runs stands here while it
runs; in plain `ansible-playbook` there is none. Tasks run in forked children, which see what stood here when they
began.
"""

from __future__ import annotations

import os
import signal
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import FrameType

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C, `kill`, and a terminal that is closed: each stops a run in the same way."""


@dataclass(slots=True)
class PlayControl:
    """One play: the first stop signal reaches its workers, which settle; after the next one nobody waits any longer."""

    workers: Callable[[], list[int]] = list
    """Process ids of the tasks that run now."""
    stopped_by: str = ""
    """Name of the signal, as `SIGINT`; empty: nobody has stopped it."""
    cleanups: list[Callable[[str], None]] = field(default_factory=list)
    """Called with the reason when Ansible has ended without saying so."""

    @contextmanager
    def current(self) -> Iterator[PlayControl]:
        """Let plugins find it, and take the stop signals while it lasts. In the main thread only."""
        before = {number: signal.getsignal(number) for number in STOP_SIGNALS}
        _current.append(self)
        try:
            yield self
        finally:
            _current.remove(self)
            for number, handler in before.items():
                signal.signal(number, handler)

    def take_signals(self) -> None:
        """Answer the stop signals from now on; Ansible sets handlers of its own when it makes a play.

        A signal that this process was told to ignore (`nohup`) stays ignored.
        """
        for number in STOP_SIGNALS:
            if signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, self._stop)

    def _stop(self, number: int, _frame: FrameType | None) -> None:
        """Hand it to the workers as Ctrl-C: the first lets them settle, the second ends them."""
        self.stopped_by = self.stopped_by or signal.Signals(number).name
        for worker in self.workers():
            with suppress(ProcessLookupError):
                os.kill(worker, signal.SIGINT)

    def cut_off(self, reason: str) -> None:
        """Ansible has ended in the middle of a play: whoever keeps results has to close them."""
        for cleanup in self.cleanups:
            cleanup(reason)


_current: list[PlayControl] = []


def refuse_after_stop() -> None:
    """Begin no further task once a person has stopped the play. Raises KeyboardInterrupt."""
    if _current and _current[-1].stopped_by:
        raise KeyboardInterrupt(_current[-1].stopped_by)


def when_cut_off(cleanup: Callable[[str], None]) -> None:
    """Have this called, with the reason, if the play ends without its last event."""
    if _current:
        _current[-1].cleanups.append(cleanup)
