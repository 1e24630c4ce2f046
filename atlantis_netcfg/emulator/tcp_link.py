"""Effect of a link on TCP connections through a relay: delay, rate, and stalls instead of loss.

A relay cannot lose octets that it has accepted. A segment that the link loses, at random or in a gap, is sent again
after a timeout that doubles each time, and later data of its connection wait: TCP turns loss into stalls. So a
connection may be silent for two minutes after a gap of 70 s, like a real one. Not modelled: fast retransmission, a
shrinking congestion window, and the loss of acknowledgements.
"""

from __future__ import annotations

import random
from statistics import median
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.emulator.udp_link import LinkModel

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.udp_link import LinkShape

_LEAST_TIMEOUT_S: Final = 0.2
"""Minimum retransmission timeout of Linux; RFC 6298 has 1 s."""


def retransmission_s(rtt_s: float) -> float:
    """Return TCP's first timeout: about twice the round trip, because of its variation (RFC 6298)."""
    return max(_LEAST_TIMEOUT_S, 2 * rtt_s)


class TcpLink:
    """Link state shared by all connections; gaps are timed from the first segment."""

    def __init__(self, up: LinkShape, down: LinkShape, seed: int = 0) -> None:
        self.up = LinkModel(up, random.Random(seed))  # noqa: S311 - an emulation
        self.down = LinkModel(down, random.Random(seed + 1))  # noqa: S311
        self.connect_s = _typical_delay_s(up) + _typical_delay_s(down)
        """Time to open a TCP connection: one round trip."""
        self._begin: float | None = None

    def arrival(self, size: int, now: float, *, up: bool) -> float:
        """Return when a segment sent now arrives; times are of any clock."""
        if self._begin is None:
            self._begin = now
        model = self.up if up else self.down
        return self._begin + model.carry(size, now - self._begin, retransmission_s(self.connect_s))


def _typical_delay_s(shape: LinkShape) -> float:
    return median(shape.delays_s) if shape.delays_s else shape.delay_s
