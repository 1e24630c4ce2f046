"""Field types of the models as data, and pydantic's errors in a technician's wording, with file and line."""

from __future__ import annotations

from datetime import date
from enum import Enum
from ipaddress import IPv4Address, IPv4Network
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel

from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory.findings import Finding, suggest
from atlantis_netcfg.inventory.model import Device
from atlantis_netcfg.inventory.model._base import NOT_TEXT, WRONG

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from pydantic_core import ErrorDetails

    from atlantis_netcfg.inventory._yaml import Node


def unwrap(annotation: Any) -> Any:  # noqa: ANN401 - a type, whatever it is
    """Return the type inside `Annotated` and `| None`."""
    while True:
        if get_origin(annotation) is Annotated:
            annotation = get_args(annotation)[0]
        elif optional(annotation):
            (annotation,) = (part for part in get_args(annotation) if part is not NoneType)
        else:
            return annotation


def optional(annotation: Any) -> bool:  # noqa: ANN401 - as above
    """Return whether a type allows null."""
    return get_origin(annotation) in {Union, UnionType} and NoneType in get_args(annotation)


def model_of(annotation: Any) -> type[BaseModel] | None:  # noqa: ANN401 - as above
    """Return the model class of a field, or None."""
    plain = unwrap(annotation)
    return plain if isinstance(plain, type) and issubclass(plain, BaseModel) else None


def item_of(annotation: Any) -> Any:  # noqa: ANN401 - as above
    """Return the item type of a list, or None for other types."""
    plain = unwrap(annotation)
    return get_args(plain)[0] if get_origin(plain) is tuple else None


def choices_of(annotation: Any) -> tuple[str | int, ...]:  # noqa: ANN401 - as above
    """Return the allowed values of a field; empty if any value is allowed."""
    plain = unwrap(annotation)
    if get_origin(plain) is Literal:
        return get_args(plain)
    if isinstance(plain, type) and issubclass(plain, Enum):
        return tuple(str(member.value) for member in plain)
    return ()


def at(model: type[BaseModel], path: Sequence[str | int]) -> Any:  # noqa: ANN401 - as above
    """Return the type of the field at a path, or None."""
    annotation: Any = model
    for step in path:
        if isinstance(step, int):
            annotation = item_of(annotation)
            continue
        if get_origin(unwrap(annotation)) is dict:
            annotation = get_args(unwrap(annotation))[1]
            continue
        inner = model_of(annotation)
        field = inner.model_fields.get(step) if inner is not None else None
        if field is None:
            return None
        annotation = field.annotation
    return annotation


def expected_type(annotation: Any) -> str:  # noqa: ANN401 - as above
    """Describe what to write for a field."""
    plain = unwrap(annotation)
    if words := choices_of(plain):
        return msg("one of " + str(arg(join(", ", map(str, words)))))
    if (model := model_of(plain)) is not None:
        required_names = [name for name, field in model.model_fields.items() if field.is_required()]
        return msg(
            "a block with "
            + str(arg(join(", ", required_names) or msg(f"any of {arg(join(', ', model.model_fields))}")))
        )
    if get_origin(plain) is dict:
        return "a block of keys"
    if (item := item_of(plain)) is not None:
        inner = model_of(item)
        return "a list: [" + ("{…}, {…}" if inner is not None else "…, …") + "]"
    return _PLAIN.get(plain) or "one line of text"


_PLAIN: dict[Any, str] = {
    IPv4Address: "an address, for example 10.64.1.1",
    IPv4Network: "a network, for example 10.64.1.0/24",
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    Secret: "a secret from ansible-vault encrypt_string, or EXAMPLE-…",
}
DEVICES: dict[str, type[BaseModel]] = {
    get_args(model.model_fields["kind"].annotation)[0]: model for model in get_args(unwrap(Device))
}
"""`kind` to the model of the device."""
MODEL = "atlantis_netcfg.inventory.model"
"""Package of the models."""


FALLBACK = "is invalid"
"""Message for an error type without a text of its own; tests check that it is never used."""
_Path = tuple[str | int, ...]


def model_key(path: _Path) -> str:
    """Return the key at a path as the model names it."""
    return str(path[-1])


def explain(
    error: ErrorDetails, root: Node, model: type[BaseModel], name: str, key_of: Callable[[_Path], str] = model_key
) -> Finding:
    """Convert one validation error of block `name`; `key_of` returns keys as the file names them."""
    path = error["loc"]
    if error["type"] == "missing":
        return _missing_key_finding(path, root, model, name, key_of)
    node, field = root.at(*path), at(model, path)
    label = label_of(path, name, key_of)
    message, hint = _explain_value(error, node, field, label)
    place = node.place if isinstance(node.value, dict | list) else node.mark
    return Finding.at(place, message, hint)


def label_of(path: _Path, name: str, key_of: Callable[[_Path], str] = model_key) -> str:
    """Describe a place for the user: a key, or an entry of a list."""
    if not path:
        return f"`{name}`"
    if isinstance(path[-1], int):
        return msg(f"entry {arg(path[-1] + 1)} of {arg(label_of(path[:-1], name, key_of))}")
    return f"`{key_of(path)}`"


def _missing_key_finding(
    path: _Path, root: Node, model: type[BaseModel], name: str, key_of: Callable[[_Path], str]
) -> Finding:
    parent, key = path[:-1], key_of(path)
    hint = msg(f"add `{arg(key)}:` with {arg(expected_type(at(model, path)))}")
    return Finding.at(root.at(*parent).place, msg(f"{arg(label_of(parent, name, key_of))} has no `{arg(key)}`"), hint)


def _explain_value(error: ErrorDetails, node: Node, field: Any, label: str) -> tuple[str, str]:  # noqa: ANN401 - a type
    if error["type"] == WRONG:
        return str(error["ctx"]["what"]), str(error["ctx"]["hint"])
    if what := _wrong_shape(error, node):
        return msg(f"{arg(label)} {arg(what)}"), msg(f"write {arg(expected_type(field))}")
    if (what := _misread(node)) and error["type"] in _TEXTUAL:
        return _explain_unquoted(node, field, label, what)
    words = _WORDS.get(error["type"])
    if words is not None:
        return words(label, node, error.get("ctx", {}), field)
    return msg(f"{arg(label)} {arg(FALLBACK)}"), msg(f"write {arg(expected_type(field))}")


def _wrong_shape(error: ErrorDetails, node: Node) -> str:
    """Return an error of the value's form, before its content is checked; empty if there is none."""
    if isinstance(node.value, Secret):
        return "cannot be in the vault: only passwords and keys can"
    if node.value is None:
        return "has no value"
    if error["type"] == "too_short":
        return msg(f"has too few entries: the minimum is {arg(error['ctx']['min_length'])}")
    if error["type"] in _STRUCTURE or isinstance(node.value, dict | list):
        return msg(f"is {arg(_describe_shape(node))}")
    return ""


def _describe_shape(node: Node) -> str:
    if isinstance(node.value, dict):
        return "a block of keys here"
    return "a list here" if isinstance(node.value, list) else "a single value here"


def _misread(node: Node) -> str:
    """Return the type that YAML assumed for an unquoted text."""
    if isinstance(node.value, bool):
        return "yes or no"
    if isinstance(node.value, int | float):
        return "a number"
    return "a date" if isinstance(node.value, date) else ""


def _explain_unquoted(node: Node, field: Any, label: str, what: str) -> tuple[str, str]:  # noqa: ANN401 - a type
    if unwrap(field) is Secret:
        return msg(f"YAML reads {arg(label)} as {arg(what)}"), "write it in quotes"
    allowed_words = choices_of(field)
    if allowed_words and node.text not in allowed_words:
        return msg(f"`{arg(node.text)}` is not a valid value for {arg(label)}"), suggest(
            node.text, map(str, allowed_words), none=""
        )
    return msg(f"YAML reads `{arg(node.text)}` as {arg(what)}, but {arg(label)} must be a text"), msg(
        f'write it in quotes: "{arg(node.text)}"'
    )


def _explain_number(label: str, node: Node, _context: Mapping[str, Any], _field: object) -> tuple[str, str]:
    if isinstance(node.value, str) and node.text.strip().replace(".", "", 1).isdigit():
        return msg(f"{arg(label)} must be a number, not a text"), msg(
            f"write it without quotes: {arg(node.text.strip())}"
        )
    kind = "a whole number" if isinstance(node.value, float) else "a number"
    return msg(f"{arg(label)} must be {arg(kind)}, not `{arg(node.text)}`"), "write digits only"


def _explain_flag(label: str, node: Node, _context: Mapping[str, Any], _field: object) -> tuple[str, str]:
    return msg(f"{arg(label)} must be true or false, not `{arg(node.text)}`"), "write true or false, without quotes"


def _explain_choice(label: str, node: Node, context: Mapping[str, Any], field: object) -> tuple[str, str]:
    if isinstance(next(iter(choices_of(field)), None), int) and not node.plain:
        return _explain_number(label, node, context, field)
    return msg(f"`{arg(node.text)}` is not a valid value for {arg(label)}"), suggest(
        node.text, map(str, choices_of(field)), none=""
    )


def _explain_minimum(label: str, node: Node, context: Mapping[str, Any], _field: object) -> tuple[str, str]:
    bound = context.get("ge", context.get("gt"))
    if "gt" in context:
        return msg(f"{arg(label)} is {arg(node.text)}, but must be more than {arg(bound):g}"), msg(
            f"write a number above {arg(bound):g}"
        )
    return msg(f"{arg(label)} is {arg(node.text)}: the minimum is {arg(bound):g}"), msg(f"write {arg(bound):g} or more")


def _explain_maximum(label: str, node: Node, context: Mapping[str, Any], _field: object) -> tuple[str, str]:
    return msg(f"{arg(label)} is {arg(node.text)}: the maximum is {arg(context['le']):g}"), msg(
        f"write {arg(context['le']):g} or less"
    )


def _explain_too_long(label: str, node: Node, context: Mapping[str, Any], _field: object) -> tuple[str, str]:
    most = context["max_length"]
    return msg(
        f"{arg(label)} has {arg(len(str(node.value)))} characters: the maximum is {arg(most)}"
    ), "choose a shorter one"


def _explain_not_finite(label: str, node: Node, _context: Mapping[str, Any], _field: object) -> tuple[str, str]:
    return msg(f"{arg(label)} is `{arg(node.text)}`, which is not a finite number"), "write digits only"


_TEXTUAL = frozenset({NOT_TEXT, "string_type", "enum", "literal_error"})
_STRUCTURE = frozenset({"model_type", "model_attributes_type", "dict_type", "tuple_type"})
_WORDS: dict[str, Callable[[str, Node, Mapping[str, Any], Any], tuple[str, str]]] = {
    "int_type": _explain_number,
    "int_from_float": _explain_number,
    "float_type": _explain_number,
    "bool_type": _explain_flag,
    "enum": _explain_choice,
    "literal_error": _explain_choice,
    "greater_than_equal": _explain_minimum,
    "greater_than": _explain_minimum,
    "less_than_equal": _explain_maximum,
    "string_too_long": _explain_too_long,
    "too_long": _explain_too_long,
    "finite_number": _explain_not_finite,
}
