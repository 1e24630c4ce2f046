"""The little of a terminal that a RouterOS console needs: lines that may be repainted, and questions it asks back."""

from __future__ import annotations

import re

__all__ = ["MOST", "WIDTH", "Screen"]

WIDTH = 511
"""Columns asked for by the login flag `511w`."""
MOST = 2 * 1024 * 1024
"""Characters between two clearings; the largest text that is read, a whole export, has some hundred thousand."""

_LONGEST_ESCAPE = 32
_NUMBER = re.compile("[0-9]{1,4}")
_ESCAPE = re.compile(r"\x1b(?:\[([0-9;?]*)([@-~])|[()][A-Za-z0-9]|([^\[()]))")
_PARTIAL = re.compile(r"\x1b(?:\[[0-9;?]*|[()])?\Z")


class Screen:
    """Bytes in, lines out. `replies` holds what the terminal has to answer since somebody last took it."""

    def __init__(self) -> None:
        self.lines: list[str] = [""]
        self.replies = b""
        self.size = 0
        """Characters since it was cleared."""
        self._column = 0
        self._rest = ""

    def clear(self) -> None:
        """Forget the lines; the one with the cursor stays empty."""
        self.lines = [""]
        self.size = 0
        self._column = 0

    def feed(self, data: bytes) -> None:
        """Show what the device sent."""
        text = self._rest + data.decode("latin-1")
        self._rest = ""
        self.size += len(data)
        place = 0
        while place < len(text):
            char = text[place]
            if char == "\x1b":
                match = _ESCAPE.match(text, place)
                if match is None:
                    if len(text) - place < _LONGEST_ESCAPE and _PARTIAL.match(text, place):
                        self._rest = text[place:]
                        return
                    place += 1
                    continue
                self._escape(match)
                place = match.end()
                continue
            place = self._plain(text, place)

    def text(self, first: int = 0, last: int | None = None) -> list[str]:
        """Lines as text; bytes that are not UTF-8 survive as lone surrogates."""
        return [line.encode("latin-1").decode("utf-8", "surrogateescape") for line in self.lines[first:last]]

    def _plain(self, text: str, place: int) -> int:
        char = text[place]
        if char == "\n":
            self.lines.append("")
            self._column = 0
        elif char == "\r":
            self._column = 0
        elif char == "\b":
            self._column = max(0, self._column - 1)
        elif char >= " ":
            end = place
            while end < len(text) and text[end] >= " " and text[end] != "\x7f":
                end += 1
            self._write(text[place : max(end, place + 1)])
            return max(end, place + 1)
        return place + 1

    def _write(self, run: str) -> None:
        line = self.lines[-1].ljust(self._column)
        self.lines[-1] = line[: self._column] + run + line[self._column + len(run) :]
        self._column += len(run)

    def _escape(self, match: re.Match[str]) -> None:
        arguments, command, single = match.groups()
        if single == "Z" or command == "c":
            self.replies += b"\x1b[?1;2c"
        elif command == "n" and arguments == "6":
            self.replies += f"\x1b[1;{min(self._column + 1, WIDTH)}R".encode()
        elif command == "K":
            self._erase(arguments)
        elif command == "D":
            self._column = max(0, self._column - _count(arguments))
        elif command == "C":
            self._column = min(WIDTH - 1, self._column + _count(arguments))
        elif command == "J":
            self._erase(arguments)
        elif command == "G":
            self._column = min(WIDTH, _count(arguments)) - 1

    def _erase(self, arguments: str) -> None:
        if arguments in ("", "0"):
            self.lines[-1] = self.lines[-1][: self._column]
        elif arguments == "2":
            self.lines[-1] = ""


def _count(arguments: str) -> int:
    """How far; what is no number moves by one, as what is left out does."""
    return max(1, min(int(arguments), WIDTH)) if _NUMBER.fullmatch(arguments) else 1
