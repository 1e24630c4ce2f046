"""Reply sentences of the core, and the error that becomes a `!trap`.

Also the list of what emulated routers do not emulate.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class Category(IntEnum):
    """`=category=` of a trap (Manual, API)."""

    MISSING = 0
    ARGUMENT = 1
    INTERRUPTION = 2
    SCRIPTING = 3
    GENERAL = 4
    API = 5
    TTY = 6
    RETURN = 7


@dataclass(frozen=True, slots=True)
class Answer:
    """One reply sentence: `!re`, `!done`, `!trap`, `!empty` or `!fatal`, then its words; the wire adds `.tag`."""

    kind: str
    words: tuple[str, ...] = ()

    @property
    def last(self) -> bool:
        """Whether this is the last reply with its tag."""
        return self.kind in ("!done", "!fatal")

    @classmethod
    def row(cls, properties: dict[str, str]) -> Answer:
        """Build the reply for one item."""
        return cls("!re", tuple(f"={name}={value}" for name, value in properties.items()))

    @classmethod
    def done_reply(cls, ret: str | None = None) -> Answer:
        """Build the final reply, with the command's return value."""
        return DONE_REPLY if ret is None else cls("!done", (f"=ret={ret}",))

    @classmethod
    def fatal(cls, text: str) -> Answer:
        """Build the `!fatal` reply, a text after which the router closes the session."""
        return cls("!fatal", (text,))


DISK_FULL = "failure: disk full"
"""Error message of a command that would exceed the flash's free space. Assumption: refusal-words"""
DONE_REPLY = Answer("!done")
EMPTY = Answer("!empty")


class Trap(Exception):
    """Error of the router, with its own text."""

    def __init__(self, message: str, category: Category | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.category = category

    def answer(self) -> Answer:
        """Return the `!trap` sentence; a `!done` must follow it."""
        category = () if self.category is None else (f"=category={int(self.category)}",)
        return Answer("!trap", (*category, f"=message={self.message}"))


@dataclass(frozen=True, slots=True)
class Caller:
    """A logged-in session. `address` is the technician's, not the loopback's."""

    number: int
    user: str
    group: str
    via: str
    address: str
    since: float


NOT_REHEARSED = (
    "throughput, latency and load of the real board",
    "every enabled port has a link; of radio only the agreement of two ends and a free-space level are emulated",
    "4G: coverage and speed; the SIM is one of its network, with the declared PIN and access point",
    "PoE: the figures of a load are those of the rehearsal, and no power is fed",
    "gateways and neighbours: every gateway on a connected network answers, only the listed neighbours answer a ping",
    "failover: canaries answer, so no link is left; check-gateway and netwatch work as the manual says",
    "VPN tunnels, DHCP leases, DNS lookups, NTP: they come up where the rehearsal says so, and carry nothing",
    "traffic of the robots: firewall, NAT and queues are stored; only the management path is walked through them",
    "OpenVPN: what a real router says of an imported file, beside the options that MikroTik's manual names",
    "certificates: the twin signs and imports them, without revocation lists, SCEP or passphrases",
    "menus outside the site's templates: names are checked by RouterOS' own command tree, values hardly",
    "the console: no completion, no colours, no scripts beyond :if and :do; what print looks like is approximate",
    "what a package contains: names, versions and architectures only; the configuration is not converted",
    "button presses",
)
"""Limits of a rehearsal with emulated routers; printed in the rehearsal's report."""
