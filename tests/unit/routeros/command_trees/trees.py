"""RouterOS' command trees, read raw: nothing of the twin's reader is used, so that a fault there cannot hide."""

import gzip
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from atlantis_netcfg.core.versions import Version

ROOT = Path(__file__).parents[4]
SHIPPED = ROOT / "atlantis_netcfg" / "emulator" / "routeros" / "data"
VERSIONS = ("7.16", "7.18.2", "7.21.5", "7.24")
"""Those that the twin is compared with word by word."""
WHOLE = ("7.16", "7.18.2", "7.21.5")

Node = dict[str, Any]


@cache
def _loaded(name: str) -> Node:
    data: Node = json.loads(gzip.decompress((SHIPPED / name).read_bytes()))
    return data


@cache
def offered() -> dict[str, list[str]]:
    """What the console of 7.21.5 offers, by `/menu/command argument`."""
    return _loaded("7.21.5.values.json.gz")


def steps() -> Node:
    """What each version changed on the tree of another one: JSON merge patches (RFC 7396)."""
    return _loaded("changes.json.gz")


@cache
def grown(version: str) -> Node:
    """The tree of a version: a file, or the changes from there on, applied one by one."""
    if version in WHOLE:
        return _loaded(f"{version}.json.gz")
    step = steps()[version]
    return apply(grown(step["after"]), step["change"])


def apply(node: Node, patch: Node) -> Node:
    kept = {name: child for name, child in node.items() if patch.get(name, ...) is not None}
    given = {name: child for name, child in patch.items() if child is not None}
    both = {name: apply(kept.get(name) or {}, child) for name, child in given.items() if isinstance(child, dict)}
    return {**kept, **given, **both}


PUBLISHED = tuple(sorted((*WHOLE, *steps()), key=Version.parse))
"""Every published tree from 7.16 on that differs from the one before it."""


@dataclass(frozen=True, slots=True)
class Tree:
    """The vocabulary of one version. Paths are in the form of the API: `/ip/address`; the root is `/`."""

    version: str

    @property
    def root(self) -> Node:
        return grown(self.version)

    def node(self, words: Sequence[str]) -> Node | None:
        found: Any = self.root
        for word in words:
            found = found.get(word) if isinstance(found, dict) else None
        return found if isinstance(found, dict) else None

    def kind(self, words: Sequence[str]) -> str | None:
        """`menu`, `cmd`, `arg`, or None where there is nothing."""
        if not words:
            return "menu"
        node = self.node(words)
        if node is None:
            return None
        return "menu" if node["_type"] in ("dir", "path") else str(node["_type"])

    def has_menu(self, menu: str) -> bool:
        return self.kind(parts(menu)) == "menu"

    def has_command(self, menu: str, command: str) -> bool:
        return self.kind([*parts(menu), command]) == "cmd"

    def commands(self, menu: str) -> frozenset[str]:
        return self._names(parts(menu), "cmd")

    def arguments(self, menu: str, command: str) -> frozenset[str]:
        return self._names([*parts(menu), command], "arg")

    def settable(self, menu: str) -> frozenset[str]:
        """Arguments of `add` and `set` that are values of a row, not ways to name one."""
        return (self.arguments(menu, "add") | self.arguments(menu, "set")) - {"numbers", "copy-from", "place-before"}

    def shape(self, menu: str) -> str:
        """How a menu holds rows, as its commands tell: `list`, `fixed` or `settings`."""
        if "add" in self.commands(menu):
            return "list"
        return "fixed" if "numbers" in self.arguments(menu, "set") else "settings"

    def menus(self) -> Iterator[str]:
        yield from self._below((), self.root)

    def _below(self, words: tuple[str, ...], node: Node) -> Iterator[str]:
        for name, child in node.items():
            if isinstance(child, dict) and child["_type"] in ("dir", "path"):
                yield "/" + "/".join((*words, name))
                yield from self._below((*words, name), child)

    def _names(self, words: Sequence[str], kind: str) -> frozenset[str]:
        node = self.node(words) or {}
        return frozenset(name for name, child in node.items() if isinstance(child, dict) and child["_type"] == kind)


def parts(menu: str) -> list[str]:
    return [word for word in menu.split("/") if word]


TREES = tuple(Tree(version) for version in VERSIONS)
EVERY_TREE = tuple(Tree(version) for version in PUBLISHED)
