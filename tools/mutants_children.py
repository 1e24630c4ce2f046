"""The forked children of `make mutants`, each a pytest of its own."""

from __future__ import annotations

import ast
import contextlib
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, cast

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable
    from importlib.machinery import ModuleSpec

    from mutations import Mutation

QUICK = "not slow and not campaign and not arm64"
WAITS = 4
"""A child may take as many times its limit of processor time until it counts as hanging."""


@dataclass
class Job:
    """A child: its tests, and for a mutant the change."""

    tests: list[str]
    log: Path
    path: Path | None = None
    place: int | None = None
    mutation: Mutation | None = None
    reaching: int = 0
    limit_s: int = 0
    status: int = 0
    cpu_s: float = 0.0
    wall_s: float = 0.0
    control: Job | None = None
    """The same tests without the change."""

    @property
    def begun(self) -> list[str]:
        """Return the tests that the child has begun."""
        file = self.log.with_suffix(".tests")
        return file.read_text().splitlines() if file.exists() else []

    @property
    def verdict(self) -> str:
        """Return what the table says. A control that nearly hangs says nothing about a mutant that hung."""
        if not self.reaching or not self.status:
            return "SURVIVED" if self.reaching else "not reached"
        slow = self.status == -signal.SIGKILL and self.control and self.control.wall_s * 3 > WAITS * self.limit_s
        return "killed" if self.control and not self.control.status and not slow else "not judged"


class Importer:
    """Compiles modules from a tree that `change` has changed."""

    def __init__(self, modules: list[Path], change: Callable[[int, ast.Module], object]) -> None:
        self._modules = {str(path): number for number, path in enumerate(modules)}
        self._change = change
        sys.meta_path.insert(0, self)

    def find_spec(self, name: str, path: object, target: object = None) -> ModuleSpec | None:
        """Return the usual spec; its loader compiles what we have changed."""
        finders: Any = [finder for finder in sys.meta_path if finder is not self]
        spec: Any = next(filter(None, (finder.find_spec(name, path, target) for finder in finders)), None)
        if spec is not None and (number := self._modules.get(spec.origin or "")) is not None:
            tree = ast.parse(Path(spec.origin).read_bytes())
            self._change(number, tree)
            spec.loader.get_code = lambda _: compile(ast.fix_missing_locations(tree), spec.origin, "exec")
        return cast("ModuleSpec | None", spec)


class Selection:
    """Runs the tests of a job, cheapest first, and notes those that begin."""

    def __init__(self, job: Job) -> None:
        self._job = job

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Keep all of them if none has kept its name."""
        order = {test: number for number, test in enumerate(self._job.tests)}
        items[:] = (
            sorted((item for item in items if item.nodeid in order), key=lambda item: order[item.nodeid]) or items
        )

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """Note each test."""
        with self._job.log.with_suffix(".tests").open("a") as file:
            file.write(f"{nodeid}\n")


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
