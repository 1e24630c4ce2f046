"""Imports go down the layers of docs/engineers/architecture.md."""

import ast
import re
from graphlib import TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).parents[3]
PACKAGE = ROOT / "atlantis_netcfg"


def layers() -> dict[str, int]:
    block = re.search(r"```layers\n(.*?)```", (ROOT / "docs" / "engineers" / "architecture.md").read_text(), re.DOTALL)
    assert block is not None
    return {name: depth for depth, line in enumerate(block[1].splitlines()) for name in line.split(", ")}


def imports() -> set[tuple[str, str, str]]:
    """Each import of another part: file, the part it is in, the part that it imports."""
    found, parts = set(), layers()
    for path in PACKAGE.rglob("*.py"):
        inside = _part(path.relative_to(ROOT).with_suffix("").parts)
        for node in ast.walk(ast.parse(path.read_text())):
            for module in _modules(node):
                part = _part(tuple(module.split(".")))
                if part != inside and (part in parts or (PACKAGE / f"{part}.py").exists()):
                    found.add((str(path.relative_to(ROOT)), inside, part))
    return found


def _part(names: tuple[str, ...]) -> str:
    """The folder below the package; what goes to a computer alone is a part of its own, below all others."""
    return "module_utils" if names[1] == "ansible_collections" and "module_utils" in names else names[1]


def _modules(node: ast.AST) -> list[str]:
    if isinstance(node, ast.ImportFrom) and node.module:
        names = [f"{node.module}.{alias.name}" for alias in node.names]
    elif isinstance(node, ast.Import):
        names = [alias.name for alias in node.names]
    else:
        names = []
    return [name for name in names if name.startswith("atlantis_netcfg.")]


def test_every_part_is_in_a_layer() -> None:
    folders = {path.name for path in PACKAGE.iterdir() if path.is_dir() and any(path.rglob("*.py"))}  # not data alone
    folders |= {path.name for path in PACKAGE.rglob("module_utils")}
    parts = folders | {path.stem for path in PACKAGE.glob("*.py")}
    assert {part for part in parts if not part.startswith("__")} == layers().keys()


def test_imports_only_go_to_lower_layers() -> None:
    depth = layers()
    upward = [
        f"{path}: {inside} imports {part}"
        for path, inside, part in sorted(imports())
        if inside in depth and depth[inside] >= depth[part]
    ]
    assert upward == []


def graph() -> dict[str, set[str]]:
    """Each module and the modules that it imports anywhere, those that only types or a function need included."""
    files = {path: _dotted(path) for path in PACKAGE.rglob("*.py")}
    found: dict[str, set[str]] = {name: set() for name in files.values()}
    for path, name in files.items():
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom):
                module = _absolute(node, path)
                names = (f"{module}.{alias.name}" for alias in node.names)
                found[name] |= {each if each in found else module for each in names} & found.keys() - {name}
    return found


def _dotted(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def _absolute(node: ast.ImportFrom, path: Path) -> str:
    if not node.level:
        name = node.module or ""
        return f"atlantis_netcfg.{name}" if name.startswith("ansible_collections.atlantis.") else name
    package = path.relative_to(ROOT).parts[: -node.level]
    return ".".join([*package, *([node.module] if node.module else [])])


def test_there_are_no_import_cycles() -> None:
    found = graph()
    assert sum(map(len, found.values())) > 2 * len(found)
    TopologicalSorter(found).prepare()  # CycleError names the circle
