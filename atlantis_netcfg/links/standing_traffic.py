"""Standing traffic: what a link carries without a run or a person, in bytes and money.

Probes of links, time servers, keep-alives and renegotiations of the VPN, announcements of DDS, telemetry. Each is a
`StandingFlow` in bytes a day as they cross the link, with all headers, those of the VPN too. This file has only the
arithmetic; `operations.standing` supplies the values from the inventory and the rendered configuration. No I/O.

The sizes are measured, and `tests/integration/computers/dds` (`test_standing_bytes.py`, `test_topic_bytes.py`) compares
them with a real OpenVPN and real participants. Not included: setting up the tunnel, ARP, traffic of people, and
retransmissions on a link that loses packets.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from math import ceil
from typing import TYPE_CHECKING, Final, Protocol

from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.packets import ECHO_BYTES
from atlantis_netcfg.links.cost import Bill, MeteredLink, bill, size

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

DAY_S: Final = 24 * 3600
MONTH_DAYS: Final = 30
NTP_BYTES: Final = 76
"""Bytes of a time request or its response: 48 of NTP, 28 of UDP and IP."""
PING_BYTES: Final = 68
"""Bytes of an OpenVPN keep-alive over UDP: 16 payload, 24 VPN, 28 UDP and IP (facts/vpn.md, section 9)."""
RENEGOTIATION_BYTES: Final = 5_000
"""Bytes of a session's key renegotiation, both directions together (facts/vpn.md, section 9)."""
UDP_IP: Final = 28
_ICMP_ERROR = 28
"""Bytes of the IP and ICMP headers of an ICMP error, which quotes the refused packet in full."""
_ICMP_AT_ONCE = 6
_FRAGMENT = 12
"""Additional header bytes of a fragment compared with a whole sample (DDSI-RTPS 2.5, 9.4.5)."""


class TrafficSource(StrEnum):
    """The source of standing traffic, as named by `provision links`."""

    CANARIES = "canaries"
    TIME = "time"
    VPN = "VPN"
    DDS = "DDS"
    TELEMETRY = "telemetry"


@dataclass(frozen=True, slots=True)
class StandingFlow:
    """Traffic of one source, in bytes a day."""

    source: TrafficSource
    up: float
    """From the site."""
    down: float
    """To the site."""
    always: bool = False
    """Whether it also uses this link while another one carries the traffic."""

    @property
    def both(self) -> float:
        """Both directions together, as providers count."""
        return self.up + self.down

    def mirror(self) -> StandingFlow:
        """Return the same flow seen from the other end."""
        return replace(self, up=self.down, down=self.up, always=False)


@dataclass(frozen=True, slots=True)
class VpnHeaders:
    """The bytes that the VPN adds to each packet."""

    bytes: int

    @classmethod
    def of(cls, transport: str) -> VpnHeaders:
        """Return the overhead: UDP 24 (OpenVPN data channel, AES-GCM) + 28 (UDP, IP); TCP more, with a length."""
        return cls(52 if transport == "udp" else 78)


NO_VPN: Final = VpnHeaders(0)


def probe_targets(number: int, interval_s: float) -> StandingFlow:
    """Return the traffic of pings to `number` probe targets every `interval_s` seconds, with their replies."""
    each = _times_per_day(interval_s) * number * ECHO_BYTES
    return StandingFlow(TrafficSource.CANARIES, each, each, always=True)


def ntp_traffic(servers: int, interval_s: float) -> StandingFlow:
    """Return the traffic of NTP requests to `servers` time servers, with their responses."""
    each = _times_per_day(interval_s) * servers * NTP_BYTES
    return StandingFlow(TrafficSource.TIME, each, each)


def keep_alive(
    ping_s: float, renegotiation_s: float, busy_up_s: float | None, busy_down_s: float | None
) -> StandingFlow:
    """Return the traffic of an OpenVPN tunnel's keep-alives and renegotiations.

    An end sends its ping if it has sent nothing for `ping_s`. `busy_*_s`: the interval at which other traffic uses the
    tunnel in a direction; None: there is none. If that is shorter than `ping_s`, no ping is ever sent.
    """
    renewal_bytes = _times_per_day(renegotiation_s) * RENEGOTIATION_BYTES / 2

    def pings(busy_s: float | None) -> float:
        return _times_per_day(ping_s) * PING_BYTES if busy_s is None or busy_s >= ping_s else 0.0

    return StandingFlow(TrafficSource.VPN, pings(busy_up_s) + renewal_bytes, pings(busy_down_s) + renewal_bytes)


@dataclass(frozen=True, slots=True)
class LinkPace:
    """The speed of a link, as far as reliable topics depend on it."""

    rtt_s: float
    """Round trip time to the subscriber without load."""
    up_bps: float
    """From the site."""

    def sends_in_s(self, nbytes: float) -> float:
        """Return the seconds needed to send this many bytes from the site."""
        return nbytes * 8 / self.up_bps


@dataclass(frozen=True, slots=True)
class SteadyTopic:
    """A topic that is published at a steady rate."""

    rate_hz: float
    size_bytes: int
    """Serialised size of one message."""
    reliable: bool = False


@dataclass(frozen=True, slots=True)
class MessageCost:
    """The mean cost of one message on the link to one subscriber, with all related traffic."""

    fragments: int
    """Number of datagrams that the message itself needs."""
    bytes_up: float
    packets_up: float
    bytes_down: float = 0.0
    packets_down: float = 0.0


class Reliability(Protocol):
    """The reliability protocol of a DDS implementation: heartbeats and acknowledgements."""

    def cost(self, topic: SteadyTopic, message: MessageCost, pace: LinkPace, vpn: VpnHeaders) -> MessageCost:
        """Return the cost of a reliable topic's message; `message` is its cost without reliability."""


@dataclass(frozen=True, slots=True)
class CycloneHeartbeats:
    """Cyclone DDS: a heartbeat in each message, and further ones until it is acknowledged; each gets a response.

    So a link with a long round trip carries more of them, in both directions. Fragments that wait behind other traffic
    for longer than 0.1 s are requested again; that is not included.
    """

    heartbeat: int = 32
    """Bytes of a heartbeat in a message's datagram (the last one if there are several)."""
    fragment_heartbeat: int = 28
    """Bytes of a heartbeat in each of the other datagrams."""
    alone: int = 80
    """Bytes of a heartbeat as a separate packet."""
    acknowledgement: int = 92
    every_s: float = 0.1
    """Default of `HeartbeatInterval`."""

    def cost(self, topic: SteadyTopic, message: MessageCost, pace: LinkPace, vpn: VpnHeaders) -> MessageCost:
        """Return the cost of a message; if the next one precedes the acknowledgement, one is always unacknowledged."""
        waits_s = min(pace.rtt_s + pace.sends_in_s(message.bytes_up), 1 / topic.rate_hz)
        heartbeats = max(1.0, waits_s / self.every_s)
        inside = self.heartbeat + (message.fragments - 1) * self.fragment_heartbeat
        return MessageCost(
            message.fragments,
            message.bytes_up + inside + (heartbeats - 1) * (self.alone + vpn.bytes),
            message.packets_up + heartbeats - 1,
            heartbeats * (self.acknowledgement + vpn.bytes),
            heartbeats,
        )


@dataclass(frozen=True, slots=True)
class PeriodicHeartbeats:
    """Fast DDS: a heartbeat every few seconds, and one after a certain number of bytes since the last.

    A message that is larger than that has one in each fragment. If the link needs longer for a fragment than the
    subscriber waits before it responds, each response requests all missing fragments again, and they are resent: n
    fragments become up to n (n + 1) / 2, which is assumed. At 352 kbit/s 3 fragments became 4 to 6, 6 became 14 to 21
    and 10 became 54; at 10 Mbit/s none was resent.
    """

    heartbeat: int = 32
    """Bytes of a heartbeat in the datagram of a message."""
    alone: int = 156
    """Bytes of a heartbeat as a separate packet."""
    acknowledgement: int = 152
    every_s: float = 3.0
    """Interval of separate heartbeats while a message is unacknowledged."""
    after_bytes: int = 4800
    """Message bytes after which the next message has a heartbeat."""
    history: int = 10
    """Number of unacknowledged messages that fill a topic's history; the next one then has a heartbeat."""
    answered_after_s: float = 0.005
    """Default of `heartbeatResponseDelay`."""
    answer_share: float = 0.9
    """Share of the heartbeats with a response if fragments are sent again."""

    def cost(self, topic: SteadyTopic, message: MessageCost, pace: LinkPace, vpn: VpnHeaders) -> MessageCost:
        """Return the cost of a message; one in fragments is acknowledged once if all arrive before the response."""
        alone = min(1.0, 1 / (self.every_s * topic.rate_hz))
        repeats = self._repeats(message, pace)
        packets = message.packets_up * repeats
        if repeats > 1:
            heartbeats, answers = packets, packets * self.answer_share
        elif topic.size_bytes > self.after_bytes:
            heartbeats, answers = packets, 1.0
        else:
            heartbeats = answers = max(topic.size_bytes / self.after_bytes, self._full_history_share(topic, pace))
        return MessageCost(
            message.fragments,
            message.bytes_up * repeats + heartbeats * self.heartbeat + alone * (self.alone + vpn.bytes),
            packets + alone,
            (answers + alone) * (self.acknowledgement + vpn.bytes),
            answers + alone,
        )

    def _repeats(self, message: MessageCost, pace: LinkPace) -> float:
        """Return how often each fragment is sent on average."""
        slow = pace.sends_in_s(message.bytes_up / message.fragments) > self.answered_after_s
        return (message.fragments + 1) / 2 if slow else 1.0

    def _full_history_share(self, topic: SteadyTopic, pace: LinkPace) -> float:
        """Return the share of messages that find the history full; each does until the acknowledgement arrives."""
        if topic.rate_hz * self.every_s <= self.history:
            return 0.0
        waiting = 1 + topic.rate_hz * pace.rtt_s
        return waiting / (self.history + waiting)


@dataclass(frozen=True, slots=True)
class DdsSizes:
    """Packet sizes of a DDS implementation, in bytes as IP packets."""

    announcement: int
    """Size of a participant's announcement to one port of one peer."""
    has_repeat: bool
    """Whether an announcement to an already known participant is sent twice."""
    sample_head: int
    """Header bytes of a message with one sample that fits into it, UDP and IP included."""
    reliability: Reliability


@dataclass(frozen=True, slots=True)
class DdsAnnouncements:
    """How a computer's DDS processes announce themselves, as its profile configures it."""

    processes: int
    """Number of DDS processes running on each computer."""
    ports: int
    """Number of ports of each peer to which a process sends its announcement, whether or not they are open."""
    every_s: float
    sizes: DdsSizes

    def announcement_bytes(self, peers: int, vpn: VpnHeaders) -> float:
        """Return the bytes a day on the link for announcements to `peers` peers."""
        packets = self.processes * (self.ports + self.processes * self.sizes.has_repeat) * _times_per_day(self.every_s)
        return peers * packets * (self.sizes.announcement + vpn.bytes)

    def refusal_bytes(self, peers: int, vpn: VpnHeaders) -> float:
        """Return the bytes a day of ICMP errors that the peers' kernels return for closed ports.

        Linux sends one a second to each address, and six at once after a pause (icmp(7), `icmp_ratelimit`).
        """
        closed_ports = max(0, self.ports - self.processes)
        a_day = min(DAY_S, self.processes * min(_ICMP_AT_ONCE, closed_ports) * _times_per_day(self.every_s))
        return peers * a_day * (self.sizes.announcement + _ICMP_ERROR + vpn.bytes)


@dataclass(frozen=True, slots=True)
class DdsMessages:
    """How a computer's profile makes DDS fragment messages, and the protocol overhead."""

    message_bytes: int
    """Maximum UDP payload."""
    fragment_bytes: int
    """Fragment size of a larger sample."""
    sizes: DdsSizes
    vpn: VpnHeaders

    def cost(self, topic: SteadyTopic, pace: LinkPace) -> MessageCost:
        """Return the cost of one message; a sample that does not fit into a datagram is sent in fragments."""
        padded_bytes = ceil(topic.size_bytes / 4) * 4
        head, fragments = self.sizes.sample_head + self.vpn.bytes, 1
        if self.sizes.sample_head - UDP_IP + padded_bytes > self.message_bytes:
            head, fragments = head + _FRAGMENT, ceil(topic.size_bytes / self.fragment_bytes)
        message = MessageCost(fragments, fragments * head + padded_bytes, fragments)
        return self.sizes.reliability.cost(topic, message, pace, self.vpn) if topic.reliable else message


def topic_flow(topics: Iterable[tuple[float, MessageCost]], subscribers: int) -> StandingFlow:
    """Return the flow of topics, given as rate in Hz and cost per message; every subscriber gets its own copy."""
    up = down = 0.0
    for rate_hz, cost in topics:
        up += rate_hz * cost.bytes_up * subscribers * DAY_S
        down += rate_hz * cost.bytes_down * subscribers * DAY_S
    return StandingFlow(TrafficSource.TELEMETRY, up, down)


@dataclass(frozen=True, slots=True)
class StandingTraffic:
    """The standing traffic of one link while the site's traffic uses it."""

    link: MeteredLink
    flows: tuple[StandingFlow, ...]
    """One flow for each source, in the order of `TrafficSource`."""
    pace: str = ""
    """How its probes to probe targets are paced to meet their budget, if they have one."""

    @property
    def day_bytes(self) -> int:
        """Bytes in 24 hours, both directions."""
        return round(sum(flow.both for flow in self.flows))

    @property
    def month_bytes(self) -> int:
        """Bytes in 30 days, both directions."""
        return MONTH_DAYS * self.day_bytes

    @property
    def idle_day_bytes(self) -> int:
        """Bytes a day while another link carries the site's traffic."""
        return round(sum(flow.both for flow in self.flows if flow.always))

    @property
    def bill(self) -> Bill:
        """The bill for a month, as one session that never ends."""
        return bill(self.month_bytes, MONTH_DAYS * DAY_S, self.link.tariff if self.link.is_metered else None)

    @property
    def words(self) -> tuple[str, ...]:
        """The traffic as lines of text: `39.5 MB a day, 1186.2 MB a month …`."""
        parts = join(", ", (join(" ", (msg(flow.source), size(round(flow.both)))) for flow in self.flows))
        price = msg(f": {arg(self.bill.money)}" if self.link.is_metered else "")
        lines = [
            msg(
                f"{arg(size(self.day_bytes))} per day, {arg(size(self.month_bytes))} per month while it carries the "
                f"traffic{arg(price)}"
            )
        ]
        if self.flows:
            lines.append(msg(f"per day: {arg(parts)}"))
        if self.pace:
            lines.append(self.pace)
        if self.bill.billed_bytes > self.month_bytes:
            lines.append(msg(f"a month is billed as {arg(size(self.bill.billed_bytes))}, {arg(self.bill.basis)}"))
        if self.idle_day_bytes:
            lines.append(msg(f"{arg(size(self.idle_day_bytes))} per day while another link carries the traffic"))
        return tuple(lines)

    def only(self, source: TrafficSource) -> StandingTraffic:
        """Return the traffic of one source."""
        return replace(self, flows=tuple(flow for flow in self.flows if flow.source is source))

    def as_dict(self) -> Mapping[str, object]:
        """Return JSON-able data."""
        return {
            "day_bytes": self.day_bytes,
            "month_bytes": self.month_bytes,
            "idle_day_bytes": self.idle_day_bytes,
            "flows": [
                {"source": flow.source.value, "up_day_bytes": round(flow.up), "down_day_bytes": round(flow.down)}
                for flow in self.flows
            ],
            "bill_month": dict(self.bill.as_dict()) if self.link.is_metered else None,
            "words": list(self.words),
        }


def sum_by_source(flows: Iterable[StandingFlow]) -> tuple[StandingFlow, ...]:
    """Sum the flows per source, in the order of `TrafficSource`; sources without a byte are left out."""
    sums: dict[TrafficSource, StandingFlow] = {}
    for flow in flows:
        before = sums.get(flow.source, StandingFlow(flow.source, 0, 0, flow.always))
        always = before.always and flow.always
        sums[flow.source] = StandingFlow(flow.source, before.up + flow.up, before.down + flow.down, always)
    return tuple(sums[source] for source in TrafficSource if source in sums and sums[source].both)


def _times_per_day(interval_s: float) -> float:
    return DAY_S / interval_s
