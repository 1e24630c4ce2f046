"""A participant of the pilot's DDS domain responds on the gateway computer, at the address where others look for it.

A participant without topics announces itself there from the same computer, by unicast, and leaves again
(`agent/main.py`): a participant that accepts it announces itself in turn, with the addresses at which it is reached. No
other computer receives it. In addition, the bound ports are listed. A participant listens for announcements at 7410 +
250 d + 2 i, with i below the number in the inventory, and for data one port above (DDSI-RTPS 9.6.2.3). With the site's
profile it does not listen at the ports for multicast, 7400 + 250 d and one above. Without it Fast DDS also listens at
the first of them, and is found only by those with the profile; Cyclone DDS listens at both, at no port that peers know,
and is found by nobody (observed with 2.9.1 and 11.0.1, between two networks).

docs/engineers/probes.md describes what prevents a false response. The check does not see whether the route from a robot
to that address is open: `pytest checks/` tests the gateway's firewall, the item `vpn` the tunnel.
"""

from __future__ import annotations

import re
import socket
import struct
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.checklist.probes.site_checks import parse
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.links import LinkFinding

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from atlantis_netcfg.inventory.model import Dds

TABLE = "/proc/net/udp"
_BASE, _DOMAIN, _UNICAST, _EACH = 7400, 250, 10, 2
_HANDED_OUT = 32768
"""From here on, Linux assigns ports to programs that request none (ip-sysctl, ip_local_port_range)."""
_MULTICAST = 0
_ROW = re.compile(r"^\s*\d+: ([0-9A-F]{8}):([0-9A-F]{4}) .* (\d+)\s*$")
_HEADER = 20
"""Bytes of a message before its first submessage: `RTPS`, version, vendor, GUID prefix (9.4.4)."""
_INFO_DST, _DATA = 0x0E, 0x15
_SPEAK = frozenset({0x06, 0x07, 0x08, _DATA, 0x16})
"""Submessages that are addressed to somebody: ACKNACK, HEARTBEAT, GAP, DATA, DATA_FRAG."""
_ANNOUNCER = b"\x00\x01\x00\xc2"
"""Writer of announcements (9.3.1.5)."""
_LOCATOR = 24
"""Bytes of a locator: kind (1 is UDP over IPv4), port, address (9.3.2.3)."""
_DOMAIN_ID, _REACHED_AT = 0x0F, 0x32
"""Parameters of an announcement (9.6.2.2): domain, and metatraffic unicast locator."""


@dataclass(frozen=True, slots=True)
class _Participant:
    """A participant that announced itself in response to ours, and addressed it."""

    domain: int | None
    """None: not announced; the port of the request gives it."""
    addresses: frozenset[str]
    """Addresses at which it says that it is reachable."""


@dataclass(frozen=True, slots=True)
class _Socket:
    port: int
    drops: int
    """Datagrams that no program read in time."""

    @property
    def offset(self) -> int:
        return (self.port - _BASE) % _DOMAIN

    @property
    def participant(self) -> int | None:
        """Number of the participant, if this is the port on which it listens for announcements."""
        offset = self.offset - _UNICAST
        return offset // _EACH if offset >= 0 and offset % _EACH == 0 else None


@dataclass(frozen=True, slots=True)
class _BoundPorts:
    """Bound ports of one domain. Other programs may also have ports in that range."""

    domain: int
    sockets: tuple[_Socket, ...]
    """A port can have many sockets: the multicast ports are the same for everybody."""

    @property
    def participants(self) -> tuple[_Socket, ...]:
        """Sockets that listen for announcements."""
        return tuple({item.port: item for item in self.sockets if item.participant is not None}.values())

    @property
    def strangers(self) -> int:
        """Number of participants without the profile."""
        return self._count_at_offset(_MULTICAST)

    @property
    def is_dds(self) -> bool:
        """Whether a pair of related ports is bound; a single one may belong to another program."""
        return any(self._count_at_offset(item) and self._count_at_offset(item + 1) for item in (_MULTICAST, _UNICAST))

    @property
    def ports(self) -> str:
        """Ports that listen for announcements."""
        known_ports = {item.port for item in self.sockets if item.participant is not None or item.offset == _MULTICAST}
        return join(", ", map(str, sorted(known_ports)))

    def _count_at_offset(self, offset: int) -> int:
        return sum(item.offset == offset for item in self.sockets)


def dds_check(site: parse.OwnSite) -> base.Step:
    """Return the step on the gateway's participants; if no program can check, it is a step for a person."""
    dds = site.inventory.pilot.dds
    if dds is None:
        do = "The inventory has no DDS, so no program checks it: see which robots use ROS 2 here, and how."
        return parse.by_hand("dds", "DDS of the pilot is seen", do, "DDS is not needed, or it is seen.", site.hosts[1:])
    if site.gateway is not None:
        return parse.step(
            "dds", msg(f"DDS responds on the {arg(site.gateway.kind)}"), _SeenParticipant(site), site.hosts[1:]
        )
    return parse.by_hand(
        "dds",
        "DDS of another site is seen",
        msg(
            f"On a computer at {arg(site.name)}, list what DDS domain {arg(dds.domain)} carries, for example with "
            "`ros2 topic list`. The site has no gateway computer and no control centre to query."
        ),
        "The list has topics of a robot or a gateway at another site.",
        site.hosts,
    )


@dataclass(frozen=True, slots=True)
class _SeenParticipant:
    """Check that a DDS participant responds on the gateway computer."""

    site: parse.OwnSite

    @property
    def _dds(self) -> Dds:
        assert self.site.inventory.pilot.dds is not None  # noqa: S101 - the step is a person's without it
        return self.site.inventory.pilot.dds

    @property
    def _address(self) -> str:
        """Address at which the pilot's other participants look for this one."""
        assert self.site.gateway is not None  # noqa: S101 - the step is a person's without one
        return self._dds.address_of(self.site.gateway.device)

    def asks(self) -> tuple[base.Question, ...]:
        first = _BASE + _DOMAIN * self._dds.domain + _UNICAST
        ports = tuple(first + _EACH * number for number in range(self._dds.participants))
        discover = base.DdsDiscoverRequest("participants", base.Place.GATEWAY, self._address, self._dds.domain, ports)
        return (*parse.run("sockets", self.site, f"cat {TABLE}"), discover)

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        gateway, dds = self.site.gateway, self._dds
        assert gateway is not None  # noqa: S101 - the step is a person's without one
        result, participants = (
            parse.get_output(results["sockets"], gateway.name),
            _read_participants(results["participants"], gateway.name, self._address),
        )
        if isinstance(result, LinkFinding):
            return base.ProbeResult((result,))
        if "local_address" not in result:
            return base.ProbeResult((parse.unreadable(gateway.name, "its UDP sockets"),))
        if isinstance(participants, LinkFinding):
            return base.ProbeResult((participants,))
        bound_ports = tuple(_read_sockets(result))
        ours = next((entry for entry in bound_ports if entry.domain == dds.domain), _BoundPorts(dds.domain, ()))
        near = [entry for entry in bound_ports if entry is not ours and entry.is_dds]
        port_texts = [entry.ports for entry in (ours, *near) if entry.ports]
        there = [participant for participant in participants if participant.domain in {None, dds.domain}]
        evidence = (
            parse.declared_evidence("DDS domain", str(dds.domain)),
            parse.read(msg(f"UDP ports of DDS on {arg(gateway.name)}"), join(", ", port_texts) or "none"),
            parse.measured_evidence(
                msg(f"DDS participants that respond at {arg(self._address)}"), _list_addresses(there)
            ),
        )
        if not there and not ours.participants and not ours.is_dds:
            return base.ProbeResult((_no_participant_finding(gateway.name, dds, near),), evidence)
        wrong = tuple(_judge_ports(gateway.name, dds, ours))
        is_unreachable = any(item.code == "without-profile" and item.verdict is Verdict.FAIL for item in wrong)
        reach_findings = () if is_unreachable else (self._judge_reachability(gateway.name, there, ours),)
        fine = tuple(finding for finding in reach_findings if not wrong or finding.verdict is not Verdict.PASS)
        return base.ProbeResult((*wrong, *fine), evidence)

    def _judge_reachability(self, name: str, there: Sequence[_Participant], bound: _BoundPorts) -> LinkFinding:
        address, domain = self._address, self._dds.domain
        if not there:
            message = msg(
                f"no DDS participant responds at {arg(address)} of {arg(name)} in domain {arg(domain)}, although its "
                "ports are in use"
            )
            hint = msg(
                f"on {arg(name)}: `sudo ss -ulpn` shows what uses UDP port {arg(bound.ports)}; restart the data gateway"
            )
            return parse.unknown("nobody-answers", message, hint)
        reachable_participants = [participant for participant in there if address in participant.addresses]
        if not reachable_participants:
            message = msg(
                f"DDS on {arg(name)} announces itself at {arg(_list_addresses(there))}, but others look for it at "
                f"{arg(address)}"
            )
            hint = (
                "source the site's ros.env before starting it: ROS_LOCALHOST_ONLY or another profile restricts "
                "it to that address"
            )
            return parse.unknown("not-reachable", message, hint)
        where = msg(f"at {arg(address)}, in domain {arg(domain)}")
        if len(reachable_participants) == 1:
            return parse.good("answers", msg(f"1 DDS participant on {arg(name)} responds {arg(where)}"))
        return parse.good(
            "answers", msg(f"{arg(len(reachable_participants))} DDS participants on {arg(name)} respond {arg(where)}")
        )


def _list_addresses(there: Sequence[_Participant]) -> str:
    """Format the addresses that participants announce."""
    return parse.join_words(sorted({address for participant in there for address in participant.addresses})) or "none"


def _read_participants(answer: base.Answer, name: str, address: str) -> tuple[_Participant, ...] | LinkFinding:
    """Return the participants that announced themselves and addressed only our request."""
    if not isinstance(answer, base.DdsDiscoverResult):
        return parse.unreadable(name, "its DDS participants")
    if answer.trouble is base.Trouble.UNREACHABLE:
        message = msg(f"{arg(name)} does not have the address {arg(address)}, at which others look for its DDS")
        return parse.unknown(
            "no-such-address", message, msg(f"bring its network or its tunnel up first: `ip -br addr` on {arg(name)}")
        )
    if answer.trouble is not None:
        return parse.silent(name, answer.trouble, answer.words)
    participants: dict[bytes, _Participant] = {}
    spoke: set[bytes] = set()
    for _, datagram in answer.datagrams:
        prefix = datagram[8:_HEADER]
        if datagram[:4] != b"RTPS" or len(prefix) != len(answer.prefix) or prefix == answer.prefix:
            continue
        try:
            is_for_us, new_participant = _message(datagram, answer.prefix)
        except (struct.error, ValueError, IndexError):
            continue
        spoke |= {prefix} if is_for_us else set()
        if new_participant is not None:
            participants[prefix] = new_participant
    return tuple(participant for prefix, participant in participants.items() if prefix in spoke)


def _message(message: bytes, asked_by: bytes) -> tuple[bool, _Participant | None]:
    """Return whether a message addresses us, and its new participant. Raises struct.error, ValueError, IndexError."""
    at, to_us, is_for_us, new_participant = _HEADER, False, False, None
    while at + 4 <= len(message):
        kind, flags = message[at], message[at + 1]
        order = "<" if flags & 1 else ">"
        (length,) = struct.unpack_from(f"{order}H", message, at + 2)
        body = message[at + 4 : at + 4 + length] if length else message[at + 4 :]
        if len(body) < length:
            raise ValueError
        if kind == _INFO_DST:
            to_us = body[:12] == asked_by
        is_for_us = is_for_us or (to_us and kind in _SPEAK)
        if kind == _DATA and body[8:12] == _ANNOUNCER:
            new_participant = _parse_announcement(body, flags, order) or new_participant
        at = at + 4 + length if length else len(message)
    return is_for_us, new_participant


def _parse_announcement(body: bytes, flags: int, order: str) -> _Participant | None:
    """Parse SPDP's DATA (9.4.5.4); None for a leaving participant, which has key and status, and no data."""
    if not flags & 4:
        return None
    (ahead,) = struct.unpack_from(f"{order}H", body, 2)
    at = 4 + ahead
    if flags & 2:
        at = _parameters(body, at, order)[1]
    result, _ = _parameters(body, at + 4, "<" if body[at + 1] & 1 else ">")
    domains = [struct.unpack(f"{item}I", value[:4])[0] for item, name, value in result if name == _DOMAIN_ID]
    places = [value for _, name, value in result if name == _REACHED_AT]
    over_udp = [value for value in places if len(value) == _LOCATOR and value[:4] in {b"\1\0\0\0", b"\0\0\0\1"}]
    addresses = frozenset(socket.inet_ntoa(value[20:]) for value in over_udp)
    return _Participant(domains[0] if domains else None, addresses)


def _parameters(data: bytes, at: int, order: str) -> tuple[list[tuple[str, int, bytes]], int]:
    """Return byte order, name and value of each parameter, and their end (9.4.2.11). Raises struct.error if missing."""
    parameters: list[tuple[str, int, bytes]] = []
    while True:
        name, length = struct.unpack_from(f"{order}HH", data, at)
        if name == 1:
            return parameters, at + 4
        parameters.append((order, name, data[at + 4 : at + 4 + length]))
        at += 4 + length


def _read_sockets(text: str) -> Iterator[_BoundPorts]:
    rows = filter(None, map(_ROW.match, text.splitlines()))
    sockets = sorted((int(row[2], 16), int(row[3])) for row in rows)
    bound_sockets = [_Socket(port, drops) for port, drops in sockets if _BASE <= port < _HANDED_OUT]
    for domain, those in groupby(bound_sockets, lambda item: (item.port - _BASE) // _DOMAIN):
        yield _BoundPorts(domain, tuple(those))


def _no_participant_finding(name: str, dds: Dds, near: Sequence[_BoundPorts]) -> LinkFinding:
    if near:
        message = msg(
            f"DDS on {arg(name)} runs in domain {arg(parse.join_words(str(item.domain) for item in near))}; the "
            f"inventory says {arg(dds.domain)}"
        )
        return parse.fail(
            "other-domain", message, "set ROS_DOMAIN_ID as in the inventory: source the site's ros.env before starting"
        )
    hint = msg(f"start the data gateway or any ROS 2 node on {arg(name)}, then repeat the check")
    message = msg(f"no program uses DDS on {arg(name)} in domain {arg(dds.domain)}, so nothing is announced")
    return parse.unknown("nobody-announces", message, hint)


def _judge_ports(name: str, dds: Dds, bound_ports: _BoundPorts) -> Iterator[LinkFinding]:
    ours = bound_ports.participants
    yield from _profile(name, bound_ports)
    late = [item for item in ours if item.participant is not None and item.participant >= dds.participants]
    if late:
        message = msg(
            f"{arg(len(late))} of the {arg(len(ours))} DDS participants on {arg(name)} exceed the "
            f"{arg(dds.participants)} of the inventory"
        )
        yield parse.warn("too-many-participants", message, "no peer finds these: stop some, or increase `participants`")
    drop_count = sum(our.drops for our in ours)
    if drop_count:
        message = msg(f"{arg(name)} dropped {arg(drop_count)} DDS announcements that no program read in time")
        yield parse.warn(
            "announcements-dropped", message, msg(f"check the load of {arg(name)}; robots may be discovered late")
        )


def _profile(name: str, bound_ports: _BoundPorts) -> Iterator[LinkFinding]:
    hint = "stop what is running, source the site's ros.env for the link in use, and start it again"
    if bound_ports.strangers and not bound_ports.participants:
        message = msg(
            f"DDS on {arg(name)} runs in domain {arg(bound_ports.domain)} without the site's profile: no other site "
            "finds it"
        )
        yield parse.fail("without-profile", message, hint)
    elif bound_ports.strangers:
        message = msg(
            f"1 DDS participant on {arg(name)} runs without the site's profile: other sites may not find it, or lose it"
            if bound_ports.strangers == 1
            else f"{arg(bound_ports.strangers)} DDS participants on {arg(name)} run without the site's profile:"
            " other sites may not find them, or lose them"
        )
        yield parse.warn("without-profile", message, hint)
