"""A terminal for tests: a command runs behind a real pseudo-terminal, and what a person sees there is read.

`pyte` draws what was written, so that a line that was drawn over is gone, as it is for a person.
"""

import fcntl
import os
import re
import struct
import termios
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import pyte
from waiting import HANG_S

_HISTORY = 2000
_MASKS = (
    (re.compile(r"\(\d+\s[^()\d]*,\s+[\d.,]+\s+kB,\s+[\d.,]+\s+s\)"), "(COST)"),
    (re.compile(r"\([\d.,]+\s+s\)"), "(TIME)"),
    (re.compile(r"\d{8}T\d{6}Z(-\d+)?"), "20261125T120000Z"),
    (re.compile(r"(digest|resumo) [0-9a-f\n]{64,66}(?=\n)"), r"\1 DIGEST"),
    (re.compile(r"SHA256:[\w+/]{43}"), "SHA256:KEY"),
    (re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d WES?T \(\d\d:\d\d UTC\)"), "2026-11-25 12:00 WET (12:00 UTC)"),
    (re.compile(r"127\.0\.0\.1:\d+"), "127.0.0.1:8729"),
)
"""What no two runs have alike. A cost ends its line, so that its length moves nothing else; it may go on in the next
one, so that lines are masked together."""


@dataclass
class Terminal:
    """What a command wrote, and what the terminal shows after it."""

    columns: int = 80
    rows: int = 24
    raw: bytes = b""
    descriptor: int = -1
    """Standard streams of the command."""
    keyboard: int = -1
    screen: pyte.HistoryScreen = field(init=False)

    def __post_init__(self) -> None:
        self.screen = pyte.HistoryScreen(self.columns, self.rows, history=_HISTORY, ratio=1)

    @property
    def shown(self) -> list[str]:
        """The lines that are on the screen now, without those that scrolled away above it."""
        return self.lines[-self.rows :]

    @property
    def lines(self) -> list[str]:
        """All lines, those that scrolled away included."""
        above = [
            "".join(line[column].data for column in range(self.columns)).rstrip() for line in self.screen.history.top
        ]
        return masked(above + [line.rstrip() for line in self.screen.display])

    @property
    def last(self) -> list[str]:
        """The last eight lines that have something on them."""
        return [line for line in self.lines if line][-8:]

    def press(self, keys: str) -> None:
        """What a person types."""
        os.write(self.keyboard, keys.encode())


def masked(lines: list[str]) -> list[str]:
    text = "\n".join(lines)
    for pattern, word in _MASKS:
        text = pattern.sub(word, text)
    return text.split("\n")


@contextmanager
def terminal(columns: int = 80, rows: int = 24) -> Iterator[Terminal]:
    """A terminal of that size; when the context ends, all that was written has been drawn."""
    made = Terminal(columns, rows)
    made.keyboard, made.descriptor = os.openpty()
    fcntl.ioctl(made.descriptor, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
    pieces: list[bytes] = []

    def read() -> None:
        while True:
            try:
                data = os.read(made.keyboard, 65536)
            except OSError:  # the last one who had it open has closed it
                return
            if not data:
                return
            pieces.append(data)

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    try:
        yield made
    finally:
        os.close(made.descriptor)
        reader.join(HANG_S)
        os.close(made.keyboard)
        made.raw = b"".join(pieces)
        pyte.ByteStream(made.screen).feed(made.raw)
