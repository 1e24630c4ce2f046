"""Descriptions of the model's keys, from its source, for the editors' schema and the key reference."""

from __future__ import annotations

import ast
import inspect
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING

from atlantis_netcfg.inventory import _schema

if TYPE_CHECKING:
    from pydantic import BaseModel


@cache
def field_docs(model: type[BaseModel]) -> dict[str, str]:
    """Return the docstrings of a model's fields, inherited ones included."""
    docs: dict[str, str] = {}
    for cls in reversed(model.__mro__):
        if not cls.__module__.startswith(f"{_schema.MODEL}."):
            continue
        (definition,) = ast.parse(inspect.getsource(cls)).body
        body = definition.body if isinstance(definition, ast.ClassDef) else []
        for field, below in pairwise(body):
            if not isinstance(below, ast.Expr) or not isinstance(below.value, ast.Constant):
                continue
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                docs[field.target.id] = str(below.value.value)
    return docs


def key_description(model: type[BaseModel], name: str) -> str:
    """Return a key's description, else that of its block or choice; empty if there is none."""
    annotation = model.model_fields[name].annotation
    item = _schema.item_of(annotation)
    inner = _schema.unwrap(annotation if item is None else item)
    is_ours = isinstance(inner, type) and inner.__module__.startswith(f"{_schema.MODEL}.")
    words = field_docs(model).get(name) or (inspect.getdoc(inner) if is_ours else None)
    return sentence(words) if words else ""


def sentence(words: str | None) -> str:
    """Format words as one paragraph with an initial capital and a full stop."""
    plain = " ".join((words or "").split())
    return plain[:1].upper() + plain[1:] + ("" if plain.endswith(".") else ".")
