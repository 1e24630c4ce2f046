"""What was in the files when a step or a unit last succeeded, so that no kill between two acts loses one.

A stamp maps a path to the SHA-256 of what was in it. Callers compare and write only their own paths: two roles may
look after one unit.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING
from urllib.parse import quote

if TYPE_CHECKING:
    from typing import Mapping

    from .tree import Tree

__all__ = ["ABSENT", "FOLDER", "Stamps"]

FOLDER = "/var/lib/atlantis/applied"
ABSENT = "absent"
"""In place of a digest: there is no such file."""
_BEGUN = "begun"


class Stamps:
    """The stamps of a computer, one file each."""

    def __init__(self, tree: Tree) -> None:
        self.tree = tree

    def holds(self, name: str, desired: Mapping[str, str]) -> bool:
        """Whether the last success was with just this; what is not there, and never was, needs none."""
        noted = self._noted(name)
        return all(noted.get(path, ABSENT) == digest for path, digest in desired.items())

    def begin(self, name: str, desired: Mapping[str, str]) -> None:
        """Forget the last success before the act begins: an act that fails or is killed is done again."""
        self._write(name, {**self._noted(name), **dict.fromkeys(desired, _BEGUN)})

    def note(self, name: str, desired: Mapping[str, str]) -> None:
        """Note a success."""
        self._write(name, {**self._noted(name), **desired})

    def _noted(self, name: str) -> dict[str, str]:
        try:
            noted = json.loads(self.tree.read(self._path(name)) or b"{}")
        except ValueError:
            return {}
        return noted if isinstance(noted, dict) else {}

    def _write(self, name: str, noted: Mapping[str, str]) -> None:
        self.tree.write(self._path(name), json.dumps(noted, sort_keys=True).encode())

    @staticmethod
    def _path(name: str) -> str:
        return f"{FOLDER}/{quote(name, safe=' @:')}"
