"""Comments in which `export` reports the state of the moment: two exports of one configuration differ in them."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from atlantis_netcfg.rsc._model import Export

__all__ = ["VOLATILE_COMMENTS", "drop_volatile", "is_volatile"]

VOLATILE_COMMENTS: tuple[str, ...] = (
    r"poe-out status: .*",
    r"managed by CAPsMAN(?: .*)?",
    r"channel: .*",
    r"Interface not active",
    r".+ not ready",
    r"inactive time",
    r"inactivated, not allowed by device-mode",
    r"error exporting .*",
)
"""Regular expressions that match a whole comment line, without `# `, above a row or a menu."""

_VOLATILE = re.compile("|".join(f"(?:{pattern})" for pattern in VOLATILE_COMMENTS))


def is_volatile(comment: str) -> bool:
    """Tell whether a comment line (without `# `) reports state instead of configuration."""
    return _VOLATILE.fullmatch(comment) is not None


def drop_volatile(export: Export) -> Export:
    """Return the export without the comments that report state; all others stay."""
    return replace(
        export,
        statements=tuple(replace(statement, comments=_lasting(statement.comments)) for statement in export.statements),
        trailer=_lasting(export.trailer),
    )


def _lasting(comments: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(comment for comment in comments if not is_volatile(comment))
