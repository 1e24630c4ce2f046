"""Live progress: one line a device on a terminal, one plain line a step elsewhere. Neither is silent for long."""

from __future__ import annotations

import sys
import threading
import time
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, TextIO

from atlantis_netcfg.core import printable
from atlantis_netcfg.core.events import Stage, ignore

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.core.events import Event, Subscriber


_ENDS = (Stage.DONE, Stage.CONFIRMED, Stage.UNROLLED, Stage.FAILED)
_ROOM = 16
"""Devices that are shown together; of more, those that have ended scroll away upwards, and the others stay in sight."""


SILENCE_S = 20.0
"""After so long without a step a plain log says what it waits for: a gap of a satellite link lasts over a minute."""
_AGE_S = 5.0
"""From this age on a step on a terminal shows it."""
_NAMED = 3
"""Devices that a reminder names; it counts the others."""


@contextmanager
def progress(*, quiet: bool, out: TextIO | None = None, silence_s: float = SILENCE_S) -> Iterator[Subscriber]:
    """Give the subscriber that fits `out`, which is stderr as it is at that moment; `quiet` shows nothing."""
    out = out or sys.stderr
    if quiet:
        yield ignore
    elif out.isatty():
        with _live(out) as subscriber:
            yield subscriber
    else:
        with _plain(out, silence_s) as subscriber:
            yield subscriber


def line(event: Event) -> str:
    """One step in words: `coastal-router  applying 24/112  layer 2 of 4`."""
    count = f" {event.done}/{event.total}" if event.total else ""
    return printable.line(f"  {event.device:<18} {event.stage}{count}  {event.message}".rstrip())


@contextmanager
def _plain(out: TextIO, silence_s: float) -> Iterator[Subscriber]:
    """One line a step, and a reminder whenever nothing has been printed for `silence_s`."""
    at_work: dict[str, Event] = {}
    lock, ended = threading.Lock(), threading.Event()
    step_at = printed_at = time.monotonic()

    def show(event: Event) -> None:
        nonlocal step_at, printed_at
        with lock:
            at_work.pop(event.device, None)
            if event.stage not in _ENDS:
                at_work[event.device] = event
            step_at = printed_at = time.monotonic()
            print(line(event), file=out, flush=True)

    def remind() -> None:
        nonlocal printed_at
        while not ended.wait(max(0.0, printed_at + silence_s - time.monotonic())):
            with lock, suppress(OSError, ValueError):  # nobody reads any longer: the run goes on
                now = time.monotonic()
                if now >= printed_at + silence_s:
                    printed_at = now
                    print(_reminder(list(at_work.values()), now - step_at), file=out, flush=True)

    thread = threading.Thread(target=remind, name="progress", daemon=True)
    thread.start()
    try:
        yield show
    finally:
        ended.set()
        thread.join()


def _reminder(at_work: list[Event], age_s: float) -> str:
    """What is waited for, in words: `  still at work, 40 s without news: coastal-router (connecting)`."""
    names = [f"{event.device} ({event.stage})" for event in at_work[:_NAMED]]
    if more := len(at_work) - len(names):
        names.append(f"{more} more")
    return f"  still at work, {age_s:.0f} s without news" + (f": {', '.join(names)}" if names else "")


@contextmanager
def _live(out: TextIO) -> Iterator[Subscriber]:
    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    latest: dict[str, tuple[Event, float]] = {}
    names: set[str] = set()
    console = Console(file=getattr(out, "stream", out))  # what it draws is its own, and its lines are filtered

    def text(event: Event, since: float) -> Text:
        age_s = time.monotonic() - since
        age = f"  ({age_s:.0f} s)" if age_s >= _AGE_S and event.stage not in _ENDS else ""
        return Text(line(event) + age, overflow="ellipsis", no_wrap=True)

    def table() -> Text:
        return Text("\n").join(text(*row) for row in list(latest.values()))

    with Live(get_renderable=table, console=console, refresh_per_second=8, transient=True) as live:

        def show(event: Event) -> None:
            names.add(event.device)
            latest[event.device] = event, time.monotonic()
            if event.stage in _ENDS and len(names) > _ROOM:
                for name in [name for name, (item, _) in latest.items() if item.stage in _ENDS]:
                    live.console.print(text(*latest.pop(name)))
            live.refresh()

        yield show
