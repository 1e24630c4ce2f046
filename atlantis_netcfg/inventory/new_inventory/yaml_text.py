"""YAML as a person would write it: keys in the order given, comments, marked examples, vaulted secrets."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Network

import yaml

Scalar = str | int | float | bool | IPv4Address | IPv4Network | None


@dataclass(frozen=True, slots=True)
class Value:
    """A YAML value with the comment that follows it on its line."""

    value: Scalar | tuple[Scalar, ...]
    is_example: bool = False
    comment: str = ""


@dataclass(frozen=True, slots=True)
class VaultSecret:
    """A secret as an already encrypted Ansible Vault text."""

    text: str


Tree = Mapping[str, "Tree"] | Sequence["Tree"] | Value | VaultSecret | Scalar


def has_examples(tree: Tree) -> bool:
    """Return whether any value in the tree is an example."""
    if isinstance(tree, Mapping):
        return any(has_examples(below) for below in tree.values())
    if isinstance(tree, Value | VaultSecret | str) or not isinstance(tree, Sequence):
        return isinstance(tree, Value) and tree.is_example
    return any(has_examples(below) for below in tree)


def document(tree: Mapping[str, Tree], comments: Sequence[str]) -> str:
    """Render a YAML file: comments, `---`, the tree."""
    return "\n".join([*comments, "---", *_mapping(tree, 0)]) + "\n"


def _mapping(tree: Mapping[str, Tree], depth: int) -> Iterator[str]:
    for key, below in tree.items():
        yield from _entry(f"{'  ' * depth}{key}:", below, depth)


def _entry(start: str, below: Tree, depth: int) -> Iterator[str]:
    """Render a key or list dash with the value behind it or the block below it."""
    if isinstance(below, VaultSecret):
        yield f"{start} !vault |"
        yield from (f"{'  ' * (depth + 1)}{line}" for line in below.text.splitlines())
    elif isinstance(below, Mapping) and below:
        yield start
        yield from _mapping(below, depth + 1)
    elif isinstance(below, Sequence) and not isinstance(below, str) and below:
        yield start
        for item in below:
            yield from _item(item, depth + 1)
    else:
        yield f"{start} {_inline(below)}"


def _item(item: Tree, depth: int) -> Iterator[str]:
    if not isinstance(item, Mapping):
        yield from _entry(f"{'  ' * depth}-", item, depth)
        return
    lines = list(_mapping(item, depth + 1))
    yield f"{'  ' * depth}- {lines[0].lstrip()}"
    yield from lines[1:]


def _inline(below: Tree) -> str:
    if isinstance(below, Value):
        comment = "; ".join(part for part in (below.comment, "EXAMPLE" if below.is_example else "") if part)
        return _scalar(below.value) + (f" # {comment}" if comment else "")
    if isinstance(below, Mapping):
        return "{}"
    if isinstance(below, Sequence) and not isinstance(below, str):
        return "[]"
    assert not isinstance(below, VaultSecret)  # noqa: S101 - written by `_entry`
    return _scalar(below)


def _scalar(value: Scalar | tuple[Scalar, ...]) -> str:
    """Render a scalar as YAML; quote a text that would be read as another type."""
    if isinstance(value, tuple):
        return "[" + ", ".join(_scalar(item) for item in value) + "]"
    if value is None or isinstance(value, bool | int | float):
        return str(yaml.safe_dump(value)).partition("\n")[0]
    text = str(value)
    if text in {"off", "on", "yes", "no"}:
        return f'"{text}"'
    return str(yaml.safe_dump(text, width=1_000_000, allow_unicode=True)).partition("\n")[0]
