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

WAITS = 4
"""A child may take as many times its limit of processor time until it counts as hanging."""
NOT_PATCHED = 77
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
    wall_s: float = 0.0
    verdict: str = "not reached"

    @property
    def begun(self) -> list[str]:
        """Return the tests that the child has begun."""
        file = self.log.with_suffix(".tests")
        return file.read_text().splitlines() if file.exists() else []

    def begin(self, test: str) -> None:
        """Note a test in the child, before it runs."""
        with self.log.with_suffix(".tests").open("a") as file:
            file.write(f"{test}\n")

    def judge(self, control: Job | None) -> None:
        """A failure counts only if the same tests pass, within the same limits, without the change."""
        hung = self.status == -signal.SIGKILL and control is not None and control.wall_s * 3 > WAITS * self.limit_s
        is_sure = control is not None and control.status == 0 and not hung
        self.verdict = "SURVIVED" if not self.status else "killed" if is_sure else "not judged"


def run_judged(jobs: list[Job]) -> Job | None:
    """Run mutants as `fork` does; then, for those that failed, the tests that they began, without the change."""
    if (job := fork(jobs)) is not None:
        return job
    controls: dict[tuple[str, ...], Job] = {}
    for job in jobs:
        if job.status not in (0, NOT_PATCHED):
            tests = tuple(job.begun or job.tests[:1])
            log = job.log.with_stem(f"{job.log.stem}-control")
            control = Job([*tests], log, is_warm=job.is_warm, limit_s=job.limit_s)
            if tests not in controls or controls[tests].limit_s < job.limit_s:
                controls[tests] = control
    if (job := fork([*controls.values()])) is not None:
        return job
    for job in jobs:
        job.judge(controls.get(tuple(job.begun or job.tests[:1])))
    return None


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
            job.wall_s = time.monotonic() - begin
            if job.limit_s and job.wall_s > WAITS * job.limit_s:
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
    options = ["-q", "-p", "no:cacheprovider", "--hypothesis-seed=0", "-m", QUICK]
    return int(pytest.main([*options, *words], plugins=[plugin]))


def end_child(code: int) -> NoReturn:
    """End a forked child, whatever threads it has."""
    sys.stdout.flush()
    shutil.rmtree(os.environ["MUTANT_FOLDER"], ignore_errors=True)
    os._exit(code)
