"""Code and documentation do not grow unnoticed: tests/data/limits.yml."""

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from statistics import median, quantiles

import pytest
import yaml

CHECKOUT = Path(__file__).parents[3]
LIMITS: dict[str, dict[str, float]] = yaml.safe_load((CHECKOUT / "tests/data/limits.yml").read_text(encoding="utf-8"))
SLACK = {"lines": 500, "files": 10, "names": 20, "imports": 0.3, "functions": 5, "neighbours": 100, "words": 3_000}
"""So far below its limit: lower it."""
GENERATED = {"docs/findings.md", "docs/engineers/benchmarks.md", "docs/engineers/satcom.md"}
WITH_GENERATED_TABLES = {"docs/inventory.md", "docs/engineers/assumptions.md"}
"""Pages that a program writes, and pages of which it writes the tables."""


def _set(words: str) -> frozenset[str]:
    return frozenset(words.split())


IRREGULAR = _set("""
    begun called paid told typed chosen given found known left kept held seen made sent said taken gone come shown
    written drawn worn heard meant asked wanted done lost won built bought caught taught thought felt dealt driven
    forgotten grown hidden laid led lain lit met ridden risen sold sung sunk sat slept spoken spent stood stolen struck
    sworn torn thrown understood woken
    """)
NO_PARTICIPLES = _set("speed need feed seed embed thread shed indeed exceed breed weed")


def is_participle(name: str) -> bool:
    """Whether a name is a participle and nothing else, which says what happened to a thing and not what it is."""
    word = name.strip("_").lower()
    is_regular = word.endswith("ed") and len(word) > 4 and word not in NO_PARTICIPLES
    return "_" not in word and (word in IRREGULAR or is_regular)


def files(part: str) -> list[Path]:
    """Every module of a part."""
    return list((CHECKOUT / part).rglob("*.py"))


def documentation_words(root: Path) -> int:
    """Words with a letter or a digit that people write in the pages: what a program writes is left out."""
    words = 0
    for page in [*root.glob("*.md"), *root.glob("docs/**/*.md")]:
        name, lines = str(page.relative_to(root)), page.read_text(encoding="utf-8").splitlines()
        if name not in GENERATED:
            written = (line for line in lines if name not in WITH_GENERATED_TABLES or not line.startswith("|"))
            words += sum(re.search(r"\w", word) is not None for line in written for word in line.split())
    return words


@cache
def trees(part: str) -> list[ast.Module]:
    """Every module of a part, parsed."""
    return [ast.parse(file.read_text(encoding="utf-8")) for file in files(part)]


def names(part: str) -> Iterator[tuple[bool, str]]:
    """Every name that a part gives, with whether it is the name of a function or a class."""
    for tree in trees(part):
        for node in ast.walk(tree):
            match node:
                case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
                    yield True, name
                case ast.arg(arg=name) | ast.Name(id=name, ctx=ast.Store()):
                    yield False, name


def imported_names(tree: ast.Module) -> int:
    """How many names of this package a module imports."""
    found = (node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom))
    return sum(len(node.names) for node in found if (node.module or "").startswith("atlantis_netcfg"))


def longest_function(part: str) -> int:
    """Lines of the longest function of a part."""
    nodes = (node for tree in trees(part) for node in ast.walk(tree))
    functions = (node for node in nodes if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))
    return max((node.end_lineno or 0) - node.lineno + 1 for node in functions)


def lines_with_neighbours(part: str) -> list[int]:
    """Lines of every file together with what it imports, also for types, and with what imports it: one step."""
    modules = {str(file.relative_to(CHECKOUT).with_suffix("")).removesuffix("/__init__"): file for file in files(part)}
    neighbours: defaultdict[Path, set[Path]] = defaultdict(set)
    for file in modules.values():
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                module = node.module.replace("ansible_collections.atlantis", f"{part}.ansible_collections.atlantis")
                for alias in node.names:
                    place = f"{module}.{alias.name}".replace(".", "/")
                    if other := modules.get(place) or modules.get(place.rpartition("/")[0]):
                        neighbours[file].add(other)
                        neighbours[other].add(file)
    lines = {file: len(file.read_bytes().splitlines()) for file in modules.values()}
    return [sum(lines[other] for other in {file, *neighbours[file]}) for file in lines]


def measured(kind: str) -> dict[str, float]:
    """What stands in the tree now, for each limit of a kind."""
    parts = LIMITS[kind]
    match kind:
        case "lines":
            return {part: sum(len(file.read_bytes().splitlines()) for file in files(part)) for part in parts}
        case "files":
            return {part: len(files(part)) for part in parts}
        case "names":
            participles = [is_definition for is_definition, name in names("atlantis_netcfg") if is_participle(name)]
            return {"participles": len(participles), "named functions and classes": sum(participles)}
        case "imports":
            return {part: sum(map(imported_names, trees(part))) / len(trees(part)) for part in parts}
        case "neighbours":
            lines = lines_with_neighbours("atlantis_netcfg")
            return {"median": median(lines), "90th percentile": quantiles(lines, n=10)[-1]}
    return {part: documentation_words(CHECKOUT) if kind == "words" else longest_function(part) for part in parts}


@pytest.mark.parametrize("kind", SLACK)
def test_nothing_exceeds_or_is_far_below_its_limit(kind: str) -> None:
    now, limits = measured(kind), LIMITS[kind]
    assert {part: value for part, value in now.items() if not limits[part] - SLACK[kind] <= value <= limits[part]} == {}


def test_every_limit_has_a_slack() -> None:
    assert LIMITS.keys() == SLACK.keys()


def test_words_of_generated_pages_and_tables_are_not_counted(tmp_path: Path) -> None:
    for name in ("README.md", "docs/pt/page.md", "docs/inventory.md", *GENERATED):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("- two words …\n\n| a | table |\n|---|---|\n")
    assert documentation_words(tmp_path) == 4 + 4 + 2
    assert [name for name in GENERATED if not (CHECKOUT / name).is_file()] == []


@pytest.mark.parametrize(
    ("names_", "expected"), [(("found", "_ended", "Refused"), True), (("speed", "is_signed", "rows", "bed"), False)]
)
def test_participles_are_recognised(names_: tuple[str, ...], *, expected: bool) -> None:
    assert {is_participle(name) for name in names_} == {expected}
