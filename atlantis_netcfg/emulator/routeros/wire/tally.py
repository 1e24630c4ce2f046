"""What was counted on the wire, so that a test can hold a claim about round trips and bytes."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.core.secret import MASK

if TYPE_CHECKING:
    from collections.abc import Sequence

_SECRET = r"(?:[\w.-]*(?:password|passphrase|secret|pre-?shared-key|private-key)|response|pin)"  # noqa: S105 (a pattern)
_WORD = re.compile(rf"^(=!?{_SECRET}=).+$", re.DOTALL)
_SCRIPT = re.compile(rf'\b({_SECRET}=)("(?:\\.|[^"\\])*"|[^\s;\]]+)', re.DOTALL)


@dataclass(slots=True)
class Counters:
    """Totals of one connection, or of a router."""

    connections: int = 0
    logins: int = 0
    turns: int = 0
    """Round trips: how often the client began to speak, at first or after it had heard something.

    TLS is not counted; SSH is, key exchange and all.
    """
    sentences: int = 0
    """Of the API; over SSH lines, keys that are commands, and files."""
    bytes_in: int = 0
    """From the client, above TLS."""
    bytes_out: int = 0
    wire_in: int = 0
    """From the client, as TCP carried it."""
    wire_out: int = 0

    def plus(self, other: Counters) -> Counters:
        """Sum, field by field."""
        theirs = asdict(other)
        return Counters(**{name: value + theirs[name] for name, value in asdict(self).items()})


@dataclass(slots=True)
class TrafficCounters:
    """One connection: its counters and the sentences it sent, secrets masked."""

    service: str
    counters: Counters = field(default_factory=lambda: Counters(connections=1))
    sentences: list[tuple[str, ...]] = field(default_factory=list)


def masked(words: Sequence[str]) -> tuple[str, ...]:
    """The words of a sentence without their secrets, also those inside a script."""
    return tuple(_SCRIPT.sub(rf"\1{MASK}", _WORD.sub(rf"\1{MASK}", word)) for word in words)
