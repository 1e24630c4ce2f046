#!/usr/bin/env python3
"""Show which small faults in a part's code no quick test notices: `tools/mutants.py PART [NUMBER] [SEED]`.

A mutant is the code with one change: a comparison, an operator or a number swapped, a `not`, a returned value or a
statement left out. A random sample is tried, each in a forked child that changes the module as it imports it: no file
changes. A child runs the quick tests that reach the changed statement, cheapest first, up to a limit of processor time.
If they fail, those that it began are run once more without the change: only if they pass is the mutant killed.
Which test reaches which statement is recorded in build/mutants; after that only test files that have changed are
recorded again. What tests start as processes of their own is not mutated.
"""

from __future__ import annotations

import ast
import itertools
import os
import random
import shutil
import sys
from collections import Counter, defaultdict
from typing import TYPE_CHECKING, Any

from mutants_children import Importer, Job, Selection, end_child, fork, run_pytest
from mutants_reach import ROOT, record
from mutations import Mutation, mutations

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

PACKAGE = ROOT / "atlantis_netcfg"
ENGINE = ("integration/routeros/engine", "integration/routeros/pair", "unit/routeros/packages")
PARTS: dict[str, tuple[Sequence[str], Sequence[str], Sequence[str]]] = {
    "routeros": (("routeros",), ("routeros", "plan", "pair"), ENGINE),
    "rules": (("inventory/rules",), ("inventory", "errors"), ()),
    "vpn": (("vpn",), ("vpn", "vpn-server"), ()),
    "checklist": (("checklist",), ("checklist", "probes", "reports"), ()),
    "runs": (("runs",), ("journal", "operations", "reports"), ()),
}
"""A part's packages, its parts in tests/parts.txt, and further folders of tests."""
TESTS_S = 30.0
"""Processor seconds of tests that one mutant may cost, as recorded without it."""


def sample(modules: list[Path], number: int, seed: int) -> list[tuple[int, int, Mutation]]:
    """Draw mutations at random, as many of each kind: their module, their place in it."""
    kinds: defaultdict[str, list[tuple[int, int, Mutation]]] = defaultdict(list)
    for module, path in enumerate(modules):
        for place, mutation in enumerate(mutations(ast.parse(path.read_bytes()))):
            kinds[mutation.kind].append((module, place, mutation))
    chance = random.Random(seed)  # noqa: S311 - no secret
    for group in kinds.values():
        chance.shuffle(group)
    rounds = itertools.chain.from_iterable(itertools.zip_longest(*(kinds[kind] for kind in sorted(kinds))))
    return [*itertools.islice(filter(None, rounds), number)]


def plan(modules: list[Path], reach: dict[str, Any], drawn: list[tuple[int, int, Mutation]], folder: Path) -> list[Job]:
    """Choose the tests of each mutant: those that reach its statement; of what importing reaches, all of its module."""
    costs: dict[str, float] = {}
    tests: defaultdict[int, set[str]] = defaultdict(set)
    users: defaultdict[int, set[str]] = defaultdict(set)
    for test, (cost, hits) in itertools.chain.from_iterable(file["tests"].items() for file in reach["files"].values()):
        costs[test] = cost
        for hit in hits:
            tests[hit].add(test)
            users[hit >> 16].add(test)
    imported, jobs = {*reach["imported"]}, list[Job]()
    for module, place, mutation in drawn:
        number = module << 16 | mutation.statement
        reaching = tests[number] | ((users[module] or {*costs}) if number in imported else set())
        order = sorted(reaching, key=lambda test: (test not in tests[number], costs[test], test))
        limit = itertools.accumulate(costs[test] for test in order)
        chosen = [test for test, total in zip(order, limit, strict=True) if total <= TESTS_S] or order[:1]
        seconds = int(3 * sum(costs[test] for test in chosen)) + 20
        jobs.append(Job(chosen, folder / f"{len(jobs)}.log", modules[module], place, mutation, len(order), seconds))
    return jobs


def run(jobs: list[Job]) -> None:
    """Run each job's tests in a child that imports the changed module."""
    if (job := fork(jobs)) is not None:
        if job.path is not None:
            Importer([job.path], lambda _, tree: next(itertools.islice(mutations(tree), job.place, None)).apply())
        end_child(run_pytest(["-x", *sorted({test.partition("::")[0] for test in job.tests})], Selection(job)))


def judge(jobs: list[Job]) -> None:
    """Run what the failed ones began once more, without the change: a failure counts only if that passes."""
    controls: dict[tuple[str, ...], Job] = {}
    for job in [job for job in jobs if job.status]:
        tests = tuple(job.begun or job.tests[:1])
        control = Job([*tests], job.log.with_stem(f"{job.log.stem}-control"), limit_s=job.limit_s)
        job.control = controls.setdefault(tests, control)
        job.control.limit_s = max(job.control.limit_s, job.limit_s)
    run([*controls.values()])


def main(part: str = "", number: str = "60", seed: str = "1") -> int:
    """Try the mutants of a part and print the table."""
    if part not in PARTS:
        print("type: make mutants PART=NAME, where NAME is one of: " + " ".join(PARTS), file=sys.stderr)
        return 3
    os.chdir(ROOT)
    packages, names, further = PARTS[part]
    modules = [file for package in packages for file in sorted((PACKAGE / package).rglob("*.py"))]
    lines = [line.split() for line in (ROOT / "tests" / "parts.txt").read_text("utf-8").splitlines()]
    folders = [folder for name, *folders in lines if name in names for folder in folders]
    store = ROOT / "build" / "mutants" / f"{part}.json"
    store.parent.mkdir(parents=True, exist_ok=True)
    reach = record(modules, [f"tests/{folder}" for folder in (*folders, *further)], store)
    folder = store.with_suffix("")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    jobs = plan(modules, reach, sample(modules, int(number), int(seed)), folder)
    tried = [job for job in jobs if job.tests]
    run(tried)
    judge(tried)
    for job in jobs:
        if (mutation := job.mutation) is not None and job.path is not None:
            change = " ".join(f"{mutation.old[:70]} -> {mutation.new[:30]}".split())
            place = f"{job.path.relative_to(PACKAGE)}:{mutation.line}"
            tests = f"{len(job.tests)} of {job.reaching} tests, {job.cpu_s:.1f} s"
            print(f"{job.verdict:11}  {place:44} {mutation.kind:8} {change}  ({tests})")
    counts = Counter(job.verdict for job in jobs)
    print(", ".join(f"{counts[verdict]} {verdict}" for verdict in ("killed", "SURVIVED", "not judged", "not reached")))
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
