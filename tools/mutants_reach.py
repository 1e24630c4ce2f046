"""The record of `make mutants`: which test reaches which statement."""

from __future__ import annotations

import ast
import hashlib
import json
import os
import sys
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from mutants_children import Importer, Job, end_child, fork, run_pytest
from mutations import bodies, statements

if TYPE_CHECKING:
    from collections.abc import Generator

ROOT = Path(__file__).resolve().parents[1]


class Recorder:
    """Records which statements each test reaches."""

    def __init__(self, modules: list[Path]) -> None:
        self.hits: set[int] = set()
        self.imported: list[int] = []
        self.tests: dict[str, tuple[float, list[int]]] = {}
        self._shared: defaultdict[str, set[int]] = defaultdict(set)
        sys.modules["builtins"].__dict__["__reach__"] = self.hits.add
        Importer(modules, self._instrument)

    @staticmethod
    def _instrument(module: int, tree: ast.Module) -> None:
        numbers = {id(node): number for number, node in enumerate(statements(tree))}
        for body in [*bodies(tree)]:
            for place in range(len(body) - 1, -1, -1):
                node = body[place]
                text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
                if not text and not (isinstance(node, ast.ImportFrom) and node.module == "__future__"):
                    hit = ast.parse(f"__reach__({module << 16 | numbers[id(node)]})").body[0]
                    body.insert(place, ast.copy_location(hit, node))

    def pytest_collection_finish(self) -> None:
        """What importing reaches belongs to no test."""
        self.imported = sorted(self.hits)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Generator[None, object, object]:  # noqa: ANN401 - as pytest has it
        """Keep what a fixture of many tests reaches for each of them."""
        before = set(self.hits)
        self.hits.clear()
        try:
            return (yield)
        finally:
            if fixturedef.scope != "function":
                self._shared[fixturedef.argname] |= self.hits
            self.hits |= before

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: Any) -> Generator[None, object, object]:  # noqa: ANN401 - as above
        """Keep what a test reaches, if it passes."""
        self.hits.clear()
        failures, begin = item.session.testsfailed, sum(os.times()[:4])
        result = yield
        if item.session.testsfailed == failures:
            reached = self.hits.union(*(self._shared[name] for name in item.fixturenames))
            self.tests[item.nodeid] = (sum(os.times()[:4]) - begin, sorted(reached))
        return result


def digest(files: list[Path]) -> str:
    """Return one digest of several files."""
    return hashlib.sha256(b"".join(str(file).encode() + file.read_bytes() for file in files)).hexdigest()


def record(modules: list[Path], folders: list[str], store: Path) -> dict[str, Any]:
    """Bring the record of a part up to date: which test reaches which statement."""
    files = [file for folder in folders for file in sorted((ROOT / folder).rglob("*")) if file.is_file()]
    tests = {str(file.relative_to(ROOT)): digest([file]) for file in files if file.match("test_*.py")}
    base = digest([*modules, *(file for file in files if file.suffix == ".py" and not file.match("test_*.py"))])
    kept = json.loads(store.read_text()) if store.exists() else {}
    if kept.get("base") != base:
        kept = {"base": base, "imported": [], "files": {}}
    kept["files"] = {name: file for name, file in kept["files"].items() if tests.get(name) == file["digest"]}
    missing = [name for name in tests if name not in kept["files"]]
    halves = [Job(missing[number::2], log=store.with_name(f"{store.stem}-{number}.log")) for number in range(2)]
    if (job := fork([half for half in halves if half.tests])) is not None:
        recorder = Recorder(modules)
        run_pytest(job.tests, recorder)
        job.log.write_text("\n" + json.dumps([recorder.imported, recorder.tests]))
        end_child(0)
    for half in [half for half in halves if half.tests]:
        imported, reached = json.loads(half.log.read_text().splitlines()[-1])
        kept["imported"] = sorted({*kept["imported"], *imported})
        for name in half.tests:
            tests_of_file = {test: row for test, row in reached.items() if test.partition("::")[0] == name}
            kept["files"][name] = {"digest": tests[name], "tests": tests_of_file}
    store.write_text(json.dumps(kept))
    return kept
