"""Which menus, commands and arguments a RouterOS version has: read from its own command trees, never guessed.

From 7.16 to 7.24 every published tree is there. A version between two of them is held to the older one, so that the
twin is at worst stricter than the device; a version beyond the newest is held to that (`versions.NEWEST_KNOWN`).
Versions below 7.16 have the tree of 7.16 less what is known to be newer (`boundaries.py`); what else RouterOS 6 lacks,
or had and lost, no published tree tells.
"""

from __future__ import annotations

import gzip
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

from atlantis_netcfg.emulator.routeros.boundaries import BOUNDARIES, Boundary
from atlantis_netcfg.emulator.routeros.supplement import ADDED, BOARD_FEATURES, PACKAGE_MENUS, WITHIN_ROUTEROS

__all__ = ["TREES", "Schema", "needed", "offered", "version_key"]

_FIRST = {"7.18.2": "7.18"}
"""The first version with the very tree of a later one: 7.18 and 7.18.1 are identical to 7.18.2."""
_WHOLE = ("7.16", "7.18.2", "7.21.5")
"""Trees that are files of their own; of the others the changes are kept (`data/README.md`)."""
_MENU_TYPES = ("dir", "path")
_PRINT_FORMS = ("getall", "listen")
_NEEDED, _OLDEST_NEEDED = "required.json", "7.20.8"


@cache
def version_key(version: str) -> tuple[int, ...]:
    """Make `7.18.2` comparable; `7.19beta2` and `7.19rc1` are below 7.19."""
    match = re.match(r"(\d+)\.(\d+)(?:\.(\d+))?(?:(beta|rc)(\d+))?", version)
    if match is None:
        raise ValueError(f"not a RouterOS version: {version}")
    major, minor, patch, stage, build = match.groups()
    return int(major), int(minor), int(patch or 0), {"beta": 0, "rc": 1}.get(stage, 2), int(build or 0)


@cache
def _load(name: str) -> dict[str, Any]:
    packed = resources.files("atlantis_netcfg.emulator.routeros").joinpath("data", name).read_bytes()
    data: dict[str, Any] = json.loads(gzip.decompress(packed))
    return data


@cache
def _tree(version: str) -> dict[str, Any]:
    if version in _WHOLE:
        return _load(f"{version}.json.gz")
    step = _load("changes.json.gz")[version]
    return _patched(_tree(step["after"]), step["change"])


def _patched(node: Mapping[str, Any], patch: Mapping[str, Any]) -> dict[str, Any]:
    """Apply a JSON merge patch (RFC 7396); what it leaves alone is shared with the older tree."""
    result = dict(node)
    for name, child in patch.items():
        if child is None:
            result.pop(name, None)
        elif isinstance(child, dict):
            old = result.get(name)
            result[name] = _patched(old if isinstance(old, dict) else {}, child)
        else:
            result[name] = child
    return result


TREES = tuple(sorted((*_WHOLE, *_load("changes.json.gz")), key=version_key))
"""Versions with a tree, from the oldest to the newest."""


@cache
def offered(menu: str, argument: str) -> tuple[str, ...]:
    """Return the values that the console of 7.21.5 offers for an argument; free values are not among them."""
    values = _load("7.21.5.values.json.gz")
    found = values.get(f"{menu}/add {argument}") or values.get(f"{menu}/set {argument}") or []
    return tuple(value for value in found if value not in ("!", ",", "!,"))


@cache
def needed(version: str, menu: str) -> tuple[str, ...] | str:
    """Return the arguments without which `add` is refused, or the words said to an `add` with no argument at all.

    As devices of three versions said it; an older device is held to the oldest of them.
    Assumption: offered-values
    """
    found: list[str] | str = []
    data = json.loads(resources.files("atlantis_netcfg.emulator.routeros").joinpath("data", _NEEDED).read_bytes())
    for recorded, rows in data.items():
        if recorded == _OLDEST_NEEDED or version_key(version) >= version_key(recorded):
            found = rows.get(menu, found)
    return found if isinstance(found, str) else tuple(found)


@dataclass(frozen=True, slots=True)
class Schema:
    """The vocabulary of one router: its version's tree, its packages, and what its board adds."""

    version: str
    packages: tuple[str, ...] = ("routeros",)
    features: frozenset[str] = frozenset()
    """Of `supplement.BOARD_FEATURES`: what a Cloud Hosted Router lacks and this board has."""

    def at_least(self, version: str) -> bool:
        """Tell whether the router runs `version` or a newer one."""
        return version_key(self.version) >= version_key(version)

    @property
    def tree(self) -> str:
        """The newest shipped tree that is not newer than the router; the oldest for older routers."""
        return _newest(self)

    def has_menu(self, menu: str) -> bool:
        """Tell whether `menu` is a menu of this router."""
        return menu == "/" or _has_menu(self, menu)

    def has_command(self, menu: str, command: str) -> bool:
        """Tell whether `menu` knows `command`; `getall` and `listen` are the API's forms of `print`."""
        command = "print" if command in _PRINT_FORMS else command
        return self.has_menu(menu) and command in _commands(self, menu)

    def arguments(self, menu: str, command: str) -> frozenset[str]:
        """Return the names that `command` takes."""
        return _arguments(self, menu, "print" if command in _PRINT_FORMS else command)

    def commands(self, menu: str) -> frozenset[str]:
        """Return every command word of `menu`."""
        return _commands(self, menu) if self.has_menu(menu) else frozenset()

    def submenus(self, menu: str) -> frozenset[str]:
        """Return the names of the menus directly below `menu`."""
        prefix = menu.rstrip("/") + "/"
        names = {name for name, child in self._children(menu) if child["_type"] in _MENU_TYPES}
        names.update(path.removeprefix(prefix).split("/")[0] for path in _words(self).added if path.startswith(prefix))
        return frozenset(name for name in names if self.has_menu(prefix + name))

    def _children(self, menu: str) -> Iterator[tuple[str, Mapping[str, Any]]]:
        for name, child in (self._node(menu) or {}).items():
            if isinstance(child, Mapping):
                yield name, child

    def _node(self, menu: str) -> Mapping[str, Any] | None:
        node: Any = _tree(self.tree)
        for part in menu.strip("/").split("/") if menu != "/" else ():
            node = node.get(part) if isinstance(node, Mapping) else None
        return node if isinstance(node, Mapping) else None

    def _installed(self, menu: str) -> bool:
        for package, prefix in PACKAGE_MENUS:
            if (menu == prefix or menu.startswith(prefix + "/")) and package not in self.packages:
                return package in WITHIN_ROUTEROS and not self.at_least(WITHIN_ROUTEROS[package])
        return True


@dataclass(frozen=True, slots=True)
class _Words:
    """How the vocabulary of a router differs from the tree that it is held to."""

    added: Mapping[str, Mapping[str, frozenset[str]]]
    """By menu and command: arguments."""
    lacking: frozenset[tuple[str, str, str]]
    """Menu, command, argument; the last two are empty where the whole menu, the last where the whole command lacks."""


@cache
def _words(schema: Schema) -> _Words:
    added: dict[str, dict[str, frozenset[str]]] = {}
    lacking: set[tuple[str, str, str]] = set()
    for row in ADDED:
        if schema.at_least(row.since) and (row.feature is None or row.feature in schema.features):
            _add(added, row.menu, row.command, row.arguments)
    for boundary in BOUNDARIES:
        if not schema.at_least(boundary.since):
            lacking.update(_cells(boundary))
    return _Words(added, frozenset(lacking))


def _cells(row: Boundary) -> Iterator[tuple[str, str, str]]:
    for command in row.commands or ("",):
        for name in row.arguments or ("",):
            yield row.menu, command, name


def _add(added: dict[str, dict[str, frozenset[str]]], menu: str, command: str, names: Iterable[str]) -> None:
    commands = added.setdefault(menu, {})
    commands[command] = commands.get(command, frozenset()) | frozenset(names)


def _lacks(words: _Words, menu: str) -> bool:
    parts = menu.split("/")
    return any(("/".join(parts[:end]), "", "") in words.lacking for end in range(2, len(parts) + 1))


@cache
def _newest(schema: Schema) -> str:
    fitting = (tree for tree in TREES if schema.at_least(_FIRST.get(tree, tree)))
    return max(fitting, key=version_key, default=TREES[0])


@cache
def _has_menu(schema: Schema, menu: str) -> bool:
    words = _words(schema)
    if not schema._installed(menu) or _lacks(words, menu):  # noqa: SLF001
        return False
    node = schema._node(menu)  # noqa: SLF001
    return (node is not None and node["_type"] in _MENU_TYPES) or menu in words.added


@cache
def _commands(schema: Schema, menu: str) -> frozenset[str]:
    words = _words(schema)
    names = {name for name, child in schema._children(menu) if child["_type"] == "cmd"}  # noqa: SLF001
    names.update(words.added.get(menu, ()))
    return frozenset(name for name in names if (menu, name, "") not in words.lacking)


@cache
def _arguments(schema: Schema, menu: str, command: str) -> frozenset[str]:
    if not schema.has_menu(menu) or command not in _commands(schema, menu):
        return frozenset()
    words = _words(schema)
    node = (schema._node(menu) or {}).get(command, {})  # noqa: SLF001
    names = {name for name, child in node.items() if isinstance(child, Mapping) and child["_type"] == "arg"}
    names |= words.added.get(menu, {}).get(command, frozenset())
    return frozenset(name for name in names if (menu, command, name) not in words.lacking)


def features_of(board: str, *, poe: bool) -> frozenset[str]:
    """Return the board features of a router: every RouterBOARD is one, and PoE is what its spec says."""
    found = {"routerboard"} if not board.startswith("CHR") else set()
    return frozenset(found | ({"poe"} if poe else set())) & BOARD_FEATURES
