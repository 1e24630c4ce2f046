"""What a link makes of a TCP connection that a relay leads over it: delay, rate, and stalls in place of loss.

A relay cannot lose octets that it has taken. A segment that the link loses, at random or in a gap, is sent again after
a timeout that doubles each time, and what is behind it on its connection waits: the stall that TCP makes of loss. So
after a gap of 70 s a connection may be silent for two minutes, as a real one. Not modelled: fast retransmission, a
congestion window that shrinks, and the loss of acknowledgements.
"""

from __future__ import annotations

import random
from statistics import median
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.emulator.udp_link import LinkModel

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.udp_link import LinkShape

_LEAST_TIMEOUT_S: Final = 0.2
"""Linux; RFC 6298 has a second."""


def retransmission_s(rtt_s: float) -> float:
    """TCP's first timeout: about twice the round trip, which is what its variation adds (RFC 6298)."""
    return max(_LEAST_TIMEOUT_S, 2 * rtt_s)


class TcpLink:
    """What all connections over a link share; its gaps are counted from the first segment on."""

    def __init__(self, up: LinkShape, down: LinkShape, seed: int = 0) -> None:
        self.up = LinkModel(up, random.Random(seed))  # noqa: S311 - an emulation
        self.down = LinkModel(down, random.Random(seed + 1))  # noqa: S311
        self.connect_s = _typical_s(up) + _typical_s(down)
        """What a TCP connection costs before its first octet: a round trip."""
        self._begin: float | None = None

    def arrival(self, size: int, now: float, *, up: bool) -> float:
        """When a segment that is handed over now has arrived; times are of any clock."""
        if self._begin is None:
            self._begin = now
        model = self.up if up else self.down
        return self._begin + model.carry(size, now - self._begin, retransmission_s(self.connect_s))


def _typical_s(shape: LinkShape) -> float:
    return median(shape.delays_s) if shape.delays_s else shape.delay_s
