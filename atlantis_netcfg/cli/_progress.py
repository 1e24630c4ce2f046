"""Live progress: one line a device on a terminal, one plain line a step elsewhere."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, TextIO

from atlantis_netcfg.events import ignore

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.events import Event, Subscriber

__all__ = ["progress"]


@contextmanager
def progress(*, quiet: bool, out: TextIO = sys.stderr) -> Iterator[Subscriber]:
    """Give the subscriber that fits `out`; `quiet` shows nothing."""
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
    with Live(console=Console(file=out), refresh_per_second=8, transient=True) as live:

        def show(event: Event) -> None:
            latest[event.device] = event
            live.update(Text("\n").join(Text(line(one), overflow="ellipsis", no_wrap=True) for one in latest.values()))

        yield show
