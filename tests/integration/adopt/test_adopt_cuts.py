"""First contact is cut at every command that it types, before and after, and repeated to success."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from carton import ROUTER, Carton, adopted_export, carton

from atlantis_netcfg.console import ConsoleLost
from atlantis_netcfg.console._terminal import Terminal
from atlantis_netcfg.errors import NetcfgError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path
    from typing import Any

pytestmark = pytest.mark.slow

COMMANDS = 62
"""At least as many as first contact types that change something."""
CHANGES = ("add", "set", "remove", "sign", "disable", "enable")
SAMPLE = [(number, when) for number in (0, 2, 3, 5, 8, 30, 60) for when in ("before", "after")]
ALL = [(number, when) for number in range(COMMANDS) for when in ("before", "after")]


class Scissors:
    """Cuts the connection at the n-th command that changes something."""

    def __init__(self, box: Carton, number: int, when: str) -> None:
        self.left, self.when, self.box, self.cut = number, when, box, False
        self.typed: list[str] = []

    def run(self, terminal: Terminal, command: str, **options: Any) -> str:  # noqa: ANN401 - passed on
        if not any(f" {word} " in command for word in CHANGES) or command.startswith(":put"):
            return RUN(terminal, command, **options)
        self.typed.append(command)
        here, self.left = self.left == 0, self.left - 1
        if here and self.when == "before":
            self._snip()
        said = RUN(terminal, command, **options)
        if here and self.when == "after":
            self._snip()
        return said

    def held(self) -> Callable[..., str]:
        """What stands in the place of the method: a function, so that the terminal comes first."""

        def run(terminal: Terminal, command: str, **options: Any) -> str:  # noqa: ANN401 - passed on
            return self.run(terminal, command, **options)

        return run

    def _snip(self) -> None:
        self.cut = True
        self.box.site.do(ROUTER, "drop")


RUN = Terminal.run


@pytest.fixture
def box(tmp_path: Path) -> Iterator[Carton]:
    with carton(tmp_path) as opened:
        yield opened


def cut_and_repeat(box: Carton, number: int, when: str, monkeypatch: pytest.MonkeyPatch) -> Scissors:
    scissors = Scissors(box, number, when)
    monkeypatch.setattr(Terminal, "run", scissors.held())
    with pytest.raises((NetcfgError, ConsoleLost)):
        box.adopt()
    assert scissors.cut
    monkeypatch.setattr(Terminal, "run", RUN)
    assert box.adopt().status in {"changed", "unchanged"}
    assert box.export() == adopted_export()
    assert box.adopt().status == "unchanged"
    return scissors


@pytest.mark.parametrize(("number", "when"), SAMPLE)
def test_a_cut_is_repeated(box: Carton, number: int, when: str, monkeypatch: pytest.MonkeyPatch) -> None:
    cut_and_repeat(box, number, when, monkeypatch)


@pytest.mark.campaign
@pytest.mark.parametrize(("number", "when"), ALL)
def test_every_cut_is_repeated(box: Carton, number: int, when: str, monkeypatch: pytest.MonkeyPatch) -> None:
    cut_and_repeat(box, number, when, monkeypatch)


def test_the_campaign_cuts_every_command(box: Carton, monkeypatch: pytest.MonkeyPatch) -> None:
    scissors = Scissors(box, -1, "never")
    monkeypatch.setattr(Terminal, "run", scissors.held())
    assert box.adopt().status == "changed"
    assert len(scissors.typed) == COMMANDS
