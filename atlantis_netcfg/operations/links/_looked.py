"""What one look at the links of a site has shown."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.report.links import LinksReport

if TYPE_CHECKING:
    from collections.abc import Mapping
    from datetime import datetime

    from atlantis_netcfg.bearers import BearerStatus
    from atlantis_netcfg.bearers.cost import Bill
    from atlantis_netcfg.journal import MonthBytes
    from atlantis_netcfg.operations.links._own import Silent

__all__ = ["Looked"]


@dataclass(frozen=True, slots=True)
class Looked:
    """What one look has shown, in the order of preference."""

    bearers: tuple[BearerStatus, ...]
    boxes: Mapping[str, str]
    """Bearer to the box or boxes of it."""
    months: Mapping[str, MonthBytes]
    probe_bytes: Mapping[str, int]
    """Bearer to what its pings may have cost on the wire."""
    unreachable: tuple[Silent, ...]
    not_asked: Mapping[str, str]
    """Device to the reason."""
    round_trips: Mapping[str, int]
    """Of each RouterOS device that was asked, its login included."""
    asked: tuple[str, ...]
    """Devices, whether or not they answered."""
    bills: Mapping[str, Bill]
    """Metered bearer to what this look has cost on it, as far as sessions with RouterOS devices went over it."""
    notes: tuple[str, ...] = ()
    """What went wrong beside the links."""

    def report(self, site: str, title: str, *, rehearsed: bool, not_rehearsed: tuple[str, ...] = ()) -> LinksReport:
        """For whoever reads it."""
        return LinksReport(
            site=site,
            title=title,
            rehearsed=rehearsed,
            bearers=self.as_dict(),
            asked=self.asked,
            unreachable=[{"device": one.device, "message": one.message, "hint": one.hint} for one in self.unreachable],
            not_asked=self.not_asked,
            round_trips=self.round_trips,
            costs={name: {**one.as_dict(), "words": one.words} for name, one in self.bills.items()},
            notes=self.notes,
            not_rehearsed=not_rehearsed,
        )

    def as_dict(self) -> dict[str, dict[str, Any]]:
        """Each bearer as JSON-able data: what `BearerStatus` promises, and what was found beside it."""
        return {
            one.name: {
                **one.as_dict(),
                "verdict": one.verdict.value,
                "box": self.boxes[one.name],
                "probe_bytes": self.probe_bytes.get(one.name, 0),
                "month_since": _stamp(self.months[one.name].since),
                "month_gaps": list(self.months[one.name].gaps),
            }
            for one in self.bearers
        }


def _stamp(moment: datetime | None) -> str | None:
    return None if moment is None else f"{moment.astimezone(UTC):%Y-%m-%d %H:%M} UTC"
