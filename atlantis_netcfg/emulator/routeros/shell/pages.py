"""Output that is folded at the screen's width and held back page by page."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.shell.flags import Screen

__all__ = ["Pages", "folded"]


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
