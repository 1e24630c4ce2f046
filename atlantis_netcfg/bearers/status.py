"""What every bearer is reduced to, whatever carries it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.verdicts import Verdict, worst

if TYPE_CHECKING:
    from collections.abc import Mapping


class LinkState(StrEnum):
    """Whether the bearer carries traffic."""

    UP = "up"
    """It was seen to carry traffic, or its own device says that it is connected."""
    DOWN = "down"
    """It was seen not to."""
    SEARCHING = "searching"
    """Its device is on the way: searching a network, waiting for radar, registering."""
    UNKNOWN = "unknown"
    """It cannot be told from here: not probed on purpose, or its device does not answer."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that somebody should know of a bearer."""

    verdict: Verdict
    code: str
    """A stable word for programs: `roaming-not-allowed`."""
    message: str
    """What is so, in one sentence."""
    hint: str | None = None
    """What a technician can do about it."""

    def as_dict(self) -> dict[str, str | None]:
        """As JSON-able data."""
        return {"verdict": self.verdict.value, "code": self.code, "message": self.message, "hint": self.hint}


Quality = dict[str, str | int | float | None]
"""Normalised readings by name with their unit in the name (`signal_dbm`, `rsrp_dbm`, `rtt_ms`); None: not readable."""


@dataclass(frozen=True, slots=True)
class BearerStatus:
    """A bearer as it was found; what could not be read is None and never a zero."""

    name: str
    kind: str
    """Of the declaration: wifi_ptp, lte, satellite, ethernet."""
    state: LinkState
    active: bool | None
    """Whether it carries the site's traffic now."""
    metered: bool
    quality: Quality
    month_bytes: int | None
    """Counted this month in both directions, as far as we have looked."""
    findings: tuple[Finding, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """The worst of its findings; without any it passes if it is up."""
        if self.findings:
            return worst(finding.verdict for finding in self.findings)
        return Verdict.PASS if self.state is LinkState.UP else Verdict.INCONCLUSIVE

    def as_dict(self) -> Mapping[str, Any]:
        """As JSON-able data, in the shape that `provision links --json` promises."""
        return {
            "kind": self.kind,
            "state": self.state.value,
            "active": self.active,
            "metered": self.metered,
            "quality": self.quality,
            "month_bytes": self.month_bytes,
            "findings": [finding.as_dict() for finding in self.findings],
        }
