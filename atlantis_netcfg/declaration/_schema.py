"""The model's fields as data: which keys a block has, and what each of them wants, in words."""

from __future__ import annotations

from enum import Enum
from ipaddress import IPv4Address, IPv4Network
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.declaration.model import Device

if TYPE_CHECKING:
    from collections.abc import Sequence


def unwrap(annotation: Any) -> Any:  # noqa: ANN401 - a type, whatever it is
    """The type below `Annotated` and `| None`."""
    while True:
        if get_origin(annotation) is Annotated:
            annotation = get_args(annotation)[0]
        elif optional(annotation):
            (annotation,) = (part for part in get_args(annotation) if part is not NoneType)
        else:
            return annotation


def optional(annotation: Any) -> bool:  # noqa: ANN401 - as above
    """Whether null is a value of it."""
    return get_origin(annotation) in {Union, UnionType} and NoneType in get_args(annotation)


def model_of(annotation: Any) -> type[BaseModel] | None:  # noqa: ANN401 - as above
    """The model that a field holds, if it holds one."""
    plain = unwrap(annotation)
    return plain if isinstance(plain, type) and issubclass(plain, BaseModel) else None


def item_of(annotation: Any) -> Any:  # noqa: ANN401 - as above
    """The type of a list's entries; None if it is no list."""
    plain = unwrap(annotation)
    return get_args(plain)[0] if get_origin(plain) is tuple else None


def choices_of(annotation: Any) -> tuple[str | int, ...]:  # noqa: ANN401 - as above
    """The words that a field may hold; empty if it is free."""
    plain = unwrap(annotation)
    if get_origin(plain) is Literal:
        return get_args(plain)
    if isinstance(plain, type) and issubclass(plain, Enum):
        return tuple(str(member.value) for member in plain)
    return ()


def at(model: type[BaseModel], path: Sequence[str | int]) -> Any:  # noqa: ANN401 - as above
    """The type of the field at a path; None if there is none."""
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
    """What to write for a field."""
    plain = unwrap(annotation)
    if words := choices_of(plain):
        return "one of " + ", ".join(map(str, words))
    if (model := model_of(plain)) is not None:
        return "a block with " + ", ".join(name for name, field in model.model_fields.items() if field.is_required())
    if get_origin(plain) is dict:
        return "a block of keys"
    if (item := item_of(plain)) is not None:
        inner = model_of(item)
        return "a list: [" + ("{…}, {…}" if inner is not None else "…, …") + "]"
    return _PLAIN.get(plain, "one line of text")


_PLAIN: dict[Any, str] = {
    IPv4Address: "an address, like 10.64.1.1",
    IPv4Network: "a network, like 10.64.1.0/24",
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    Secret: "a secret made by ansible-vault encrypt_string, or EXAMPLE-…",
}
DEVICES: dict[str, type[BaseModel]] = {
    get_args(model.model_fields["kind"].annotation)[0]: model for model in get_args(unwrap(Device))
}
"""`kind` -> the model of its device."""
MODEL = "atlantis_netcfg.declaration.model"
"""The package that holds the models."""
