"""Which menus, commands and arguments a RouterOS version has: read from its own command trees, never guessed.

A version between two trees is held to the older one, so that the twin is at worst stricter than the device.
"""

from __future__ import annotations

import gzip
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

from atlantis_netcfg.twin.supplement import ADDED, BOARD_FEATURES, PACKAGE_MENUS, TAKEN_AWAY

__all__ = ["TREES", "Schema", "offered", "version_key"]

TREES = ("7.16", "7.18.2", "7.21.5")
_MENU_TYPES = ("dir", "path")
_PRINT_FORMS = ("getall", "listen")


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
    packed = resources.files("atlantis_netcfg.twin").joinpath("data", name).read_bytes()
    data: dict[str, Any] = json.loads(gzip.decompress(packed))
    return data


@cache
def offered(menu: str, argument: str) -> tuple[str, ...]:
    """Return the values that the console of 7.21.5 offers for an argument; free values are not among them."""
    values = _load("7.21.5.values.json.gz")
    found = values.get(f"{menu}/add {argument}") or values.get(f"{menu}/set {argument}") or []
    return tuple(value for value in found if value not in ("!", ",", "!,"))


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
        return max((tree for tree in TREES if self.at_least(tree)), key=version_key, default=TREES[0])

    def has_menu(self, menu: str) -> bool:
        """Tell whether `menu` is a menu of this router."""
        if menu == "/":
            return True
        node = self._node(menu)
        known = node is not None and node["_type"] in _MENU_TYPES
        return self._installed(menu) and (known or any(row.menu == menu for row in self._added()))

    def has_command(self, menu: str, command: str) -> bool:
        """Tell whether `menu` knows `command`; `getall` and `listen` are the API's forms of `print`."""
        if not self.has_menu(menu):
            return False
        command = "print" if command in _PRINT_FORMS else command
        if any(row.menu == menu and row.command == command for row in self._added()):
            return True
        return self._command(menu, command) is not None

    def arguments(self, menu: str, command: str) -> frozenset[str]:
        """Return the names that `command` takes."""
        return _arguments(self, menu, command)

    def find_arguments(self, menu: str, command: str) -> frozenset[str]:
        """Look the names up: what `arguments` remembers."""
        command = "print" if command in _PRINT_FORMS else command
        node = self._command(menu, command) or {}
        names = {name for name, child in node.items() if isinstance(child, Mapping) and child["_type"] == "arg"}
        names.update(*(row.arguments for row in self._added() if (row.menu, row.command) == (menu, command)))
        return frozenset(names)

    def commands(self, menu: str) -> frozenset[str]:
        """Return every command word of `menu`."""
        node = self._node(menu) or {}
        names = {name for name, child in node.items() if isinstance(child, Mapping) and child["_type"] == "cmd"}
        return frozenset(names | {row.command for row in self._added() if row.menu == menu})

    def submenus(self, menu: str) -> frozenset[str]:
        """Return the names of the menus directly below `menu`."""
        node = self._node(menu) or {}
        names = {name for name, child in node.items() if isinstance(child, Mapping) and child["_type"] in _MENU_TYPES}
        prefix = menu.rstrip("/") + "/"
        names.update(
            row.menu.removeprefix(prefix).split("/")[0] for row in self._added() if row.menu.startswith(prefix)
        )
        return frozenset(name for name in names if self._installed(prefix + name))

    def _command(self, menu: str, command: str) -> Mapping[str, Any] | None:
        if any((row.menu, row.command) == (menu, command) and not self.at_least(row.since) for row in TAKEN_AWAY):
            return None
        node = (self._node(menu) or {}).get(command)
        return node if isinstance(node, Mapping) and node["_type"] == "cmd" else None

    def _node(self, menu: str) -> Mapping[str, Any] | None:
        node: Any = _load(f"{self.tree}.json.gz")
        for part in menu.strip("/").split("/") if menu != "/" else ():
            node = node.get(part) if isinstance(node, Mapping) else None
        return node if isinstance(node, Mapping) else None

    def _added(self) -> Iterator[Any]:
        for row in ADDED:
            if self.at_least(row.since) and (row.feature is None or row.feature in self.features):
                yield row

    def _installed(self, menu: str) -> bool:
        for package, prefix in PACKAGE_MENUS:
            if (menu == prefix or menu.startswith(prefix + "/")) and package not in self.packages:
                return False
        return True


@cache
def _arguments(schema: Schema, menu: str, command: str) -> frozenset[str]:
    return schema.find_arguments(menu, command)


def features_of(board: str, *, poe: bool) -> frozenset[str]:
    """Return the board features of a router: every RouterBOARD is one, and PoE is what its spec says."""
    found = {"routerboard"} if not board.startswith("CHR") else set()
    return frozenset(found | ({"poe"} if poe else set())) & BOARD_FEATURES
