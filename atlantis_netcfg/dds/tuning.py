"""What DDS has to respect on each kind of link: sizes of datagrams, and how often a participant announces itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.declaration.model import BearerKind

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["ANNOUNCEMENT_BYTES", "GAP_S", "TUNING", "Tuning"]

GAP_S = 70
"""The longest silence that was seen on the satellite service (FFI, 352 kbit/s, Arctic, 2019)."""
ANNOUNCEMENT_BYTES = 400
"""One announcement to one index of one peer: 352 bytes measured with Cyclone DDS 11, and about 50 of the tunnel."""


@dataclass(frozen=True, slots=True)
class Tuning:
    """Of one kind of link."""

    announce_s: int
    """Two announcements and the longest gap fit into every lease that can be declared."""
    message_bytes: int
    """The largest UDP payload, so that no datagram is fragmented by IP: links drop fragments."""
    fragment_bytes: int
    """Of a sample that is larger than a message; 100 bytes are left for the headers of RTPS."""


_FAST = Tuning(announce_s=5, message_bytes=1372, fragment_bytes=1272)
"""1372 is a tunnel's MTU of 1400 without the headers of IP and UDP."""
_MOBILE = Tuning(announce_s=10, message_bytes=1200, fragment_bytes=1100)
_SATELLITE = Tuning(announce_s=20, message_bytes=1200, fragment_bytes=1100)

TUNING: Mapping[BearerKind, Tuning] = {
    BearerKind.ETHERNET: _FAST,
    BearerKind.WIFI_PTP: _FAST,
    BearerKind.LTE: _MOBILE,
    BearerKind.SATELLITE: _SATELLITE,
}
"""1200 bytes were measured over a path that drops fragments; what a satellite takes is to be measured on site."""
