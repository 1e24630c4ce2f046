"""The declaration of the pilot, read from an Ansible inventory and checked as a whole.

The inventory is plain YAML with final values, so that Ansible and this package read the same thing. `load` turns it
into frozen models and remembers the file and line of every value; every error of a pass is collected and told together.
Nothing downstream reads YAML.

What needs pydantic or PyYAML is imported when it is asked for: the command line imports this package to ask for help.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from atlantis_netcfg.site.declaration import ALL, Declaration, Host, choose
    from atlantis_netcfg.site.findings import Finding, InventoryInvalid, Mark, report
    from atlantis_netcfg.site.loading import load, validate

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

_HOMES = {
    "declaration": ("ALL", "Declaration", "Host", "choose"),
    "findings": ("Finding", "InventoryInvalid", "Mark", "report"),
    "loading": ("load", "validate"),
}


def __getattr__(name: str) -> Any:  # noqa: ANN401 - whatever the name stands for
    for module, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
