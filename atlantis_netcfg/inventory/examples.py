"""Values of an inventory that are still examples: marked `# EXAMPLE`, or of a form that nobody can own."""

from __future__ import annotations

import re
from dataclasses import dataclass
from ipaddress import AddressValueError, IPv4Address, IPv4Network
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.secret import EXAMPLE_PREFIX

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from atlantis_netcfg.inventory._yaml import Node
    from atlantis_netcfg.inventory.findings import Mark

DOCUMENTATION = tuple(IPv4Network(net) for net in ("192.0.2.0/24", "198.51.100.0/24", "203.0.113.0/24"))
"""Networks for documentation (RFC 5737)."""
_NAMES = ("example", "example.com", "example.net", "example.org", "test", "invalid")
"""Domain names for examples and tests (RFC 2606)."""
_ENDINGS = tuple(f".{name}" for name in _NAMES)
SSH_KEY = "this SSH key"


@dataclass(frozen=True, slots=True, order=True)
class Example:
    """An example value that has not been replaced yet."""

    file: str
    line: int
    column: int
    key: str
    """Key of the value, or of the list that contains it."""
    recognised: str | None = None
    """Evidence that it is an example, for values that need no mark; None: it is marked."""


def by_line(examples: Iterable[Example]) -> list[str]:
    """Group examples by file line, with their keys; file names are relative to the inventory."""
    lines: dict[str, list[str]] = {}
    for example in examples:
        place = re.sub(r"^.*?(?=(?:group|host)_vars/)", "", example.file)
        lines.setdefault(f"{place}:{example.line}", []).append(f"`{example.key}`")
    return [f"{place} {', '.join(dict.fromkeys(keys))}" for place, keys in lines.items()]


def examples_in(nodes: Iterable[Node]) -> tuple[Example, ...]:
    """Return all examples at or below the nodes, sorted by place."""
    return tuple(sorted({example for node in nodes for example in _walk_examples(node, "")}))


def _walk_examples(node: Node, key: str) -> Iterator[Example]:
    if isinstance(node.value, dict):
        for name, value in node.value.items():
            yield from _walk_examples(value, name)
    elif isinstance(node.value, list):
        for item in node.value:
            yield from _walk_examples(item, key)
    else:
        reason = recognise(node.value)
        if node.example or reason:
            yield _example(node.mark, key, reason)


def _example(mark: Mark, key: str, reason: str | None) -> Example:
    return Example(mark.file, mark.line, mark.column, key, reason)


def recognise(value: object) -> str | None:
    """Return why a value is recognisably an example, or None."""
    text = value if isinstance(value, str) else ""
    if text.startswith(EXAMPLE_PREFIX):
        return msg(f"a value that starts with {arg(EXAMPLE_PREFIX)}")
    if text.startswith(("ssh-", "ecdsa-", "sk-")) and " EXAMPLE" in text:
        return SSH_KEY
    if text.lower() in _NAMES or text.lower().rstrip(".").endswith(_ENDINGS):
        return msg(f"{arg(text)} (a name of RFC 2606)")
    try:
        address = IPv4Address(text.partition("/")[0].strip())
    except AddressValueError:
        return None
    if any(address in block for block in DOCUMENTATION):
        return msg(f"{arg(text.strip())} (a documentation address, RFC 5737)")
    return None
