"""How a run ended on one 4G unit: the shape of a device's result, so that every report can hold it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.bearers import Finding, Quality
    from atlantis_netcfg.routeros.apply import Status

__all__ = ["FINE", "LteResult", "words"]

FINE = (ExitCode.DONE, ExitCode.CHANGES, ExitCode.NOTHING)
"""What is no failure of a play: a unit that only a person can look at was not checked, and has not failed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LteResult:
    """What was set, and what the unit said afterwards."""

    name: str
    status: Status
    exit: ExitCode
    message: str
    hint: str | None = None
    planned: int = 0
    confirmed: int = 0
    diff: str = ""
    notes: tuple[str, ...] = ()
    plan_hash: str = ""
    findings: tuple[Finding, ...] = ()
    quality: Quality = field(default_factory=dict)
    requests: int = 0
    sent: int = 0
    """Bytes of what we sent, without headers and TLS, and without SSH; so is `received`."""
    received: int = 0
    seconds: float = 0.0
    serial: str | None = None
    """The unit's serial number, which identifies it."""

    def as_dict(self) -> Mapping[str, Any]:
        """As JSON-able data, with every key of a device's result."""
        return {
            "status": self.status.value,
            "exit": int(self.exit),
            "message": self.message,
            "hint": self.hint,
            "busy": "",
            "planned": self.planned,
            "confirmed": self.confirmed,
            "diff": self.diff,
            "drift": [],
            "comparison": None,
            "notes": list(self.notes),
            "estimate": None,
            "plan_hash": self.plan_hash,
            "protection": "none",
            "protection_words": "none: the settings of a 4G unit are written at once, and read back",
            "round_trips": self.requests,
            "bytes": {"sent": self.sent, "received": self.received},
            "seconds": round(self.seconds, 3),
            "version": None,
            "board": None,
            "findings": [finding.as_dict() for finding in self.findings],
            "quality": self.quality,
            "serial": self.serial,
        }


def words(finding: Finding) -> str:
    """A finding as a note: `WARN: ... (...)`; one that passes is told without its verdict."""
    verdict = "" if finding.verdict is Verdict.PASS else f"{finding.verdict}: "
    return f"{verdict}{finding.message}{f' ({finding.hint})' if finding.hint else ''}"
