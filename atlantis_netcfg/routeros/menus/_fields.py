"""Short words in which the table is written: one function for each kind of value.

Defaults are those of verbose exports of RouterOS 7.17 to 7.19 and of the manual; where neither says one, the field is
`kept`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros.menus._model import Field
from atlantis_netcfg.routeros.menus._values import Kind

if TYPE_CHECKING:
    from collections.abc import Iterable


def text(name: str, default: str | None = "") -> Field:
    return Field(name, Kind.TEXT, default)


def texts(names: str, default: str | None = None) -> tuple[Field, ...]:
    return tuple(text(name, default) for name in names.split())


def boolean(name: str, default: str | None = "no") -> Field:
    return Field(name, Kind.BOOLEAN, default)


def flag(name: str) -> Field:
    return Field(name, Kind.FLAG)


def number(name: str, default: str | None = None) -> Field:
    return Field(name, Kind.NUMBER, default)


def time(name: str, default: str | None = None) -> Field:
    return Field(name, Kind.TIME, default)


def size(name: str, default: str | None = None) -> Field:
    return Field(name, Kind.SIZE, default)


def rate(name: str, default: str | None = None) -> Field:
    return Field(name, Kind.RATE, default)


def mac(name: str, default: str | None = None) -> Field:
    return Field(name, Kind.MAC, default)


def prefix(name: str, default: str | None = None) -> Field:
    return Field(name, Kind.PREFIX, default)


def network(name: str, default: str | None = None) -> Field:
    return Field(name, Kind.NETWORK, default)


def prefixes(name: str, default: str | None = "") -> Field:
    return Field(name, Kind.PREFIXES, default)


def words(name: str, default: str | None = "") -> Field:
    return Field(name, Kind.SET, default)


def sequence(name: str, default: str | None = "") -> Field:
    return Field(name, Kind.SEQUENCE, default)


def policy(name: str) -> Field:
    return Field(name, Kind.POLICY, "")


def interface(name: str, default: str | None = None) -> Field:
    return Field(name, Kind.INTERFACE, default)


def gateway(name: str) -> Field:
    return Field(name, Kind.GATEWAY, "")


def kept(*fields: Field) -> tuple[Field, ...]:
    """Mark fields without a default that we could tell: unnamed, they stay as they are."""
    return tuple(replace(field, keep=True, default=None) for field in fields)


def usual(*fields: Field) -> tuple[Field, ...]:
    """Mark fields that stay as they are when the declaration is silent; a saved export's silence means the default."""
    return tuple(replace(field, keep=True) for field in fields)


def like(other: str, field: Field) -> Field:
    return replace(field, like=other)


def secret(field: Field) -> Field:
    return replace(field, secret=True)


def unread(field: Field) -> Field:
    return replace(field, unread=True, keep=True)


def prompted(field: Field) -> Field:
    """Mark a field that is only sent while the device asks for it (routeros/pin.py)."""
    return replace(field, prompted=True)


def cosmetic(field: Field) -> Field:
    return replace(field, cosmetic=True)


def on_board(fields: Iterable[Field]) -> tuple[Field, ...]:
    return tuple(replace(field, board=True) for field in fields)


def since(version: str, *fields: Field) -> tuple[Field, ...]:
    """Mark fields that a command tree first shows at that version."""
    return tuple(replace(field, since=Version.parse(version)) for field in fields)


def gone(version: str, *fields: Field) -> tuple[Field, ...]:
    """Mark fields that the command tree of that version lacks."""
    return tuple(replace(field, gone=Version.parse(version)) for field in fields)


COMMENT = cosmetic(text("comment"))
DISABLED = boolean("disabled")
