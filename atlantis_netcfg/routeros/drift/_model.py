"""The vocabulary of drift. docs/drift.md explains every word of it to the person who reads a report."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from datetime import datetime


class DriftKind(StrEnum):
    """How one row, or the settings of one menu, differ from the declaration."""

    MISSING = "missing"
    """Declared, and not there."""
    CHANGED = "changed"
    """Declared and there, with other values."""
    ADDED = "added"
    """There and not declared, where all is ours: a run would remove it."""
    ORDER = "order"
    """Declared and there, at another place of a list in which the first match decides."""
    FOREIGN = "foreign"
    """Somebody else's row beside ours: a run leaves it alone."""
    HIDDEN = "hidden"
    """Declared, and the device does not show it, so that it cannot be compared."""
    OPEN = "open"
    """Safe mode, a job of the scheduler or a marker: what a run or a person has not closed."""


class Owner(StrEnum):
    """Whose the row is, by the declaration and by its mark. Rows of RouterOS itself are nobody's difference."""

    DECLARED = "declared"
    FORMER = "formerly declared"
    """It carries our mark, but the declaration has it no more."""
    TECHNICIAN = "technician"
    """No mark: somebody made it on the device."""
    RUN = "a run"
    """A run of this tool has armed it, or marked the device with it."""
    SESSION = "a session"
    """Somebody who is logged in, or was when the link died."""


class Since(StrEnum):
    """When it came about, by comparison with the state that a run has read back last."""

    AFTER = "after"
    """The device was otherwise then: somebody has changed it since."""
    ALREADY = "already"
    """The device was so then: not the device has changed, but the declaration."""
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class FieldDifference:
    """One property, as declared and as found; secrets are masked."""

    name: str
    declared: str
    found: str


@dataclass(frozen=True, slots=True)
class ChangeRecord:
    """What the device's own history still knows: who did what when, in its words and by its clock."""

    by: str
    at: str
    what: str


@dataclass(frozen=True, slots=True)
class Difference:
    """One thing that differs."""

    menu: str
    """As the console writes it: `/ip firewall filter`."""
    subject: str
    kind: DriftKind
    owner: Owner
    mark: str = ""
    """The comment by which the declaration or its owner explains the row."""
    row: str = ""
    """The whole row in the device's own language, where all of it is missing or too much."""
    fields: tuple[FieldDifference, ...] = ()
    since: Since = Since.UNKNOWN
    why_unknown: str = ""
    deed: ChangeRecord | None = None

    @property
    def counts(self) -> bool:
        """Whether it is drift: not what cannot be compared, nor a foreign row that a run has seen and left alone."""
        if self.kind is DriftKind.FOREIGN:
            return self.since is not Since.ALREADY
        return self.kind is not DriftKind.HIDDEN

    def as_dict(self) -> dict[str, Any]:
        """The difference as JSON-able data."""
        return {
            "menu": self.menu,
            "subject": self.subject,
            "kind": self.kind.value,
            "owner": self.owner.value,
            "mark": self.mark,
            "row": self.row,
            "fields": [{"name": field.name, "declared": field.declared, "found": field.found} for field in self.fields],
            "since": self.since.value,
            "why_unknown": self.why_unknown,
            "history": None
            if self.deed is None
            else {"by": self.deed.by, "at": self.deed.at, "action": self.deed.what},
            "counts": self.counts,
        }


@dataclass(frozen=True, slots=True)
class Comparison:
    """A device against its declaration."""

    menus: tuple[str, ...]
    """All that were compared, also where nothing differs."""
    differences: tuple[Difference, ...]
    run: str | None = None
    """The run that last read the device's state back."""
    at: datetime | None = None

    @property
    def drifted(self) -> tuple[Difference, ...]:
        """The differences that count."""
        return tuple(difference for difference in self.differences if difference.counts)

    def as_dict(self) -> dict[str, Any]:
        """The comparison as JSON-able data."""
        confirmed = None
        if self.run is not None and self.at is not None:
            confirmed = {"run": self.run, "at": self.at.isoformat(timespec="seconds")}
        return {
            "menus": list(self.menus),
            "confirmed": confirmed,
            "differences": [difference.as_dict() for difference in self.differences],
        }
