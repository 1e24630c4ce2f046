"""Every text in our source that looks like a command of RouterOS: what the engine and its neighbours can say."""

import ast
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from trees import ROOT

SPEAKERS = (
    "routeros",
    "console",
    "bootstrap",
    "packages",
    "operations",
    "cli",
    "bearers",
    "checklist/runner",
    "declaration",
    "render",
)
"""Packages whose texts may reach a router."""
OTHER_LANGUAGES = ("links/lte/at", "links/lte/modemmanager", "links/lte/rutos_")
"""Parts of these that speak to devices of other makes: paths of a Linux host, of D-Bus, of RutOS' web interface."""
_COMMAND = re.compile(r"^(?:/[a-z][a-z0-9-]*(?:[/ ].*)?|:[a-z]+ .*)$")
_SUFFIX = re.compile(r"^X/([a-z-]+)$")


@dataclass(frozen=True, slots=True)
class Literal:
    """One text, with `X` for what is put in at run time."""

    text: str
    file: str
    line: int


@cache
def literals() -> tuple[Literal, ...]:
    found: list[Literal] = []
    for package in SPEAKERS:
        for path in sorted((ROOT / "atlantis_netcfg" / package).rglob("*.py")):
            if not path.relative_to(ROOT / "atlantis_netcfg").as_posix().startswith(OTHER_LANGUAGES):
                found += _of_file(path)
    return tuple(found)


def _of_file(path: Path) -> Iterator[Literal]:
    tree = ast.parse(path.read_text("utf-8"))
    named = _constants(tree)
    skipped = set(_docstrings(tree)) | {id(part) for node in ast.walk(tree) for part in _inside(node)}
    for node in ast.walk(tree):
        if id(node) in skipped or not isinstance(node, ast.expr):
            continue
        text = _text(node, named)
        for offset, line in enumerate((text or "").splitlines()):
            if _COMMAND.match(line) or _SUFFIX.match(line):
                yield Literal(line, path.relative_to(ROOT).as_posix(), node.lineno + offset)


def sentences() -> Iterator[tuple[Literal, frozenset[str]]]:
    """Yield the paths of API sentences that are written out whole, with the names of their arguments."""
    for package in SPEAKERS:
        for path in sorted((ROOT / "atlantis_netcfg" / package).rglob("*.py")):
            tree = ast.parse(path.read_text("utf-8"))
            named = _constants(tree)
            for node in ast.walk(tree):
                if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Command":
                    said = _text(node.args[0], named) if node.args else None
                    pairs = [pair for other in node.args[1:] for pair in ast.walk(other) if isinstance(pair, ast.Tuple)]
                    names = {_text(pair.elts[0], named) for pair in pairs if pair.elts}
                    if said is not None and said.startswith("/"):
                        place = Literal(said, path.relative_to(ROOT).as_posix(), node.lineno)
                        yield place, frozenset(name for name in names if name)


def _constants(tree: ast.Module) -> dict[str, str]:
    """Return the texts that the module gives names to."""
    return {
        target.id: node.value.value
        for node in tree.body
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        for target in node.targets
        if isinstance(target, ast.Name)
    }


def _text(node: ast.expr, named: Mapping[str, str]) -> str | None:
    if isinstance(node, ast.Constant):
        value = node.value.decode("latin-1") if isinstance(node.value, bytes) else node.value
        return value if isinstance(value, str) else None
    if isinstance(node, ast.Name):
        return named.get(node.id)
    if isinstance(node, ast.JoinedStr):
        return "".join(_part(part, named) for part in node.values)
    return None


def _part(part: ast.expr, named: Mapping[str, str]) -> str:
    inner = part.value if isinstance(part, ast.FormattedValue) else part
    return _text(inner, named) or "X"


def _inside(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the constant parts of an f-string, which are read with the whole."""
    if isinstance(node, ast.JoinedStr):
        for part in node.values:
            if isinstance(part, ast.Constant):
                yield part


def _docstrings(tree: ast.AST) -> Iterator[int]:
    """Yield the ids of texts that are statements by themselves: they are read by people only."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            yield id(node.value)
