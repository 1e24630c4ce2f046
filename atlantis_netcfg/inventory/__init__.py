"""The pilot's inventory: an Ansible inventory, parsed and validated as a whole.

The inventory is plain YAML with final values, so that Ansible and this package read the same. `load` converts it to
immutable models, and keeps file and line of every value. All errors of a pass are collected and reported together.
Other modules do not read YAML.

Pydantic and PyYAML are imported lazily: the command line imports this package even for help.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.lazy_imports import lazy_getattr

if TYPE_CHECKING:
    from atlantis_netcfg.inventory.findings import Finding, InventoryInvalid, Mark, report
    from atlantis_netcfg.inventory.inventory import ALL, Host, Inventory, choose
    from atlantis_netcfg.inventory.loader import load, validate

__all__ = [
    "ALL",
    "Finding",
    "Host",
    "Inventory",
    "InventoryInvalid",
    "Mark",
    "choose",
    "load",
    "report",
    "validate",
]

__getattr__ = lazy_getattr(
    __name__,
    {
        "inventory": ("ALL", "Inventory", "Host", "choose"),
        "findings": ("Finding", "InventoryInvalid", "Mark", "report"),
        "loader": ("load", "validate"),
    },
)
