"""The pilot's inventory: an Ansible inventory, parsed and validated as a whole.

The inventory is plain YAML with final values, so that Ansible and this package read the same. `load` converts it to
immutable models, and keeps file and line of every value. All errors of a pass are collected and reported together.
Other modules do not read YAML.

Pydantic and PyYAML are imported lazily: the command line imports this package even for help.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.lazy_imports import homes

if TYPE_CHECKING:
    from atlantis_netcfg.inventory.findings import Finding, InventoryInvalid, Mark, report
    from atlantis_netcfg.inventory.inventory import ALL, Declaration, Host, choose
    from atlantis_netcfg.inventory.loader import load, validate

__all__ = [
    "ALL",
    "Declaration",
    "Finding",
    "Host",
    "InventoryInvalid",
    "Mark",
    "choose",
    "load",
    "report",
    "validate",
]

__getattr__ = homes(
    __name__,
    {
        "inventory": ("ALL", "Declaration", "Host", "choose"),
        "findings": ("Finding", "InventoryInvalid", "Mark", "report"),
        "loader": ("load", "validate"),
    },
)
