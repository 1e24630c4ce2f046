"""What a driver of a satellite terminal may be able to do, and the one driver there is: a person."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Protocol

from atlantis_netcfg.core.errors import DeviceFailed

if TYPE_CHECKING:
    from atlantis_netcfg.bearers.satellite.evidence import Evidence

__all__ = ["Capability", "ManualTerminal", "SatTerminal", "Unsupported"]


class Capability(StrEnum):
    """What a terminal can be asked, each of them optional (after terminals that have an API)."""

    IDENTITY = "identity"
    FIRMWARE = "firmware"
    SIGNAL = "signal"
    GNSS_FIX = "gnss_fix"
    SESSION_STATE = "session_state"
    DATA_COUNTER = "data_counter"
    FIREWALL_READBACK = "firewall_readback"
    BACKUP_EXPORT = "backup_export"


class Unsupported(DeviceFailed):
    """The terminal cannot be asked this by its driver; nothing was sent."""


class SatTerminal(Protocol):
    """A driver: it says what it can, and answers that; everything it does is a read."""

    @property
    def capabilities(self) -> frozenset[Capability]:
        """What `read` answers."""

    def read(self, capability: Capability) -> str:
        """The terminal's answer in its own words. Raises Unsupported, or DeviceFailed if it does not answer."""


_PROMPTS = {
    Capability.IDENTITY: "Which model and serial number are printed on the terminal of {name}?",
    Capability.FIRMWARE: "Which firmware does the terminal of {name} show on its own page?",
    Capability.SIGNAL: "How many bars, or which signal, does the terminal of {name} show?",
    Capability.GNSS_FIX: "Does the terminal of {name} show a position?",
    Capability.SESSION_STATE: "Does the terminal of {name} show a data session, and since when?",
    Capability.DATA_COUNTER: "How many bytes does the terminal of {name} show for this month?",
    Capability.FIREWALL_READBACK: "Which destinations does the terminal of {name} let through by its own filter?",
    Capability.BACKUP_EXPORT: "Export a backup on the page of the terminal of {name}; what is the file called?",
}


@dataclass(frozen=True, slots=True)
class ManualTerminal:
    """A terminal without a documented interface: the declared evidence answers, for the rest a person is asked."""

    name: str
    """Of the terminal, as the inventory calls it."""
    evidence: Evidence | None = None

    @property
    def capabilities(self) -> frozenset[Capability]:
        """What somebody has declared; without evidence nothing."""
        if self.evidence is None:
            return frozenset()
        known = {Capability.FIRMWARE, Capability.FIREWALL_READBACK}
        return frozenset(known | ({Capability.BACKUP_EXPORT} if self.evidence.backup_file else set()))

    def read(self, capability: Capability) -> str:
        """The declared answer. Raises Unsupported with what to look for on the terminal's own pages."""
        evidence = self.evidence
        if evidence is None or capability not in self.capabilities:
            raise Unsupported(
                f"{self.name} has no interface to ask for its {capability.value.replace('_', ' ')}",
                hint=self.prompt(capability),
            )
        answers = {
            Capability.FIRMWARE: evidence.firmware,
            Capability.FIREWALL_READBACK: "as declared" if evidence.allow_list else "not as declared",
            Capability.BACKUP_EXPORT: evidence.backup_file or "",
        }
        return answers[capability]

    def prompt(self, capability: Capability) -> str:
        """The question to a person who stands before the terminal."""
        return _PROMPTS[capability].format(name=self.name)
