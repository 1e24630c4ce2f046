"""4G units that are not RouterOS in a run: set to what is declared of their SIM where that can be, and judged."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.lazy_imports import homes

if TYPE_CHECKING:
    from atlantis_netcfg.operations.lte._emulation import EmulatedUnit, emulated_units, not_rehearsed
    from atlantis_netcfg.operations.lte._kind import is_unit
    from atlantis_netcfg.operations.lte._perform import perform
    from atlantis_netcfg.operations.lte._result import LteResult
    from atlantis_netcfg.operations.lte._unit import Look, Unit

__all__ = [
    "EmulatedUnit",
    "Look",
    "LteResult",
    "Unit",
    "emulated_units",
    "is_unit",
    "not_rehearsed",
    "perform",
]

__getattr__ = homes(
    __name__,
    {
        "_emulation": ("EmulatedUnit", "emulated_units", "not_rehearsed"),
        "_perform": ("perform",),
        "_result": ("LteResult",),
        "_unit": ("Look", "Unit"),
        "_kind": ("is_unit",),
    },
)
