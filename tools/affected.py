"""Run the tests that import what has changed: `tools/affected.py [REVISION] [WORDS OF PYTEST]`.

A test file imports what it, its helpers and the modules behind them import, at their tops or inside functions; a string
that names a module of ours counts, as processes are started by it. Of files that are not Python only those beside a
module or a test are followed; the others are named, and `make test` covers them.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MODULE = re.compile(r"atlantis_netcfg(\.\w+)*|bench(\.\w+)*")


def main(revision: str, *words: str) -> int:
    """Run pytest on the affected files; end as it does, or with 0 where nothing is affected."""
    changes = changed_files(revision)
    imports = {path: imported_files(path) for path in python_files()}
    starts = {near for change in changes for near in near_modules(change, imports)}
    unknown = sorted(change for change in changes if not near_modules(change, imports) and change.suffix != ".md")
    if unknown:
        print("not followed, `make test` covers them:", *(path.relative_to(ROOT) for path in unknown), sep="\n  ")
    tests = [path for path in imports if path.name.startswith("test_") and starts & reachable(path, imports)]
    if not tests:
        print("no test imports what has changed")
        return 0
    print(f"{len(tests)} test files import what has changed since {revision}")
    command = [sys.executable, "-P", "-m", "pytest", "-q", "-n", "auto", "--dist", "loadfile", "--tier", "test"]
    return subprocess.run([*command, *sorted(map(str, tests)), *words], cwd=ROOT, check=False).returncode


def changed_files(revision: str) -> set[Path]:
    """Files that differ from where this branch left `revision`, those that git does not track included."""
    base = _git("merge-base", revision, "HEAD")[0]
    names = _git("diff", "--name-only", base) + _git("ls-files", "--others", "--exclude-standard")
    return {ROOT / name for name in names}


def python_files() -> list[Path]:
    """All modules of the checkout that git knows or would add."""
    names = _git("ls-files", "--cached", "--others", "--exclude-standard", "*.py")
    return [ROOT / name for name in names if (ROOT / name).is_file()]


def _git(*words: str) -> list[str]:
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"error: git {' '.join(words)}: {done.stderr.strip()}")
    return done.stdout.splitlines()


def near_modules(change: Path, modules: dict[Path, set[Path]]) -> set[Path]:
    """Give the modules that stand for a changed file: itself, or those of its folder where it is data of theirs."""
    if change in modules:
        return {change}
    if change.suffix == ".py":  # deleted: what imported it has changed too, or fails to import
        return set()
    return {module for module in modules if module.parent in change.parents and module.parent != ROOT / "tests"}


def imported_files(path: Path) -> set[Path]:
    """Give the files of ours that a module imports itself."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            folder = path.relative_to(ROOT).parts[: -node.level] if node.level else ()
            module = ".".join([*folder, *([node.module] if node.module else [])])
            names |= {module} | {f"{module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and MODULE.fullmatch(node.value):
            names.add(node.value)
    return {file for name in names for file in _files(name.removeprefix("ansible_collections."), path)}


def _files(name: str, importer: Path) -> set[Path]:
    """Give the file of a module and the packages above it; a bare name is a helper of the tests."""
    parts = name.split(".")
    if parts[0] == "atlantis":  # of the collection, by Ansible's name
        parts = ["atlantis_netcfg", "ansible_collections", *parts]
    found = {ROOT.joinpath(*parts[:depth], "__init__.py") for depth in range(1, len(parts))}
    found |= {ROOT.joinpath(*parts).with_suffix(".py"), ROOT.joinpath(*parts, "__init__.py")}
    if len(parts) == 1:
        near = importer.parent / f"{name}.py"
        found |= {near} if near.is_file() else _helpers().get(name, set())
    return {file for file in found if file.is_file()}


@cache
def _helpers() -> dict[str, set[Path]]:
    helpers: dict[str, set[Path]] = {}
    for path in (ROOT / "tests").rglob("*.py"):
        helpers.setdefault(path.stem, set()).add(path)
    return helpers


def reachable(path: Path, imports: dict[Path, set[Path]]) -> set[Path]:
    """Give a module and all that it imports, near and far."""
    seen, todo = {path}, [path]
    while todo:
        new = imports.get(todo.pop(), set()) - seen
        seen |= new
        todo += new
    return seen


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
