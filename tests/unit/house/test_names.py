"""No name of a private language comes back: participles for values, metaphors, `one` for a row (docs/glossary.md)."""

import ast
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from atlantis_netcfg.core.paths import checkout

RETIRED = frozenset(
    {
        *("told", "asked", "wanted", "said", "heard", "one", "own", "held", "came", "looked"),
        *("desk", "yard", "toll", "shield", "ear", "wish", "keeper", "sitting", "rob"),
    }
)
FOLDERS = ("atlantis_netcfg", "bench", "checks", "tools")
_KEY = "a key of files that users hold"
ALLOWED = {
    ("atlantis_netcfg/computers/bundle/manifest.py", "held"): _KEY,
}
"""Each with its reason. A row whose name is gone goes too."""


def names(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Names of classes, functions and arguments, and of all that something is assigned to."""
    for node in ast.walk(tree):
        match node:
            case ast.ClassDef(name=name) | ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                yield name, node.lineno
            case ast.arg(arg=name):
                yield name, node.lineno
            case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
                yield name, node.lineno
            case ast.alias(asname=str(name)):
                yield name, node.lineno
            case ast.ExceptHandler(name=str(name)) | ast.MatchAs(name=str(name)) | ast.MatchStar(name=str(name)):
                yield name, node.lineno


def retired(tree: ast.AST) -> Iterator[tuple[str, int]]:
    return ((name, line) for name, line in names(tree) if name.strip("_").lower() in RETIRED)


def test_no_retired_name_is_used() -> None:
    root = checkout()
    listed = subprocess.run(["git", "ls-files", *FOLDERS], cwd=root, check=True, capture_output=True, text=True)
    found = {
        (path, name): line
        for path in listed.stdout.split()
        if path.endswith(".py") and (root / path).exists()
        for name, line in retired(ast.parse((root / path).read_text(encoding="utf-8")))
    }
    assert not [f"{path}:{line}: `{name}`" for (path, name), line in found.items() if (path, name) not in ALLOWED]
    assert not ALLOWED.keys() - found.keys(), "their names are gone: so should these rows"
    assert len(ALLOWED) <= 40


@pytest.mark.parametrize(
    "text",
    [
        *("def told(): pass", "class _Wish: pass", "def f(*, asked=1): pass", "for one in (): pass"),
        *("x = [own for own in ()]", "self.heard = 1", "import a as Held", "try: pass\nexcept E as held: pass"),
        *("match x:\n case [*said]: pass", "f = lambda one: one"),
    ],
)
def test_retired_name_is_found_in_every_kind_of_definition(text: str) -> None:
    assert len(list(retired(ast.parse(text)))) == 1


def test_glossary_terms_avoid_retired_words() -> None:
    page = Path(checkout(), "docs", "glossary.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| ")]
    terms = [row.split("|")[1].strip() for row in rows[1:]]
    assert 30 <= len(terms) <= 60
    assert not {term.lower() for term in terms} & RETIRED
    assert terms == sorted(terms, key=str.lower)


SAME = {
    "ActionModule": "Ansible's name for the class of an action plugin",
    "CallbackModule": "Ansible's name for the class of a callback plugin",
    **dict.fromkeys(
        ("CertificateMismatch", "CertificateUnknown", "HostKeyMismatch"), "a pin, of one kind of device each"
    ),
    "Crl": "the revocation list, here and on the server",
    "DesiredState": "what a device or a computer shall hold, as the planner of each has it",
    "Data": "the frozen base of a file's models",
    "Spec": "the frozen base of an emulated device's models",
    **dict.fromkeys(("Decoder", "Packet", "Trap"), "the same thing, as the engine and as the emulated router have it"),
    "Direction": "up or down",
    "Repository": "a source of the library, as it is declared and as the module of the collection is given it",
    "Shape": "of a menu: one row, rows, or a fixed set of them",
}
"""Classes of one name and one meaning, each with what they mean."""


def test_class_names_are_unique_except_listed_ones() -> None:
    places: dict[str, list[str]] = {}
    for path in (checkout() / "atlantis_netcfg").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef):
                places.setdefault(node.name.lstrip("_"), []).append(str(path.relative_to(checkout())))
    several = {name: found for name, found in places.items() if len(found) > 1}
    assert {name: found for name, found in several.items() if name not in SAME} == {}
    assert SAME.keys() <= several.keys()
