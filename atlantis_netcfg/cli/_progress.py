"""Live progress: one line a device on a terminal, one plain line a step elsewhere."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, TextIO

from atlantis_netcfg.events import Stage, ignore

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.events import Event, Subscriber

__all__ = ["progress"]

_ENDS = (Stage.DONE, Stage.CONFIRMED, Stage.UNROLLED, Stage.FAILED)
_ROOM = 16
"""Devices that are shown together; of more, those that have ended scroll away upwards, and the others stay in sight."""


@contextmanager
def progress(*, quiet: bool, out: TextIO | None = None) -> Iterator[Subscriber]:
    """Give the subscriber that fits `out`, which is stderr as it is at that moment; `quiet` shows nothing."""
    out = out or sys.stderr
    if quiet:
        yield ignore
    elif out.isatty():
        with _live(out) as subscriber:
            yield subscriber
    else:
        yield lambda event: print(line(event), file=out, flush=True)


def line(event: Event) -> str:
    """One step in words: `coastal-router  applying 24/112  layer 2 of 4`."""
    count = f" {event.done}/{event.total}" if event.total else ""
    return f"  {event.device:<18} {event.stage}{count}  {event.message}".rstrip()


@contextmanager
def _live(out: TextIO) -> Iterator[Subscriber]:
    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    latest: dict[str, Event] = {}
    names: set[str] = set()
    console = Console(file=out)
    with Live(console=console, refresh_per_second=8, transient=True) as live:

        def show(event: Event) -> None:
            names.add(event.device)
            latest[event.device] = event
            if event.stage in _ENDS and len(names) > _ROOM:
                for name in [name for name, one in latest.items() if one.stage in _ENDS]:
                    live.console.print(Text(line(latest.pop(name)), overflow="ellipsis", no_wrap=True))
            live.update(Text("\n").join(Text(line(one), overflow="ellipsis", no_wrap=True) for one in latest.values()))

        yield show
