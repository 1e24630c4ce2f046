"""The six words in which anything that was looked at is judged, worst last."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


class Verdict(StrEnum):
    """What is known of one thing that was to hold."""

    SKIP = "SKIP"
    """It does not apply; the reason stands beside it."""
    PASS = "PASS"  # noqa: S105 - a verdict
    """It was seen to hold."""
    WARN = "WARN"
    """It works, but outside the preferred band, or the evidence is weak."""
    INCONCLUSIVE = "INCONCLUSIVE"
    """It could not be observed: silence where silence proves nothing."""
    FAIL = "FAIL"
    """It was seen not to hold."""
    ERROR = "ERROR"
    """We ourselves failed."""


_ORDER = tuple(Verdict)


def worst(verdicts: Iterable[Verdict]) -> Verdict:
    """Return the worst of them; of none, SKIP."""
    return max(verdicts, key=_ORDER.index, default=Verdict.SKIP)
