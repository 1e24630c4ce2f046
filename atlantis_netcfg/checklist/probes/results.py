"""What came back of a question. Silence is an answer, and is never mixed up with a refusal."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.bearers import Finding


class Trouble(StrEnum):
    """Why there is no whole answer."""

    REFUSED = "refused"
    """A computer is there, but nothing listens, or it turned us away."""
    SILENT = "silent"
    """Nobody answered at that address within the time."""
    UNREACHABLE = "unreachable"
    """No route, or no such host."""
    BUSY = "busy"
    """Another program holds the serial port, or the UDP port on which a stream arrives."""
    MISSING = "missing"
    """No such serial port, no such program on that computer."""
    DENIED = "denied"
    """We may not."""
    CLOSED = "closed"
    """The other end hung up at once, as one does that serves one client only."""
    NO_PLACE = "no place"
    """The computer or router that should have asked was not reached: nothing is known."""


@dataclass(frozen=True, slots=True)
class Transcript:
    """What was heard on a stream."""

    trouble: Trouble | None
    words: str = ""
    """The trouble in the words of the system or of the place."""
    chunks: tuple[tuple[float, bytes], ...] = ()
    """Seconds since `began`, and what came then: as it came from a stream, one datagram each from UDP."""
    began: float = 0.0
    """Seconds since 1970 by the clock of the computer that listened."""
    ended_s: float = 0.0
    """When the listening ended, seconds since `began`."""
    senders: tuple[str, ...] = ()
    """Of UDP: the address that each of `chunks` came from; empty: nobody has looked, or it is no UDP."""

    @property
    def data(self) -> bytes:
        """All of it."""
        return b"".join(data for _, data in self.chunks)


@dataclass(frozen=True, slots=True)
class CommandResult:
    """What a program printed."""

    trouble: Trouble | None
    words: str = ""
    rc: int = 0
    out: str = ""
    err: str = ""
    began: float = 0.0
    """Seconds since 1970 by the clock of the computer that ran it."""
    asked: float = 0.0
    """Seconds since 1970 by this computer's clock, when the question left; 0: nobody has looked."""
    heard: float = 0.0
    """The same, when its answer was here: what the other clock showed in between tells how wrong it is."""


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of a RouterOS menu."""

    trouble: Trouble | None
    words: str = ""
    rows: tuple[Mapping[str, str], ...] | None = None
    """None: the device does not know the menu, or refused."""
    asked: float = 0.0
    """Seconds since 1970 by this computer's clock, when the question left; 0: nobody has looked."""
    heard: float = 0.0
    """The same, when its answer was here: what the other clock showed in between tells how wrong it is."""


@dataclass(frozen=True, slots=True)
class LinkStatusResult:
    """How a bearer is; the dictionary of `operations.links.Looked.as_dict` for it."""

    trouble: Trouble | None
    words: str = ""
    bearer: Mapping[str, Any] | None = None


@dataclass(frozen=True, slots=True)
class AllowListTestResult:
    """What the proof of the satellite's allow-list has found."""

    trouble: Trouble | None
    words: str = ""
    findings: tuple[Finding, ...] = ()
    bill: str = ""
    """What it has cost, in words."""
    seconds: float = 0.0
    """How long silent targets were asked."""


@dataclass(frozen=True, slots=True)
class DhcpOffer:
    """What one DHCP server offers."""

    server: str
    """Its identifier (RFC 2132, option 54), else the address that the packet came from."""
    mac: str | None
    """Of the card that sent it, in lower case with colons; None: the system does not tell."""
    address: str
    """That it would give."""
    router: str | None = None
    """Default gateway that it would give (option 3), the first."""


@dataclass(frozen=True, slots=True)
class DhcpOffers:
    """Which DHCP servers answered on a segment; without trouble and without offers: nobody within the time."""

    trouble: Trouble | None
    words: str = ""
    offers: tuple[DhcpOffer, ...] = ()


@dataclass(frozen=True, slots=True)
class DdsDiscoverResult:
    """What DDS participants have sent to one that announced itself; nothing without trouble: nobody answered."""

    trouble: Trouble | None
    words: str = ""
    prefix: bytes = b""
    """Identity of the one that announced itself, made up anew each time (GUID prefix, DDSI-RTPS 9.3.1)."""
    datagrams: tuple[tuple[str, bytes], ...] = ()
    """Address of the sender, and the message."""


Answer = Transcript | CommandResult | Rows | LinkStatusResult | AllowListTestResult | DhcpOffers | DdsDiscoverResult
