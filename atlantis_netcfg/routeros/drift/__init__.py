"""What differs on a device from the declaration: in one vocabulary, with who owns it and since when.

It is made from a plan, so that drift is exactly what a run would change, plus what it would leave alone. Pure: what was
confirmed last and what the device remembers are given as text and rows.
"""

from __future__ import annotations

from atlantis_netcfg.routeros.drift._compare import HISTORY, History, Past, compare
from atlantis_netcfg.routeros.drift._model import (
    ChangeRecord,
    Comparison,
    Difference,
    DriftKind,
    FieldDifference,
    Owner,
    Since,
)

__all__ = [
    "HISTORY",
    "ChangeRecord",
    "Comparison",
    "Difference",
    "DriftKind",
    "FieldDifference",
    "History",
    "Owner",
    "Past",
    "Since",
    "compare",
]
