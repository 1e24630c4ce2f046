"""Reading of the toolkit's other YAML files, as strictly as the inventory: errors with lines and suggestions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

from pydantic import BaseModel

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory._yaml import Node, parse
from atlantis_netcfg.inventory.findings import Finding, Mark, choices, suggest
from atlantis_netcfg.inventory.loader import build

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["Block", "choices", "read", "suggest"]

_M = TypeVar("_M", bound=BaseModel)
_BYTES = 1_000_000


@dataclass(frozen=True, slots=True)
class Block(Generic[_M]):
    """A parsed file with its findings; the value is None if it is invalid."""

    value: _M | None
    """Parsed value; None: it has errors, see the findings."""
    findings: tuple[Finding, ...]
    root: Node

    def wrong(self, path: tuple[str | int, ...], message: str, hint: str) -> Finding:
        """Return a finding at a value; for a block, at its key."""
        node = self.root.at(*path)
        return Finding.at(node.place if isinstance(node.value, dict | list) else node.mark, message, hint)

    def wrong_key(self, path: tuple[str | int, ...], message: str, hint: str) -> Finding:
        """Return a finding at a key."""
        return Finding.at(self.root.at(*path).place, message, hint)


def read(path: Path, model: type[_M], name: str) -> Block[_M]:
    """Read a file that errors call `name`; raise UsageError if it cannot be read."""
    root, findings = parse(_bytes(path, name), str(path), None)
    start = Mark(str(path), 1, 1)
    if root is None:
        empty = Finding.at(start, "the file is empty", msg(f"its keys are: {arg(join(', ', model.model_fields))}"))
        return Block(None, tuple(findings or [empty]), Node(start, {}))
    if not isinstance(root.value, dict):
        wrong = Finding.at(
            root.mark, "the file must contain a block of keys", msg(f"they are: {arg(join(', ', model.model_fields))}")
        )
        return Block(None, (*findings, wrong), root)
    value, root, more = build(root, model, name)
    return Block(value, (*findings, *more), root)


def _bytes(path: Path, name: str) -> bytes:
    try:
        with path.open("rb") as file:
            data = file.read(_BYTES + 1)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise UsageError(
            f"{arg(name)} cannot be read: {arg(path)}: {arg(why)}", hint="give the path of the file"
        ) from error
    if len(data) > _BYTES:
        raise UsageError(
            f"{arg(path)} is larger than 1 MB, so it is not a file of this program", hint="give the path of the file"
        )
    return data
