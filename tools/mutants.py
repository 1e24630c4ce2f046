#!/usr/bin/env python3
"""Show which small faults in a part's code no quick test notices: `tools/mutants.py PART [NUMBER] [SEED]`.

A mutant is the code with one change: a comparison, an operator or a number swapped, a `not`, a returned value or a
statement left out. A random sample is tried, each in a forked child that replaces the code in memory: no file changes.
A child runs the quick tests that reach the changed statement, cheapest first, up to a limit of processor time. Which
test reaches which statement is recorded once, in build/mutants; after that only test files that have changed are
recorded again. What tests start as processes of their own is not mutated.
"""

from __future__ import annotations

import ast
import contextlib
import gc
import importlib
import itertools
import json
import os
import random
import shutil
import sys
from collections import Counter, defaultdict
from pathlib import Path
from types import CodeType, FunctionType
from typing import TYPE_CHECKING, Any

import pytest
from mutants_children import NOT_PATCHED, Job, end_child, fork, run_judged, run_pytest
from mutants_reach import ROOT, Importer, record
from mutations import Mutation, mutations

if TYPE_CHECKING:
    from collections.abc import Iterator

PACKAGE = ROOT / "atlantis_netcfg"
ENGINE = ("integration/engine", "integration/pair", "unit/packages")
PARTS = {
    "routeros": (
        ("routeros",),
        ("routeros", "plan", "pair"),
        ENGINE,
    ),
    "rules": (("declaration/rules",), ("declaration", "errors"), ()),
    "vpn": (("vpn",), ("vpn", "vpn-server"), ()),
    "checklist": (("checklist",), ("checklist", "probes", "reports"), ()),
    "runs": (("journal", "report"), ("journal", "operations", "reports"), ()),
}
"""A part's packages, its parts in tests/parts.txt, and further folders of tests."""
TESTS_S = 30.0
"""Processor seconds of tests that one mutant may cost, as recorded without it."""
PLUGINS = ("hypothesis", "xdist", "execnet", "pytest", "testinfra")
"""pytest loads them by itself, and wants to be the first to do so."""


class Session:
    """Goes on from a pytest that has collected all tests once to each mutant's child, with the tests of that mutant."""

    def __init__(self, jobs: list[Job]) -> None:
        self._jobs = jobs
        self.job: Job | None = None

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: Any) -> bool | None:  # noqa: ANN401 - as above
        """Fork; only children go on to the usual loop."""
        gc.unfreeze()
        functions: defaultdict[CodeType, list[FunctionType]] = defaultdict(list)
        for function in gc.get_objects():
            if isinstance(function, FunctionType) and function.__code__.co_filename.startswith(str(PACKAGE)):
                functions[function.__code__].append(function)
        items = {item.nodeid: item for item in session.items}
        if (job := run_judged([job for job in self._jobs if job.is_warm])) is None:
            return True
        self.job = job
        if job.path is not None and not patch(job, functions):
            os._exit(NOT_PATCHED)
        session.items = [items[test] for test in job.tests]
        session.config.option.maxfail = 1
        temporary = session.config._tmp_path_factory  # noqa: SLF001
        temporary._given_basetemp, temporary._basetemp = Path(os.environ["TMPDIR"]) / "tests", None  # noqa: SLF001
        return None

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """Note each test in a child."""
        if self.job is not None:
            self.job.begin(nodeid)


def patch(job: Job, functions: dict[CodeType, list[FunctionType]]) -> bool:
    """Give the functions of a module the code that they have in its mutant."""
    codes = []
    for change in (None, job.place):
        tree = mutated(job.path, change)
        codes.append([*code_objects(compile(tree, str(job.path), "exec"))])
    number = 0
    for old, new in zip(*codes, strict=False):
        for function in functions.get(old, []) if old != new else []:
            if function.__code__.co_filename == str(job.path):
                if len(new.co_freevars) != len(old.co_freevars):
                    return False
                function.__code__ = new
                number += 1
    return number > 0 and len(codes[0]) == len(codes[1])


def code_objects(code: CodeType) -> Iterator[CodeType]:
    """Walk a code object and those inside it."""
    yield code
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from code_objects(inner)


def mutated(path: Path | None, place: int | None) -> ast.Module:
    """Parse a module, with one change."""
    tree = ast.parse(path.read_bytes()) if path else ast.Module([], [])
    if place is not None:
        next(itertools.islice(mutations(tree), place, None)).apply()
    return ast.fix_missing_locations(tree)


def sample(modules: list[Path], number: int, seed: int) -> list[tuple[int, int, Mutation]]:
    """Draw mutations at random, as many of each kind: their module, their place in it."""
    kinds: defaultdict[str, list[tuple[int, int, Mutation]]] = defaultdict(list)
    for module, path in enumerate(modules):
        for place, mutation in enumerate(mutations(ast.parse(path.read_bytes()))):
            kinds[mutation.kind].append((module, place, mutation))
    chance = random.Random(seed)  # noqa: S311 - no secret
    for found in kinds.values():
        chance.shuffle(found)
    rounds = itertools.chain.from_iterable(itertools.zip_longest(*(kinds[kind] for kind in sorted(kinds))))
    return [*itertools.islice(filter(None, rounds), number)]


def plan(modules: list[Path], reach: dict[str, Any], drawn: list[tuple[int, int, Mutation]], folder: Path) -> list[Job]:
    """Choose the tests of each mutant."""
    costs = {test: cost for file in reach["files"].values() for test, (cost, _) in file["tests"].items()}
    tests: defaultdict[int, set[str]] = defaultdict(set)
    users: defaultdict[int, set[str]] = defaultdict(set)
    for file in reach["files"].values():
        for test, (_, hits) in file["tests"].items():
            for hit in hits:
                tests[hit].add(test)
                users[hit >> 16].add(test)
    imported, jobs = {*reach["imported"]}, list[Job]()
    for module, place, mutation in drawn:
        number = module << 16 | mutation.statement
        reaching = {*tests[number]}
        if number in imported:
            reaching |= users[module] or {*costs}
        order = sorted(reaching, key=lambda test: (test not in tests[number], costs[test], test))
        limit = itertools.accumulate(costs[test] for test in order)
        chosen = [test for test, total in zip(order, limit, strict=True) if total <= TESTS_S] or order[:1]
        seconds = int(3 * sum(costs[test] for test in chosen)) + 10
        log = folder / f"{len(jobs)}.log"
        jobs.append(Job(chosen, log, modules[module], place, mutation, number not in imported, len(order), seconds))
    return jobs


class Selection:
    """Leaves out the tests that do not concern a mutant, and notes those that begin."""

    def __init__(self, job: Job) -> None:
        self._job = job

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Keep all of them if none has kept its name."""
        items[:] = [item for item in items if item.nodeid in self._job.tests] or items

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """Note each test."""
        self._job.begin(nodeid)


def run(jobs: list[Job], report: Path) -> None:
    """Run warm mutants in forks of one pytest that has imported all, and the others in pytests of their own."""
    if fork([Job([], report.with_name("warm.log"))]) is not None:
        session = Session(jobs)
        code = run_pytest(
            sorted({test.partition("::")[0] for job in jobs if job.is_warm for test in job.tests}), session
        )
        if session.job is None:
            report.write_text(json.dumps([[job.status, job.cpu_s, job.verdict] for job in jobs]))
        end_child(code)
    if not report.exists():
        sys.exit(report.with_name("warm.log").read_text()[-3000:])
    for job, (status, cpu_s, verdict) in zip(jobs, json.loads(report.read_text()), strict=True):
        job.status, job.cpu_s, job.verdict = status, cpu_s, verdict
        job.is_warm = job.is_warm and status != NOT_PATCHED
    if (mine := run_judged([job for job in jobs if not job.is_warm])) is not None:
        if mine.path is not None:
            Importer([mine.path], lambda _, tree: next(itertools.islice(mutations(tree), mine.place, None)).apply())
        files = {test.partition("::")[0] for test in mine.tests}
        end_child(run_pytest(["-x", *sorted(files)], Selection(mine)))


def main(part: str = "", number: str = "60", seed: str = "1") -> int:
    """Try the mutants of a part and print the table."""
    if part not in PARTS:
        print("type: make mutants PART=NAME, where NAME is one of: " + " ".join(PARTS), file=sys.stderr)
        return 3
    os.chdir(ROOT)
    packages, names, further = PARTS[part]
    modules = [file for package in packages for file in sorted((PACKAGE / package).rglob("*.py"))]
    lines = [line.split() for line in (ROOT / "tests" / "parts.txt").read_text("utf-8").splitlines()]
    folders = [f"tests/{folder}" for name, *folders in lines if name in names for folder in folders]
    store = ROOT / "build" / "mutants" / f"{part}.json"
    store.parent.mkdir(parents=True, exist_ok=True)
    reach = record(modules, [*folders, *(f"tests/{folder}" for folder in further)], store)
    for library in reach["libraries"]:
        if not any(plugin in library for plugin in PLUGINS):
            with contextlib.suppress(Exception):
                importlib.import_module(library)
    folder = store.with_suffix("")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    jobs = plan(modules, reach, sample(modules, int(number), int(seed)), folder)
    run([job for job in jobs if job.tests], folder / "report.json")
    return show(jobs)


def show(jobs: list[Job]) -> int:
    """Print the table."""
    for job in jobs:
        if (mutation := job.mutation) is not None and job.path is not None:
            change = " ".join(f"{mutation.old[:70]} -> {mutation.new[:30]}".split())
            tests = f"{len(job.tests)} of {job.reaching}"
            place = f"{job.path.relative_to(PACKAGE)}:{mutation.line}"
            print(f"{job.verdict:11}  {place:44} {mutation.kind:8} {change}  ({tests} tests, {job.cpu_s:.1f} s)")
    counts = Counter(job.verdict for job in jobs)
    print(", ".join(f"{counts[verdict]} {verdict}" for verdict in ("killed", "SURVIVED", "not judged", "not reached")))
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
