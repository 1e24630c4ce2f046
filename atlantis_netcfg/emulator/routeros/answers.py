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
    "every enabled port has a link; for radio only the match of both ends and a free-space level are emulated",
    "4G: coverage and speed; the SIM belongs to its network and has the PIN and access point of the inventory",
    "PoE: the load values are those of the rehearsal; no power is supplied",
    (
        "gateways and neighbours: every gateway on a connected network responds, only the listed neighbours respond to "
        "pings"
    ),
    "failover: probe targets respond, so no link is abandoned; check-gateway and netwatch work as in the manual",
    "VPN tunnels, DHCP leases, DNS lookups, NTP: they come up where the rehearsal says so, but carry no data",
    "robot traffic: firewall, NAT and queues are stored; only the management path is checked against them",
    "OpenVPN: how a real router reports an imported file, except for the options in MikroTik's manual",
    "certificates: the emulator signs and imports them, without revocation lists, SCEP or passphrases",
    "menus outside the site's templates: names are checked against RouterOS' own command tree, values hardly at all",
    "the console: no completion, no colours, no scripts beyond :if and :do; the output format of print is approximate",
    "package contents: names, versions and architectures only; the configuration is not converted",
    "button presses",
)
"""Limits of a rehearsal with emulated routers; printed in the rehearsal's report."""
