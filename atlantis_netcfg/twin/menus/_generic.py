"""Menus that the table does not model: what the command tree says of them, and no more."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.twin.menus._model import COMMENT, DISABLED, Arg, Menu, Shape, Unique
from atlantis_netcfg.twin.schema import offered
from atlantis_netcfg.twin.values import Bool, Kind, Text

if TYPE_CHECKING:
    from atlantis_netcfg.twin.schema import Schema

__all__ = ["generic", "unmodelled"]

_NOT_PROPERTIES = {"copy-from", "numbers", "place-before"}
_EVERYWHERE = {"comment": COMMENT, "disabled": DISABLED}
_SECRETS = ("password", "passphrase", "private-key", "preshared-key", "pre-shared-key", "secret", "pin", "key")
_NO_INTERFACE = ("/interface/list", "/interface/lte/apn")


def generic(schema: Schema, path: str) -> Menu:
    """Make the menu of a path that the command tree has."""
    names = schema.arguments(path, "add") | schema.arguments(path, "set")
    interface = path.startswith("/interface/") and "name" in names and not path.startswith(_NO_INTERFACE)
    unique = (Unique(("name",), "failure: item with such name already exists"),) if "name" in names else ()
    return Menu(
        path,
        _shape(schema, path),
        unmodelled(path, names),
        noun=path.rpartition("/")[2].replace("-", " "),
        space="interface" if interface else "",
        unique=unique,
        modelled=False,
    )


def unmodelled(path: str, names: frozenset[str]) -> tuple[Arg, ...]:
    """Make the arguments of these names: their values are taken as they come."""
    return tuple(
        _EVERYWHERE.get(name) or Arg(name, _kind(path, name), secret=name.endswith(_SECRETS))
        for name in sorted(names - _NOT_PROPERTIES)
    )


def _shape(schema: Schema, path: str) -> Shape:
    commands = schema.commands(path)
    if "add" in commands:
        return Shape.LIST
    if "numbers" in schema.arguments(path, "set") or ("find" in commands and "set" not in commands):
        return Shape.FIXED
    return Shape.SETTINGS


def _kind(path: str, name: str) -> Kind:
    return Bool() if offered(path, name) == ("no", "yes") else Text()
