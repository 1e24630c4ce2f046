"""Terminal input: bytes to keys, the edited line, and login flags.

Keys are text, control keys and escape sequences, across chunk boundaries. The edited line knows its text and the output
that shows it. User names may carry flags at login: `admin+ct511w4098h` (Manual, Command Line Interface).
"""

from __future__ import annotations

import codecs
import re
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator


class Key(Enum):
    """Keys with a function (Manual, Command Line Interface: list of keys)."""

    ENTER = auto()
    FEED = auto()
    """A line feed after Enter: clients send CR LF."""
    BACKSPACE = auto()
    DELETE = auto()
    LEFT = auto()
    RIGHT = auto()
    HOME = auto()
    END = auto()
    UP = auto()
    DOWN = auto()
    TAB = auto()
    KILL_LINE = auto()
    KILL_END = auto()
    REDRAW = auto()
    CANCEL = auto()
    EOF = auto()
    SAFE = auto()
    TERMINAL_ID = auto()
    """Identification sent by the terminal."""


@dataclass(frozen=True, slots=True)
class Position:
    """Cursor position reported by the terminal."""

    row: int
    column: int


_CONTROL = {
    "\x01": Key.HOME,
    "\x02": Key.LEFT,
    "\x03": Key.CANCEL,
    "\x04": Key.EOF,
    "\x05": Key.END,
    "\x06": Key.RIGHT,
    "\x08": Key.BACKSPACE,
    "\t": Key.TAB,
    "\x0b": Key.KILL_END,
    "\x0c": Key.REDRAW,
    "\x0e": Key.DOWN,
    "\x10": Key.UP,
    "\x15": Key.KILL_LINE,
    "\x18": Key.SAFE,
    "\x7f": Key.BACKSPACE,
}
_SEQUENCES = {
    "[A": Key.UP,
    "[B": Key.DOWN,
    "[C": Key.RIGHT,
    "[D": Key.LEFT,
    "[F": Key.END,
    "[H": Key.HOME,
    "[1~": Key.HOME,
    "[3~": Key.DELETE,
    "[4~": Key.END,
    "[14~": Key.SAFE,
    "OA": Key.UP,
    "OB": Key.DOWN,
    "OC": Key.RIGHT,
    "OD": Key.LEFT,
    "OS": Key.SAFE,
    "/Z": Key.TERMINAL_ID,
}
_WHOLE = re.compile(r"\[[0-9;?]*[@-~]|O[A-Za-z]|/Z|[^\[O/]")
_REPORT = re.compile(r"\[(\d+);(\d+)R")


class Keyboard:
    """Key decoder; stores incomplete characters and sequences, and whether the last key was Enter."""

    def __init__(self) -> None:
        self._decoder = codecs.getincrementaldecoder("utf-8")("surrogateescape")
        self._escape: str | None = None
        self._returned = False

    def feed(self, data: bytes) -> Iterator[str | Key | Position]:
        """Yield keys, and text as single characters."""
        for char in self._decoder.decode(data):
            key = self._parse_key(char)
            if key is not None:
                yield key

    def _parse_key(self, char: str) -> str | Key | Position | None:
        if self._escape is not None:
            return self._sequence(char)
        was_return, self._returned = self._returned, char == "\r"
        if char == "\x1b":
            self._escape = ""
            return None
        if char == "\n":
            return Key.FEED if was_return else Key.ENTER
        if char == "\r":
            return Key.ENTER
        if char in _CONTROL:
            return _CONTROL[char]
        return char if char >= " " else None

    def _sequence(self, char: str) -> Key | Position | None:
        self._escape = (self._escape or "") + char
        if _WHOLE.fullmatch(self._escape) is None and len(self._escape) < 16:  # noqa: PLR2004 (no sequence is longer)
            return None
        whole, self._escape = self._escape, None
        if (report := _REPORT.fullmatch(whole)) is not None:
            return Position(int(report[1]), int(report[2]))
        if whole.startswith("[?") and whole.endswith("c"):
            return Key.TERMINAL_ID
        return _SEQUENCES.get(whole)


_REPAINT = "\r"
_ERASE = "\x1b[K"


@dataclass(slots=True)
class EditedLine:
    """A prompt, the text after it, and the cursor; `secret` text is not shown.

    Of a line longer than the screen, only the end is shown, after a `<` (community.routeros knows that sign).
    """

    screen: Screen
    prompt: str = ""
    text: str = ""
    at: int = 0
    secret: bool = False
    _visible_width: int = field(default=0)

    def begin(self, prompt: str, *, secret: bool = False) -> str:
        """Start an empty line, and return its output."""
        self.prompt, self.text, self.at, self.secret = prompt, "", 0, secret
        self._visible_width = 0
        return self.paint()

    def paint(self) -> str:
        """Return the output that draws the whole line at the cursor."""
        visible = self._visible()
        padding = ""
        if self.screen.dumb:
            padding = " " * max(0, self._visible_width - len(visible))
            padding += "\b" * len(padding)
        self._visible_width = len(visible)
        back = "\b" * (len(self.text) - self.at)
        return visible + (padding if self.screen.dumb else _ERASE) + back

    def afresh(self) -> str:
        """Return the output that draws the line on an empty screen line."""
        self._visible_width = 0
        return self.paint()

    def repaint(self) -> str:
        """Return the output that redraws the line."""
        return _REPAINT + self.paint()

    def insert(self, char: str) -> str:
        """Insert a character, and return the output."""
        self.text = self.text[: self.at] + char + self.text[self.at :]
        self.at += len(char)
        if self.secret:
            return "*"
        if self.at == len(self.text) and len(self.prompt) + len(self.text) < self.screen.width:
            self._visible_width += len(char)
            return char
        return self.repaint()

    def erase(self, *, ahead: bool = False) -> str:
        """Delete the character before the cursor, or after it with `ahead`; return the output."""
        start = self.at if ahead else self.at - 1
        if not 0 <= start < len(self.text):
            return ""
        self.text = self.text[:start] + self.text[start + 1 :]
        self.at = start
        if self.secret:
            return "\b \b"
        if start == len(self.text) and len(self.prompt) + len(self.text) < self.screen.width - 1:
            self._visible_width -= 1
            return "\b \b"
        return self.repaint()

    def replace(self, text: str) -> str:
        """Replace the text, with the cursor at its end; return the output."""
        self.text, self.at = text, len(text)
        return "" if self.secret else self.repaint()

    def cut(self) -> str:
        """Delete the text after the cursor; return the output."""
        self.text = self.text[: self.at]
        return "" if self.secret else self.repaint()

    def move(self, to: int) -> str:
        """Move the cursor within the text; return the output."""
        before, self.at = self.at, min(max(to, 0), len(self.text))
        if self.secret:
            return ""
        return "\b" * (before - self.at) or self.text[before : self.at]

    def _visible(self) -> str:
        whole = self.prompt + ("*" * len(self.text) if self.secret else self.text)
        room = self.screen.width - 1
        return whole if len(whole) <= room else "<" + whole[len(whole) - room + 1 :]


def fold(text: str, width: int) -> list[str]:
    """Split a text into lines of at most the screen width; parsing clients request a wide screen."""
    result: list[str] = []
    for line in text.split("\n"):
        result += [line[at : at + width] for at in range(0, len(line), width)] or [""]
    return result


class Pages:
    """Remaining pages of an output."""

    def __init__(self, text: str, screen: Screen) -> None:
        self._lines = fold(text, screen.width) if text else []
        self._room = max(screen.height - 1, 1)

    @property
    def is_done(self) -> bool:
        """Whether everything was shown."""
        return not self._lines

    def next(self, count: int | None = None) -> str:
        """Return the next page, or the next `count` lines."""
        count = count or self._room
        lines, self._lines = self._lines[:count], self._lines[count:]
        return "".join(f"{line}\r\n" for line in lines)

    def rest(self) -> str:
        """Return all remaining lines."""
        return self.next(len(self._lines))


_FLAG = re.compile(r"(\d*)([a-z])")
_WIDTH, _HEIGHT = 80, 24


@dataclass(frozen=True, slots=True)
class Screen:
    """Properties that the console assumes of its terminal."""

    colours: bool = True
    dumb: bool = False
    """No escape sequences and no paging."""
    detect: bool = True
    """Query the terminal for its type and size."""
    width: int = _WIDTH
    height: int = _HEIGHT
    requested_size: tuple[int, int] = (0, 0)
    """Width and height requested by the login flags; zero: not given."""

    def resize(self, width: int, height: int) -> Screen:
        """Return a copy with another size; zero keeps the old value."""
        return replace(self, width=width or self.width, height=height or self.height)

    def plain(self) -> Screen:
        """Return a copy without escape sequences, queries and colours."""
        return replace(self, colours=False, dumb=True, detect=False)


def split_login(name: str) -> tuple[str, Screen]:
    """Split a login name into user and the screen described by its flags; unknown flags are ignored.

    Assumption: console-first-login
    """
    user, plus, flags = name.partition("+")
    screen = Screen()
    if not plus:
        return user, screen
    for number, letter in _FLAG.findall(flags):
        screen = _apply_screen_option(screen, letter, int(number or 0))
    return user, screen.resize(*screen.requested_size)


def _apply_screen_option(screen: Screen, letter: str, number: int) -> Screen:
    if letter == "c":
        return replace(screen, colours=False)
    if letter == "e":
        return replace(screen, dumb=True)
    if letter == "t":
        return replace(screen, detect=False)
    if letter == "w":
        return replace(screen, requested_size=(number, screen.requested_size[1]))
    if letter == "h":
        return replace(screen, requested_size=(screen.requested_size[0], number))
    return screen
