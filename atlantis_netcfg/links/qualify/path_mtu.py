"""Path MTU: the longest packet, IP header included, that passes unfragmented.

A size counts as too long only if it did not pass and a short packet passed right after it: in a gap nothing passes,
which says nothing about sizes. Waits follow the longest round trip so far, and a late response still counts. Packets
with short responses measure the way up; packets with equally long responses measure both ways. So the MTU down is the
lower of the two results, or at least that of the way up.
"""

from __future__ import annotations

import secrets
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.links.qualify.reflector import stamp

if TYPE_CHECKING:
    from atlantis_netcfg.links.qualify.budget import BudgetGuard
    from atlantis_netcfg.links.qualify.session import ReflectorPeer
    from atlantis_netcfg.links.qualify.transport import DatagramTransport

_SECOND: Final = 1_000_000_000
_TRIES: Final = 3
"""Number of attempts per size, because a packet may be lost for other reasons."""
_SPARE_S: Final = 0.2
"""Seconds beyond two round trips to wait for a response before the next attempt."""
LEAST: Final = 576
"""Minimum packet size that every IPv4 host accepts (RFC 791)."""
ETHERNET: Final = 1500


@dataclass(frozen=True, slots=True)
class PathMtu:
    """The longest packets that passed; None if not determined, and `why` gives the reason."""

    up: int | None
    both: int | None
    """Longest packet that passed in both directions."""
    why: str = ""

    @property
    def down(self) -> int | None:
        """The MTU down if it is lower than up; None otherwise: then it is at least `both`."""
        return self.both if self.up is not None and self.both is not None and self.both < self.up else None


class _OutOfBudget(Exception):
    """The budget allows no further packet."""


class _NoAnswer(Exception):
    """Not even a short packet got a response."""


@dataclass(slots=True)
class _MtuProbe:
    transport: DatagramTransport
    peer: ReflectorPeer
    guard: BudgetGuard
    timeout_s: float
    patience_s: float
    headers: int
    session_id: int
    sequence: int = 0
    _rtt_s: float = 0.0
    """Longest round trip so far in seconds; 0: no response yet."""
    _pending_probes: dict[int, tuple[int, bool, int, int]] = field(default_factory=dict)
    """By sequence number: size, whether only the way up is measured, octets charged for the response, send time."""

    def passes(self, size: int, *, up_only: bool) -> bool:
        """Return whether packets of this size pass; results from within a gap are ignored."""
        end = self.transport.now_ns() + round(self.patience_s * _SECOND)
        if not self._rtt_s:
            self._probe(self._short_answer_size(), self.timeout_s, up_only=up_only)
        if self._any_answered(size, up_only=up_only):
            return True
        while not self._probe(self._short_answer_size(), self.timeout_s, up_only=up_only):
            if self.transport.now_ns() >= end:
                raise _NoAnswer
        return self._any_answered(size, up_only=up_only)

    def _any_answered(self, size: int, *, up_only: bool) -> bool:
        wait_s = min(self.timeout_s, 2 * self._rtt_s + _SPARE_S) if self._rtt_s else self.timeout_s
        return any(self._probe(size, wait_s, up_only=up_only) for _ in range(_TRIES))

    def _short_answer_size(self) -> int:
        base = stamp.extended_size(is_authenticated=self.peer.key is not None)
        return base + stamp.ACKNOWLEDGEMENT_SIZE + self.headers

    def _probe(self, size: int, wait_s: float, *, up_only: bool) -> bool:
        payload = size - self.headers
        tlvs = self._extensions(payload, up_only=up_only)
        answer = self._short_answer_size() - self.headers if up_only else payload
        if not self.guard.admit(payload, answer):
            raise _OutOfBudget
        error = stamp.error_estimate(self.peer.clock_error_s, is_synced=self.peer.is_synchronised)
        packet = stamp.SenderPacket(self.sequence, stamp.ntp(self.transport.unix_ns()), error, self.session_id, tlvs)
        self.sequence += 1
        now = self.transport.now_ns()
        self._pending_probes[packet.sequence] = (size, up_only, answer, now)
        end = now + round(wait_s * _SECOND)
        send_error = self.transport.send(packet.encode(self.peer.key))
        while not send_error and (arrival := self.transport.receive(end)) is not None:
            try:
                reply = stamp.decode_reflector(arrival.datagram, self.peer.key)
            except stamp.BadPacket:
                self.guard.count(len(arrival.datagram), 0)
                continue
            is_ours = reply.session_id in {self.session_id, 0}
            probe = self._pending_probes.pop(reply.sender_sequence, None) if is_ours else None
            self.guard.count(len(arrival.datagram), 0 if probe is None else probe[2])
            if probe is not None:
                self._rtt_s = max(self._rtt_s, (arrival.at_ns - probe[3]) / _SECOND)
                if probe[:2] == (size, up_only):
                    return up_only or len(arrival.datagram) == payload
        return False

    def _extensions(self, payload: int, *, up_only: bool) -> stamp.Tlvs:
        if not up_only:
            return stamp.padding(payload, is_authenticated=self.peer.key is not None)
        base = stamp.extended_size(is_authenticated=self.peer.key is not None)
        chunk = stamp.MessageChunk(0, 0, 0, 1, acknowledge=True).encode()
        return (stamp.Tlv(stamp.CHUNK, chunk.ljust(payload - base - stamp.TLV_SIZE, b"\0")),)


def path_mtu(  # noqa: PLR0913 - each has its name where it is given
    transport: DatagramTransport,
    peer: ReflectorPeer,
    guard: BudgetGuard,
    *,
    highest: int = ETHERNET,
    timeout_s: float = 3.0,
    patience_s: float = 90.0,
    headers: int | None = None,
) -> PathMtu:
    """Search between 576 and `highest` octets; the MTU up alone needs this project's reflector.

    `headers`: the headers that count for the size, if a tunnel adds more to each packet.
    """
    header_bytes = transport.headers if headers is None else headers
    probe = _MtuProbe(transport, peer, guard, timeout_s, patience_s, header_bytes, secrets.randbelow(65535) + 1)
    up = both = None
    try:
        if peer.counts:
            up = _find_mtu(probe, highest, up_only=True)
        both = _find_mtu(probe, up or highest, up_only=False)
    except _OutOfBudget:
        return PathMtu(up, both, f"the budget ended: {guard.limited_by}")
    except _NoAnswer:
        return PathMtu(up, both, f"nothing was answered for {patience_s:.0f} s")
    return PathMtu(up, both, "" if both is not None else f"not even {LEAST} octets passed")


def _find_mtu(probe: _MtuProbe, highest: int, *, up_only: bool) -> int | None:
    if probe.passes(highest, up_only=up_only):
        return highest
    if not probe.passes(LEAST, up_only=up_only):
        return None
    good, bad = LEAST, highest
    while bad - good > 1:
        middle = (good + bad) // 2
        if probe.passes(middle, up_only=up_only):
            good = middle
        else:
            bad = middle
    return good
