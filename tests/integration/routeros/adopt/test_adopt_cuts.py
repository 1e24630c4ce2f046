"""First contact is cut at every command that it types, before and after, and repeated to success."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from carton import CHANGES, ROUTER, Carton, adopted_export, carton

from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.routeros.console.terminal import Terminal
from atlantis_netcfg.routeros.console.types import ConsoleLost

pytestmark = pytest.mark.slow

COMMANDS = 62
"""At least as many as first contact types that change something."""
SAMPLE = [(0, "after"), (3, "before"), (60, "after")]
KILLED = [(8, "before"), (40, "after")]
ALL = [(number, when) for number in range(COMMANDS) for when in ("before", "after")]


class Scissors:
    """Cuts the connection at the n-th command that changes something."""

    def __init__(self, box: Carton, number: int, when: str) -> None:
        self.left, self.when, self.box, self.cut = number, when, box, False
        self.typed: list[str] = []

    def run(self, terminal: Terminal, command: str, **options: Any) -> str:  # noqa: ANN401 - passed on
        if CHANGES.search(command) is None or command.startswith(":put"):
            return RUN(terminal, command, **options)
        self.typed.append(command)
        here, self.left = self.left == 0, self.left - 1
        if here and self.when == "before":
            self._snip(terminal)
        said = RUN(terminal, command, **options)
        if here and self.when == "after":
            self._snip(terminal)
        return said

    def held(self) -> Callable[..., str]:
        """What stands in the place of the method: a function, so that the terminal comes first."""

        def run(terminal: Terminal, command: str, **options: Any) -> str:  # noqa: ANN401 - passed on
            return self.run(terminal, command, **options)

        return run

    def _snip(self, terminal: Terminal) -> None:
        """SSH is reset under both ends; a serial line is pulled out, and whoever is logged in there stays so."""
        self.cut = True
        if self.box.serial:
            terminal._wire.close()
        else:
            self.box.site.do(ROUTER, "drop")


RUN = Terminal.run


@pytest.fixture(params=[False, True], ids=["ssh", "serial"])
def box(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Carton]:
    with carton(tmp_path, serial=request.param) as opened:
        yield opened


def cut_and_repeat(box: Carton, number: int, when: str, monkeypatch: pytest.MonkeyPatch) -> Scissors:
    scissors = Scissors(box, number, when)
    monkeypatch.setattr(Terminal, "run", scissors.held())
    with pytest.raises((NetcfgError, ConsoleLost)):
        box.adopt()
    assert scissors.cut
    monkeypatch.setattr(Terminal, "run", RUN)
    repeated(box)
    return scissors


def kill_and_repeat(box: Carton, number: int, when: str) -> None:
    info = dict(box.site.do(ROUTER, "info"))
    via = f"serial:{info['serial']}" if box.serial else "ssh"
    child = Path(__file__).with_name("adopt_child.py")
    typed = [sys.executable, "-P", str(child), json.dumps(info), str(box.state), via, str(number), when]
    paths = [str(child.parent), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}
    done = subprocess.run(typed, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr
    repeated(box)


def repeated(box: Carton) -> None:
    assert box.adopt().status in {"changed", "unchanged"}
    assert box.export() == adopted_export()
    assert box.adopt().status == "unchanged"


@pytest.mark.parametrize(("number", "when"), SAMPLE)
def test_sample_of_interrupted_adoptions_can_be_repeated(
    box: Carton, number: int, when: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    cut_and_repeat(box, number, when, monkeypatch)


@pytest.mark.campaign
@pytest.mark.parametrize(("number", "when"), ALL)
def test_every_interrupted_adoption_can_be_repeated(
    box: Carton, number: int, when: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    cut_and_repeat(box, number, when, monkeypatch)


@pytest.mark.parametrize(("number", "when"), KILLED)
def test_sample_of_killed_adoptions_can_be_repeated(box: Carton, number: int, when: str) -> None:
    kill_and_repeat(box, number, when)


@pytest.mark.campaign
@pytest.mark.parametrize(("number", "when"), ALL)
def test_every_killed_adoption_can_be_repeated(box: Carton, number: int, when: str) -> None:
    kill_and_repeat(box, number, when)


def test_the_campaign_cuts_every_command(box: Carton, monkeypatch: pytest.MonkeyPatch) -> None:
    scissors = Scissors(box, -1, "never")
    monkeypatch.setattr(Terminal, "run", scissors.held())
    assert box.adopt().status == "changed"
    assert len(scissors.typed) == COMMANDS
