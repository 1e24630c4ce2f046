"""Evidence in one line each: what was measured here, and what a device said in its own words."""

from __future__ import annotations

from atlantis_netcfg.checklist.report import Evidence, EvidenceType

__all__ = ["declared", "measured", "number", "read"]


def measured(what: str, value: object, unit: str = "") -> Evidence:
    """Give what this tool has measured."""
    return Evidence(type=EvidenceType.MEASURED, what=what, value=number(value, unit))


def read(what: str, value: object, unit: str = "") -> Evidence:
    """Give what a device has said."""
    return Evidence(type=EvidenceType.READ, what=what, value=number(value, unit))


def declared(what: str, value: object) -> Evidence:
    """Give what the inventory says."""
    return Evidence(type=EvidenceType.DECLARED, what=what, value=str(value))


def number(value: object, unit: str = "") -> str:
    """Write a value with its unit: `-52 dBm`; a number without needless zeros."""
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return f"{text} {unit}" if unit else text
