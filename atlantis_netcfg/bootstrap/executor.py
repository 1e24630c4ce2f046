"""Typing planned steps on a console: each journalled before, the risky ones under safe mode."""

from __future__ import annotations

import time
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.bootstrap.messages import cut_off
from atlantis_netcfg.console.types import ConsoleLost, SafeModeHeld
from atlantis_netcfg.core.events import Event, Stage
from atlantis_netcfg.journal import ContactStep, ContactStepDone

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.bootstrap._steps import Step
    from atlantis_netcfg.bootstrap.target import Wish
    from atlantis_netcfg.console.types import Console
    from atlantis_netcfg.core.events import Subscriber
    from atlantis_netcfg.journal import Recorder

__all__ = ["GUARDED_LINES", "Typist", "safe"]

GUARDED_LINES = 80
"""Actions in one safe mode: after the 100th a session leaves it without a word (Manual, Configuration Management)."""
_HELD_S = 30.0
"""A session that was cut holds safe mode until the device has undone its changes."""
_PAUSE_S = 0.5


@dataclass(frozen=True, slots=True)
class Typist:
    """Types; never decides."""

    wish: Wish
    journal: Recorder
    notify: Subscriber

    def do(self, steps: Sequence[Step], console: Console, *, held: bool = False) -> None:
        """Type every line of every step. `held`: safe mode is held already. Raises CutOff, ConsoleRefused."""
        for step in steps:
            self.journal.write(ContactStep(device=self.wish.name, step=step.key, commands=len(step.lines)))
            self.notify(Event(self.wish.name, Stage.APPLYING, step.title))
            try:
                self._type(step, console, guarded=step.guarded and not held)
            except ConsoleLost as lost:
                raise cut_off(self.wish, step, lost) from lost
            self.journal.write(ContactStepDone(device=self.wish.name, step=step.key))

    def _type(self, step: Step, console: Console, *, guarded: bool) -> None:
        size = GUARDED_LINES if guarded else len(step.lines)
        for start in range(0, len(step.lines), size):
            with safe(console) if guarded else nullcontext():
                for line in step.lines[start : start + size]:
                    console.run(line.text, timeout_s=line.timeout_s, secrets=line.secrets)


@contextmanager
def safe(console: Console) -> Iterator[None]:
    """Safe mode: released when all went well, else the session ends and the device undoes."""
    deadline = time.monotonic() + _HELD_S
    while True:
        try:
            console.take_safe_mode()
            break
        except SafeModeHeld:
            if time.monotonic() > deadline:
                raise
            time.sleep(_PAUSE_S)
    yield
    console.release_safe_mode()
