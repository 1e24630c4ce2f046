"""Bytes of a terminal to keys: text, control keys, escape sequences, however the bytes are cut."""

from __future__ import annotations

import codecs
import re
from dataclasses import dataclass
from enum import Enum, auto
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["Key", "Keyboard", "Position"]


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
    IDENTIFIED = auto()
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
    "/Z": Key.IDENTIFIED,
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
        returned, self._returned = self._returned, char == "\r"
        if char == "\x1b":
            self._escape = ""
            return None
        if char == "\n":
            return Key.FEED if returned else Key.ENTER
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
            return Key.IDENTIFIED
        return _SEQUENCES.get(whole)
