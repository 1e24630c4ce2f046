"""What a process cost: wall time, processor time and memory, its own children included."""

from __future__ import annotations

import os
import subprocess
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench.declared import CHECKOUT

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from bench.job import Command

__all__ = ["Cost", "Ran", "run", "run_command"]


@dataclass(frozen=True, slots=True)
class Cost:
    """One run of one command."""

    wall_s: float
    cpu_s: float
    """User and system time of the process and of all its children that it has waited for."""
    memory_kib: int
    """Peak resident memory of the largest of them (Linux: `ru_maxrss`)."""


@dataclass(frozen=True, slots=True)
class Ran:
    """How it ended."""

    cost: Cost
    code: int
    """Exit code; negative: the signal that ended it."""
    output: str
    """Stdout and stderr together."""


def run(
    command: Sequence[str], *, log: Path, environment: Mapping[str, str], folder: Path, patience_s: float = 1800.0
) -> Ran:
    """Run a command to its end and measure it from outside; it is killed when patience ends."""
    with log.open("wb") as buffered_writer:
        started = time.perf_counter()
        process = subprocess.Popen(  # noqa: S603 - the contenders' own commands
            command,
            env=environment,
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=buffered_writer,
            stderr=subprocess.STDOUT,
        )
        guard = threading.Timer(patience_s, process.kill)
        guard.start()
        try:
            _, status, usage = os.wait4(process.pid, 0)
        finally:
            guard.cancel()
        wall_s = time.perf_counter() - started
    code = process.returncode = os.waitstatus_to_exitcode(status)
    cost = Cost(wall_s, usage.ru_utime + usage.ru_stime, usage.ru_maxrss)
    return Ran(cost, code, log.read_text(encoding="utf-8", errors="replace"))


def run_command(command: Command, folder: Path) -> Ran:
    """Run what a contender asks for, in its own folder."""
    ours = {name: value for name, value in os.environ.items() if not name.startswith(("ANSIBLE_", "ATLANTIS_"))}
    environment = {**ours, "PYTHONPATH": str(CHECKOUT), "LC_ALL": "C.UTF-8", **command.environment}
    return run(command.argv, log=folder / "said.txt", environment=environment, folder=folder)
