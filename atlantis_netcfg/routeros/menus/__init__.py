"""The table of menus: all knowledge about RouterOS beyond its grammar. A new menu is a new row."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING

from atlantis_netcfg.routeros.menus import (
    _address,
    _firewall,
    _interface,
    _lte,
    _routing,
    _service,
    _system,
    _wifi,
    _wireless,
)
from atlantis_netcfg.routeros.menus._model import MARK, Field, Menu, Shape
from atlantis_netcfg.routeros.menus._values import PropertyKind, canonical

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["MARK", "MENUS", "Field", "Menu", "PropertyKind", "Shape", "canonical", "rank"]

_ORDER = (
    *_system.MENUS,
    *_interface.MENUS,
    *_wireless.MENUS,
    *_wifi.MENUS,
    *_lte.MENUS,
    *_address.MENUS,
    *_firewall.MENUS,
    *_routing.MENUS,
    *_service.MENUS,
)

MENUS: Mapping[str, Menu] = MappingProxyType({menu.path: menu for menu in _ORDER})
"""Menus by API path, in sending order within one layer: referenced rows come before rows that refer to them."""

_RANKS = {path: number for number, path in enumerate(MENUS)}


def rank(path: str) -> int:
    """Return the position of a menu within its layer."""
    return _RANKS[path]
