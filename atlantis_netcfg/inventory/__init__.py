"""The declaration of the pilot, read from an Ansible inventory and checked as a whole.

The inventory is plain YAML with final values, so that Ansible and this package read the same thing. `load` turns it
into frozen models and remembers the file and line of every value; every error of a pass is collected and told together.
Nothing downstream reads YAML.

What needs pydantic or PyYAML is imported when it is asked for: the command line imports this package to ask for help.
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
