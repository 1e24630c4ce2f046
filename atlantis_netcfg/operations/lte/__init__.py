"""4G units that are not RouterOS in a run: set to what is declared of their SIM where that can be, and judged."""

from __future__ import annotations

from atlantis_netcfg.operations.lte._emulation import EmulatedUnit, emulated_units, not_rehearsed
from atlantis_netcfg.operations.lte._perform import perform
from atlantis_netcfg.operations.lte._result import LteResult
from atlantis_netcfg.operations.lte._unit import Look, Unit, is_unit

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
