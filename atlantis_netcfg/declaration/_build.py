"""From a block of values to a model: every error at its place, a misspelt key told once.

A misspelt key is told with the key that was meant, and the block is then read as if it had been spelt right.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

from pydantic import BaseModel, ValidationError

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.core.suggest import nearest
from atlantis_netcfg.declaration import _schema
from atlantis_netcfg.declaration._near import shown_key
from atlantis_netcfg.declaration._words import explain, label_of
from atlantis_netcfg.declaration.findings import Finding

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from atlantis_netcfg.declaration._node import Node

__all__ = ["build"]

_M = TypeVar("_M", bound=BaseModel)
_Path = tuple[str | int, ...]


def build(node: Node, model: type[_M], name: str) -> tuple[_M | None, Node, list[Finding]]:
    """The model of a block called `name`, or every error of it; and the block with its keys as they were meant."""
    findings: list[Finding] = []
    while True:
        try:
            return model.model_validate(node.data()), node, findings
        except ValidationError as error:
            errors = error.errors(include_url=False, include_input=False)
        unknown = [entry["loc"] for entry in errors if entry["type"] == "extra_forbidden"]
        if not unknown:
            break
        node = _fix_keys(unknown, node, model, name, findings)  # each round leaves fewer unknown keys, or deeper ones
    findings.extend(explain(item, node, model, name) for item in errors if not node.at(*item["loc"]).told)
    return None, node, findings


def _fix_keys(unknown: Iterable[_Path], node: Node, model: type[BaseModel], name: str, findings: list[Finding]) -> Node:
    """Tell unknown keys; give the node with them renamed to what was meant, or without them."""
    for path in unknown:
        parent, key = path[:-1], str(path[-1])
        inner = _schema.model_of(_schema.at(model, parent))
        known = list(inner.model_fields) if inner is not None else []
        block = node.at(*parent).keys
        meant, message, hint = _unknown(key, block, known, label_of(parent, name))
        findings.append(Finding.at(block[key].place, message, hint))
        secret = [field for field in known if _schema.unwrap(_schema.at(model, (*parent, field))) is Secret]
        unsure = any(field not in block and field != meant for field in secret)
        node = _renamed(node, parent, key, meant, is_reported=unsure)
    return node


def _unknown(key: str, block: Mapping[str, Node], known: list[str], where: str) -> tuple[str | None, str, str]:
    """The key that was meant, if that can be known, and what to say."""
    free = [field for field in known if field not in block]
    word = key.partition(" ")[0]
    if word != key and word in free and block[key].value is None:
        return word, f"a `:` is missing after `{word}`", f"write `{word}: …`"
    near = nearest(key, free)
    instead = f"remove `{shown_key(key)}`; the keys here are: {', '.join(known)}"
    message = f"{where} has no key `{shown_key(key)}`"
    return near, message, f"did you mean `{near}`?" if near is not None else instead


def _renamed(node: Node, path: _Path, old: str, new: str | None, *, is_reported: bool) -> Node:
    """The node with a key renamed, or without it. `told`: it may hold a secret, so no more is said."""
    if not path:
        keys = dict(node.keys)
        value = keys.pop(old)
        is_reported = is_reported or value.told or (" " in old and value.value is None)
        return replace(node, value=keys if new is None else {**keys, new: replace(value, told=is_reported)})
    step, rest = path[0], path[1:]
    if isinstance(node.value, list) and isinstance(step, int):
        items = list(node.value)
        items[step] = _renamed(items[step], rest, old, new, is_reported=is_reported)
        return replace(node, value=items)
    keys = dict(node.keys)
    keys[str(step)] = _renamed(keys[str(step)], rest, old, new, is_reported=is_reported)
    return replace(node, value=keys)
