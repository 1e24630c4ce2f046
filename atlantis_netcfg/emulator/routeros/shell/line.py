"""The line under the cursor: its text, and what has to be sent so that the terminal shows it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.shell.flags import Screen

__all__ = ["Line", "Pages", "folded"]


_REPAINT = "\r"
_ERASE = "\x1b[K"


@dataclass(slots=True)
class Line:
    """A prompt, what was typed after it, the cursor in it; `secret` is typed without being shown.

    A line that is longer than the screen is shown by its end, behind a `<` (community.routeros knows that sign).
    """

    screen: Screen
    prompt: str = ""
    text: str = ""
    at: int = 0
    secret: bool = False
    _shown: int = field(default=0)

    def begin(self, prompt: str, *, secret: bool = False) -> str:
        """Start an empty line."""
        self.prompt, self.text, self.at, self.secret = prompt, "", 0, secret
        self._shown = 0
        return self.paint()

    def paint(self) -> str:
        """Draw the whole line where the cursor stands."""
        visible = self._visible()
        padding = ""
        if self.screen.dumb:
            padding = " " * max(0, self._shown - len(visible))
            padding += "\b" * len(padding)
        self._shown = len(visible)
        back = "\b" * (len(self.text) - self.at)
        return visible + (padding if self.screen.dumb else _ERASE) + back

    def afresh(self) -> str:
        """Draw it on a line that is empty."""
        self._shown = 0
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
            self._shown += len(char)
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
            self._shown -= 1
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


def folded(text: str, width: int) -> list[str]:
    """The lines of `text`, none longer than the screen; clients that parse ask for a wide one."""
    found: list[str] = []
    for line in text.split("\n"):
        found += [line[at : at + width] for at in range(0, len(line), width)] or [""]
    return found


class Pages:
    """What is still to be shown of one output."""

    def __init__(self, text: str, screen: Screen) -> None:
        self._lines = folded(text, screen.width) if text else []
        self._room = max(screen.height - 1, 1)

    @property
    def done(self) -> bool:
        """Everything was shown."""
        return not self._lines

    def next(self, count: int | None = None) -> str:
        """The next lines: a page of them, or so many."""
        count = count or self._room
        shown, self._lines = self._lines[:count], self._lines[count:]
        return "".join(f"{line}\r\n" for line in shown)

    def rest(self) -> str:
        """All of it."""
        return self.next(len(self._lines))
