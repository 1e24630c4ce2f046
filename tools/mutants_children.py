"""The forked children of `make mutants`, each a pytest of its own."""

from __future__ import annotations

import contextlib
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, NoReturn

import pytest

if TYPE_CHECKING:
    from pathlib import Path

    from mutations import Mutation

WAIT_S = 180
"""Seconds until a child that waits counts as killed."""
QUICK = "not slow and not campaign and not arm64"


@dataclass
class Job:
    """A child: its tests, and for a mutant the change."""

    tests: list[str]
    log: Path
    path: Path | None = None
    place: int | None = None
    mutation: Mutation | None = None
    is_warm: bool = True
    reaching: int = 0
    limit_s: int = 0
    status: int = 0
    cpu_s: float = 0.0

    @property
    def verdict(self) -> str:
        """Return what the table says."""
        if not self.reaching:
            return "not reached"
        return "killed" if self.status else "SURVIVED"


def fork(jobs: list[Job]) -> Job | None:
    """Run each job in a child, one on each processor: give the child its job, and None to the parent when all ended."""
    waiting, running = [*jobs], dict[int, tuple[Job, float]]()
    while waiting or running:
        if waiting and len(running) < (os.cpu_count() or 1):
            job = waiting.pop(0)
            sys.stdout.flush()
            if (pid := os.fork()) == 0:
                os.setsid()
                folder = tempfile.mkdtemp(prefix="mutant-")
                os.environ.update(TMPDIR=folder, HYPOTHESIS_STORAGE_DIRECTORY=folder, MUTANT_FOLDER=folder)
                tempfile.tempdir = folder
                output = os.open(f"{job.log}", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
                os.dup2(output, 1)
                os.dup2(output, 2)
                if job.limit_s:
                    resource.setrlimit(resource.RLIMIT_CPU, (job.limit_s, job.limit_s))
                return job
            running[pid] = (job, time.monotonic())
        for pid, (job, begin) in [*running.items()]:
            if (time.monotonic() - begin) > WAIT_S and job.limit_s:
                os.killpg(pid, signal.SIGKILL)
            ended, status, usage = os.wait4(pid, os.WNOHANG)
            if ended:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(pid, signal.SIGKILL)
                job.status, job.cpu_s = os.waitstatus_to_exitcode(status), usage.ru_utime + usage.ru_stime
                del running[pid]
        time.sleep(0.01)
    return None


def run_pytest(words: list[str], plugin: object) -> int:
    """Run pytest in this process as `make quick` does, but for what it keeps."""
    options = ["-q", "-p", "no:cacheprovider", "-o", "timeout=60", "--hypothesis-seed=0", "-m", QUICK]
    return int(pytest.main([*options, *words], plugins=[plugin]))


def end_child(code: int) -> NoReturn:
    """End a forked child, whatever threads it has."""
    sys.stdout.flush()
    shutil.rmtree(os.environ["MUTANT_FOLDER"], ignore_errors=True)
    os._exit(code)
