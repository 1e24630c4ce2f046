"""The results of `provision inventory doctor`: items with a verdict each, and the overall verdict."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.events import Verdict, worst

if TYPE_CHECKING:
    from collections.abc import Mapping


class DoctorSection(StrEnum):
    """The sections of the report, in order."""

    SOFTWARE = "Software"
    CLOCK = "Clock"
    WAY = "Connection to the site"
    KEYS = "Keys and passwords"
    FOLDERS = "Disk and folders"


_RED = (Verdict.FAIL, Verdict.ERROR, Verdict.INCONCLUSIVE)
"""Verdicts that are not green: the check failed, or could not be observed."""


@dataclass(frozen=True, slots=True)
class DoctorItem:
    """The result of one check."""

    section: DoctorSection
    name: str
    verdict: Verdict
    observation: str
    """Observation as text; never a secret."""
    hint: str = ""
    commands: tuple[str, ...] = ()
    """Commands to type, exactly as given: in a shell, or after `./`."""

    def as_json(self) -> dict[str, Any]:
        """Return JSON-able data."""
        return {
            "section": self.section.name.lower(),
            "name": self.name,
            "verdict": str(self.verdict),
            "measured": self.observation,
            "hint": self.hint,
            "commands": list(self.commands),
        }


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """All results of one `provision inventory doctor`."""

    items: tuple[DoctorItem, ...]
    site: str | None = None
    follows: str = ""
    """Next command to type if nothing is red."""

    @property
    def verdict(self) -> Verdict:
        """The worst verdict of all items."""
        return worst(item.verdict for item in self.items)

    @property
    def exit(self) -> ExitCode:
        """The exit code: failed, nothing checked, or done; warnings alone count as done."""
        if self.verdict in _RED:
            return ExitCode.CHECKS_FAILED
        return ExitCode.NOTHING if self.verdict is Verdict.SKIP else ExitCode.DONE

    @property
    def worst_item(self) -> DoctorItem | None:
        """The first item with the worst verdict, if it needs attention."""
        if self.verdict in (Verdict.PASS, Verdict.SKIP):
            return None
        return next(item for item in self.items if item.verdict is self.verdict)

    @property
    def counts(self) -> Mapping[Verdict, int]:
        """The number of items per verdict, the worst first; verdicts without items are left out."""
        count_by_verdict = Counter(item.verdict for item in self.items)
        return {verdict: count_by_verdict[verdict] for verdict in reversed(Verdict) if count_by_verdict[verdict]}

    def as_json(self) -> dict[str, Any]:
        """Return JSON-able data."""
        return {
            "exit": int(self.exit),
            "errors": [],
            "site": self.site,
            "verdict": str(self.verdict),
            "counts": {str(verdict): number for verdict, number in self.counts.items()},
            "items": [item.as_json() for item in self.items],
        }
