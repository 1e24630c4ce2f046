"""Flags that a user name carries when it logs in to a console: `admin+ct511w4098h` (Manual, Command Line Interface)."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

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
    asked: tuple[int, int] = (0, 0)
    """Width and height that the flags ask for; zero where they say nothing."""

    def sized(self, width: int, height: int) -> Screen:
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
    return user, screen.sized(*screen.asked)


def _with(screen: Screen, letter: str, number: int) -> Screen:
    if letter == "c":
        return replace(screen, colours=False)
    if letter == "e":
        return replace(screen, dumb=True)
    if letter == "t":
        return replace(screen, detect=False)
    if letter == "w":
        return replace(screen, asked=(number, screen.asked[1]))
    if letter == "h":
        return replace(screen, asked=(screen.asked[0], number))
    return screen
