"""A value of the inventory and where it stands."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.secret import Secret

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.declaration.findings import Mark

Scalar = str | int | float | bool | date | Secret | None


@dataclass(frozen=True, slots=True)
class Node:
    """A value of the inventory and where it stands."""

    mark: Mark
    value: dict[str, Node] | list[Node] | Scalar
    text: str = ""
    """A scalar as it was typed."""
    plain: bool = False
    """A scalar without quotes: YAML may read it as something else than text."""
    key: Mark | None = None
    """Where the value's own key stands, if it has one."""
    reported: bool = False
    """Its error is told already: what it should have been cannot be known."""

    @property
    def keys(self) -> dict[str, Node]:
        """The values of a block; nothing for anything else."""
        return self.value if isinstance(self.value, dict) else {}

    @property
    def place(self) -> Mark:
        """Where a person looks for it: at its key, else at the value."""
        return self.key or self.mark

    def at(self, *path: str | int) -> Node:
        """What stands at a path, or the nearest above it that is written out (the rest are defaults)."""
        node = self
        for step in path:
            below: dict[Any, Node] = {}
            if isinstance(node.value, dict):
                below = node.value
            elif isinstance(node.value, list):
                below = dict(enumerate(node.value))
            if step not in below:
                break
            node = below[step]
        return node

    def data(self) -> Any:  # noqa: ANN401 - what YAML holds
        """The value without its places."""
        if isinstance(self.value, dict):
            return {key: node.data() for key, node in self.value.items()}
        if isinstance(self.value, list):
            return [node.data() for node in self.value]
        return self.value

    def scalars(self) -> Iterator[Node]:
        """Every scalar at or below this node."""
        if isinstance(self.value, dict):
            for node in self.value.values():
                yield from node.scalars()
        elif isinstance(self.value, list):
            for node in self.value:
                yield from node.scalars()
        else:
            yield self
