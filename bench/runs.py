"""What a computer's earlier runs cost: our commands that search them, after ten of them and after a thousand."""

from __future__ import annotations

import sys
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.runs import Outcome, RunEnd, RunStart, Store
from bench import measure
from bench.declared import CHECKOUT, ROUTER, SITE
from bench.figures import Runs
from bench.job import Command

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

__all__ = ["kept_runs"]

_COMMANDS = {"report runs": ExitCode.DONE, "recover resume": ExitCode.NOTHING}
"""Our commands, and how they end where no run is unfinished."""
_STARTED = RunStart(site=SITE, revision="", tool="", hosts=(ROUTER,), rehearsed=False, command="provision")


def kept_runs(sizes: Sequence[int], calls: int, folder: Path) -> Iterator[Runs]:
    """Measure each command so many times on a state of each size, by turns; every run has changed one router."""
    states = {size: _state(folder / f"runs-{size}", size) for size in sizes}
    for command, code in _COMMANDS.items():
        ran = [(size, _call(command, state)) for _ in range(calls) for size, state in states.items()]
        for size in sizes:
            mine = [figure for of, figure in ran if of == size]
            failure = next((entry.output.strip() for entry in mine if entry.code != code), "")
            yield Runs(command, size, tuple(item.cost for item in mine), failure)


def _state(state: Path, size: int) -> Path:
    state.mkdir()
    moments = iter(datetime(2026, 1, 1, tzinfo=UTC) + timedelta(seconds=each) for each in range(10 * size))
    store = Store(state, now=lambda: next(moments))
    for number in range(size):
        with store.start(replace(_STARTED, revision=str(number))) as journal:
            journal.save(ROUTER, "# before\n")
            journal.confirm(ROUTER, lambda: "# after\n")
            journal.write(Outcome(device=ROUTER, status="changed", exit=0, message=""))
            journal.write(RunEnd(exit=0))
    return state


def _call(command: str, state: Path) -> measure.Ran:
    words = [sys.executable, "-P", "-m", "atlantis_netcfg", *command.split(), f"site={SITE}"]
    if command == "recover resume":
        words.append(f"inventory={CHECKOUT / 'inventory'}")
    environment = {"ATLANTIS_STATE": str(state), "ANSIBLE_CONFIG": str(CHECKOUT / "ansible.cfg")}
    return measure.run_command(Command(tuple(words), environment), state)
