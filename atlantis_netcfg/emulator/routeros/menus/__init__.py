"""Menus modelled in depth, and the defaults for all others.

A menu of the command tree that has no row here takes and prints every argument as text, except for yes/no arguments:
names are checked by the tree, values hardly. `EmulatedMenu.modelled` distinguishes both.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros.menus import (
    _firewall,
    _interface,
    _ip,
    _lte,
    _routing,
    _services,
    _system,
    _wifi,
    _wireless,
)
from atlantis_netcfg.emulator.routeros.menus._generic import BUILT_IN, generic, unmodelled_arguments
from atlantis_netcfg.emulator.routeros.menus._interface import OLD_WORDS
from atlantis_netcfg.emulator.routeros.menus._model import Arg, EmulatedMenu, Select, Shape, Unique
from atlantis_netcfg.emulator.routeros.menus._order import EXPORT_ORDER
from atlantis_netcfg.emulator.routeros.menus._system import POLICIES

__all__ = [
    "BUILT_IN",
    "EXPORT_ORDER",
    "INTERFACES",
    "MODELLED_MENUS",
    "OLD_WORDS",
    "POLICIES",
    "Arg",
    "EmulatedMenu",
    "Select",
    "Shape",
    "Unique",
    "generic",
    "unmodelled_arguments",
]

MODELLED_MENUS: dict[str, EmulatedMenu] = {
    menu.path: menu
    for module in (_interface, _wireless, _wifi, _lte, _ip, _firewall, _routing, _services, _system)
    for menu in module.MENUS
}
INTERFACES = (
    "/interface",
    "/interface/ethernet",
    "/interface/bridge",
    "/interface/ovpn-client",
    "/interface/wireless",
    "/interface/wifi",
    "/interface/lte",
)
"""Menus whose rows are interfaces and also appear under `/interface`; `lo` has no menu of its own."""
