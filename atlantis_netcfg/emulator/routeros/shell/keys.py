"""Bytes of a terminal to keys: text, control keys, escape sequences, however the bytes are cut.

The line under the cursor: its text, and what has to be sent so that the terminal shows it.

Flags that a user name carries when it logs in to a console: `admin+ct511w4098h` (Manual, Command Line Interface).
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
    """Keys that mean something (Manual, Command Line Interface: list of keys)."""

    ENTER = auto()
    FEED = auto()
    """A line feed that follows Enter: clients send CR LF."""
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
    """The terminal says what it is."""


@dataclass(frozen=True, slots=True)
class Position:
    """Where the terminal says its cursor is."""

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
    """Remembers half a character, half a sequence, and that the last key was Enter."""

    def __init__(self) -> None:
        self._decoder = codecs.getincrementaldecoder("utf-8")("surrogateescape")
        self._escape: str | None = None
        self._returned = False

    def feed(self, data: bytes) -> Iterator[str | Key | Position]:
        """Yield keys, and text character by character."""
        for char in self._decoder.decode(data):
            key = self._key(char)
            if key is not None:
                yield key

    def _key(self, char: str) -> str | Key | Position | None:
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
    """A prompt, what was typed after it, the cursor in it; `secret` is typed without being shown.

    A line that is longer than the screen is shown by its end, behind a `<` (community.routeros knows that sign).
    """

    screen: Screen
    prompt: str = ""
    text: str = ""
    at: int = 0
    secret: bool = False
    _visible_width: int = field(default=0)

    def begin(self, prompt: str, *, secret: bool = False) -> str:
        """Start an empty line."""
        self.prompt, self.text, self.at, self.secret = prompt, "", 0, secret
        self._visible_width = 0
        return self.paint()

    def paint(self) -> str:
        """Draw the whole line where the cursor stands."""
        visible = self._visible()
        padding = ""
        if self.screen.dumb:
            padding = " " * max(0, self._visible_width - len(visible))
            padding += "\b" * len(padding)
        self._visible_width = len(visible)
        back = "\b" * (len(self.text) - self.at)
        return visible + (padding if self.screen.dumb else _ERASE) + back

    def afresh(self) -> str:
        """Draw it on a line that is empty."""
        self._visible_width = 0
        return self.paint()

    def repaint(self) -> str:
        """Draw it again over what is there."""
        return _REPAINT + self.paint()

    def insert(self, char: str) -> str:
        """Type a character."""
        self.text = self.text[: self.at] + char + self.text[self.at :]
        self.at += len(char)
        if self.secret:
            return "*"
        if self.at == len(self.text) and len(self.prompt) + len(self.text) < self.screen.width:
            self._visible_width += len(char)
            return char
        return self.repaint()

    def erase(self, *, ahead: bool = False) -> str:
        """Backspace, or Delete."""
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
        """Show another text, with the cursor at its end."""
        self.text, self.at = text, len(text)
        return "" if self.secret else self.repaint()

    def cut(self) -> str:
        """Drop what is behind the cursor."""
        self.text = self.text[: self.at]
        return "" if self.secret else self.repaint()

    def move(self, to: int) -> str:
        """Put the cursor somewhere else in the text."""
        before, self.at = self.at, min(max(to, 0), len(self.text))
        if self.secret:
            return ""
        return "\b" * (before - self.at) or self.text[before : self.at]

    def _visible(self) -> str:
        whole = self.prompt + ("*" * len(self.text) if self.secret else self.text)
        room = self.screen.width - 1
        return whole if len(whole) <= room else "<" + whole[len(whole) - room + 1 :]


def fold(text: str, width: int) -> list[str]:
    """The lines of `text`, none longer than the screen; clients that parse ask for a wide one."""
    result: list[str] = []
    for line in text.split("\n"):
        result += [line[at : at + width] for at in range(0, len(line), width)] or [""]
    return result


class Pages:
    """What is still to be shown of one output."""

    def __init__(self, text: str, screen: Screen) -> None:
        self._lines = fold(text, screen.width) if text else []
        self._room = max(screen.height - 1, 1)

    @property
    def is_done(self) -> bool:
        """Everything was shown."""
        return not self._lines

    def next(self, count: int | None = None) -> str:
        """The next lines: a page of them, or so many."""
        count = count or self._room
        lines, self._lines = self._lines[:count], self._lines[count:]
        return "".join(f"{line}\r\n" for line in lines)

    def rest(self) -> str:
        """All of it."""
        return self.next(len(self._lines))


_FLAG = re.compile(r"(\d*)([a-z])")
_WIDTH, _HEIGHT = 80, 24


@dataclass(frozen=True, slots=True)
class Screen:
    """What the console believes about the terminal at its other end."""

    colours: bool = True
    dumb: bool = False
    """No escape sequences at all, and no paging."""
    detect: bool = True
    """Ask the terminal what and how large it is."""
    width: int = _WIDTH
    height: int = _HEIGHT
    requested_size: tuple[int, int] = (0, 0)
    """Width and height that the flags ask for; zero where they say nothing."""

    def resize(self, width: int, height: int) -> Screen:
        """The same with another size; zero is no size."""
        return replace(self, width=width or self.width, height=height or self.height)

    def plain(self) -> Screen:
        """The same without escape sequences, questions and colours."""
        return replace(self, colours=False, dumb=True, detect=False)


def split_login(name: str) -> tuple[str, Screen]:
    """The user's own name, and the screen that its flags describe; unknown flags count as none.

    Assumption: console-first-login
    """
    user, plus, flags = name.partition("+")
    screen = Screen()
    if not plus:
        return user, screen
    for number, letter in _FLAG.findall(flags):
        screen = _with(screen, letter, int(number or 0))
    return user, screen.resize(*screen.requested_size)


def _with(screen: Screen, letter: str, number: int) -> Screen:
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
