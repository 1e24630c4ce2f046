"""What a member reads: the page of instructions, what it may reach, its self-test.

The page of instructions: as text, and as a page for a browser that loads nothing from elsewhere.

The templates print blocks with an empty line between them: a heading is underlined, a list begins with hyphens, what is
to be typed is indented by four spaces, all else is a paragraph.

What a member may reach, and who may reach it, in words: read from the policy that the firewall is made of.

The self-test, the public facts about one member that it needs, and the faults that it recognises.

The patterns are those of openvpn 2.4 to 2.6 (its `src/openvpn/`). A server refuses a certificate by silence (facts 7):
where causes cannot be told apart, the text says so. Filled in: `{endpoint}`, `{proto}`, `{now}`, `{line}`.
"""

from __future__ import annotations

import hashlib
import html
import json
import re
import textwrap
from dataclasses import dataclass
from datetime import UTC, datetime
from ipaddress import IPv4Address, IPv4Network
from typing import TYPE_CHECKING, Any, NamedTuple

from atlantis_netcfg.declaration.model import Transport
from atlantis_netcfg.render import environment, template_folder
from atlantis_netcfg.vpn import routeros
from atlantis_netcfg.vpn.enrolment_package.profile import day, is_declared, remote
from atlantis_netcfg.vpn.identity import Identity, Member, MemberKind, MemberLink, MembershipList, Wrap
from atlantis_netcfg.vpn.policy import ANYTHING, PING, Permission, Policy, PolicyTraffic, Protocol, Zone, policy
from atlantis_netcfg.vpn.server import tunnel_address

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.declaration import Declaration


_OURS = "p_site_hosts"
_NAMES = {
    "p_control_centres": "the control centre",
    "p_site_gateways": "the gateways of the sites",
    _OURS: "the pilot's own computers and its technicians",
    "p_site_lans": "whatever stands in the LANs of the sites",
    "p_guest_devices": "the devices of partners, and whatever stands in the LANs of the sites",
    "p_all_robots": "the robots, in the VPN and in the LANs of the sites",
}
"""The others, by their set in the firewall; what is not here offers services."""


@dataclass(frozen=True, slots=True)
class Reach:
    """One kind of others."""

    who: str
    hosts: tuple[tuple[str, IPv4Address], ...]
    """Those of them that are declared, with their addresses in the VPN."""
    traffic: tuple[str, ...]
    """What passes, in words."""
    ping: bool


def reach(declaration: Declaration, member: Member) -> tuple[Reach, ...]:
    """Whom the member may begin with. Other members come and go: of them only the kind is told."""
    found: dict[str, list[Permission]] = {}
    for permission in _policy(declaration, member).permissions:
        if permission.source is not None and permission.source.holds(member.address):
            name = permission.destination.name if permission.destination else ""
            found.setdefault(name, []).append(permission)
    made = (_reach(declaration, member, permissions) for permissions in found.values())
    return tuple(item for item in made if item is not None)


def reached_by(declaration: Declaration, member: Member) -> tuple[str, ...]:
    """Partners, by their full names, that see the robot that the member is."""
    others = (partner for name, partner in declaration.partners.items() if name != member.partner)
    return tuple(other.full_name for other in others if member.vehicle is not None and member.vehicle in other.sees)


def tunnel_of_server(declaration: Declaration) -> IPv4Address:
    """The server's own address in the VPN: every member may ping it."""
    return tunnel_address(declaration, declaration.hosts[declaration.pilot.vpn.server])


def dds_port(declaration: Declaration, member: Member) -> int | None:
    """First port of the DDS that the member may send to; None where it may speak to nobody, or there is no DDS."""
    ports = [
        permission.traffic.ports.start
        for permission in _policy(declaration, member).permissions
        if permission.source is not None
        and permission.source.holds(member.address)
        and permission.traffic.protocol is Protocol.UDP
        and permission.traffic.ports
        and len(permission.traffic.ports) > 1
    ]
    return ports[0] if ports else None


def _policy(declaration: Declaration, member: Member) -> Policy:
    return policy(declaration, _roll(member))


def _roll(*members: Member) -> MembershipList:
    """A list of these members alone."""
    return MembershipList({member.name: member for member in members}, 0, "", datetime.fromtimestamp(0, UTC), ())


def _reach(declaration: Declaration, member: Member, permissions: list[Permission]) -> Reach | None:
    zone = permissions[0].destination
    traffic = tuple(dict.fromkeys(_words(permission.traffic, permission.why) for permission in permissions))
    ping = any(item.traffic in (PING, ANYTHING) for item in permissions)
    if zone is None:
        server = _policy(declaration, member).server
        return Reach("the VPN's server", ((server.name, server.address),), traffic, ping=ping)
    hosts = () if zone.name == _OURS else tuple(_hosts(declaration, zone))
    who = _who(declaration, member, zone)
    return Reach(who, hosts, traffic, ping=ping) if who else None


def _who(declaration: Declaration, member: Member, zone: Zone) -> str:
    """The others of a zone; empty where they are nobody."""
    whose = declaration.partners.get(member.partner or "")
    if whose is not None and zone.name == f"p_{member.partner}_sees":
        return "the robots " + ", ".join(declaration.vehicles[name].name for name in whose.sees)
    if whose is not None and zone.name == f"p_{member.partner}_lan":
        return f"the robots of {whose.full_name} in the LANs of the sites"
    if whose is not None and zone.name == f"p_{member.partner}":
        return f"all other devices of {whose.full_name}"
    return _NAMES.get(zone.name, "services") if zone.networks else ""


def _hosts(declaration: Declaration, zone: Zone) -> Iterator[tuple[str, IPv4Address]]:
    for host in declaration.hosts.values():
        address = getattr(host.device, "vpn_address", None)
        if address is not None and IPv4Network(address) in zone.networks:
            yield host.name, address


def _words(traffic: PolicyTraffic, why: str) -> str:
    """What passes, for people; `why` names a service."""
    if traffic == ANYTHING:
        return "everything"
    if traffic == PING:
        return "ping"
    ports = traffic.ports or range(0)
    name = str(traffic.protocol).upper()
    return f"DDS ({name} {ports[0]} to {ports[-1]})" if len(ports) > 1 else f"{why} ({name} {ports[0]})"


_WHAT = {
    MemberKind.ROBOT: "the robot",
    MemberKind.LAPTOP: "the laptop",
    MemberKind.ROUTER: "the router",
    MemberKind.HOST: "the computer",
}
_RESTART_S = {MemberLink.FIBRE: 10, MemberLink.LTE: 30, MemberLink.SATELLITE: 300}
"""Pause after the server has sent a robot away; on a satellite each attempt is paid."""
_MESSAGE_BYTES = 1200
"""Of a DDS message: whole in one packet of every link (facts 9)."""
_WIDTH = 100
_UNDERLINE = re.compile(r"(=+|-+)")


@dataclass(frozen=True, slots=True)
class DdsAdvice:
    """What a participant of ROS 2 needs to know."""

    domain: int
    middleware: str
    message_bytes: int
    peers: tuple[IPv4Address, ...]


@dataclass(frozen=True, slots=True)
class PageView:
    """What the templates print."""

    pilot: str
    name: str
    kind: str
    what: str
    address: IPv4Address
    until: str
    contact: str
    key_file: str
    sealed_file: str
    old_client: bool
    on_satellite: bool
    restart_s: int
    tested: bool
    """Whether the hand-out has a self-test."""
    reach: tuple[Reach, ...]
    reached_by: tuple[str, ...]
    dds: DdsAdvice | None
    files: tuple[tuple[str, str], ...]
    routeros: str
    """First that can be a member."""
    interface: str
    """Of the tunnel, on a router."""
    server: IPv4Address
    """In the VPN."""
    server_name: str
    """As a router finds it."""


def page_view(
    declaration: Declaration,
    identity: Identity,
    *,
    contact: str,
    sealed_file: str,
    files: Sequence[tuple[str, str]],
) -> PageView:
    """Everything that the page says of one member; `contact` is whom the partner calls, in the operator's words."""
    member = identity.member
    found = reach(declaration, member)
    return PageView(
        pilot=declaration.pilot.name,
        name=member.name,
        kind="host" if is_declared(member) else str(member.kind),
        what=_what(declaration, member),
        address=member.address,
        until=day(identity),
        contact=contact,
        key_file=files[0][0],
        sealed_file=sealed_file,
        old_client=identity.certificate.wrap is Wrap.TLS_CRYPT,
        on_satellite=member.link is MemberLink.SATELLITE,
        restart_s=_RESTART_S[member.link],
        tested=any(name == "self-test.py" for name, _ in files),
        reach=found,
        reached_by=reached_by(declaration, member),
        dds=_dds(declaration, member, found),
        files=tuple(files),
        routeros=str(routeros.SINCE),
        interface=routeros.INTERFACE,
        server=tunnel_of_server(declaration),
        server_name=declaration.pilot.vpn.endpoint_name,
    )


def page(view: PageView) -> tuple[str, ...]:
    """The blocks of the page."""
    text = environment().get_template("handout/README.txt.j2").render(page=view)
    return tuple(block.strip("\n") for block in re.split(r"\n{2,}", text.strip("\n")))


def restart(view: PageView) -> str:
    """The drop-in with which systemd starts a robot's tunnel again."""
    return environment().get_template("handout/restart.conf.j2").render(page=view)


def as_text(blocks: Sequence[str]) -> str:
    """The page for every editor, in lines of 100 characters."""
    return "\n\n".join(_wrapped(block) for block in blocks) + "\n"


def as_html(blocks: Sequence[str]) -> str:
    """The same page for a browser; nothing in it is loaded from elsewhere."""
    title = html.escape(blocks[0].partition("\n")[0])
    body = "\n".join(_marked_up(html.escape(block, quote=False)) for block in blocks)
    return environment().get_template("handout/README.html.j2").render(title=title, body=body)


def _wrapped(block: str) -> str:
    lines = block.split("\n")
    if _is_typed(lines) or _is_heading(lines):
        return block
    if _is_list(lines):
        return "\n".join(textwrap.fill(line, _WIDTH, subsequent_indent="  ") for line in lines)
    return textwrap.fill(" ".join(lines), _WIDTH, break_on_hyphens=False)


def _marked_up(block: str) -> str:
    lines = block.split("\n")
    if _is_heading(lines):
        level = "h1" if lines[1][0] == "=" else "h2"
        return f"<{level}>{lines[0]}</{level}>"
    if _is_typed(lines):
        return "<pre>" + "\n".join(line[4:] for line in lines) + "</pre>"
    if _is_list(lines):
        return "<ul>\n" + "\n".join(f"<li>{line[2:]}</li>" for line in lines) + "\n</ul>"
    return "<p>" + "\n".join(lines) + "</p>"


def _is_heading(lines: Sequence[str]) -> bool:
    return len(lines) == 2 and _UNDERLINE.fullmatch(lines[1]) is not None  # noqa: PLR2004 - a line and its underline


def _is_typed(lines: Sequence[str]) -> bool:
    return all(line.startswith("    ") for line in lines)


def _is_list(lines: Sequence[str]) -> bool:
    return all(line.startswith("- ") for line in lines)


def _what(declaration: Declaration, member: Member) -> str:
    whose = f" of {declaration.partners[member.partner].full_name}" if member.partner else ""
    return f"{_WHAT[member.kind]} `{member.device}`{whose}"


def _dds(declaration: Declaration, member: Member, found: Sequence[Reach]) -> DdsAdvice | None:
    """Only for who speaks DDS to computers of ours, and is not configured by this toolkit itself."""
    dds = declaration.pilot.dds
    if dds is None or member.kind not in {MemberKind.ROBOT, MemberKind.LAPTOP}:
        return None
    spoken = [entry for entry in found if any(words.startswith("DDS") for words in entry.traffic)]
    peers = tuple(address for item in spoken for _, address in item.hosts)
    return DdsAdvice(dds.domain, dds.middleware, _MESSAGE_BYTES, peers) if peers else None


class SelfTestFault(NamedTuple):
    """A fault that one line tells."""

    pattern: str
    """What is searched for in a line, for `re`."""
    what: str
    do: str


FAULTS = (
    SelfTestFault(
        r"Unrecognized option or missing",
        "this OpenVPN does not know a word of the profile: {line}",
        "Install OpenVPN 2.5 or later. Where that cannot be, ask for a hand-out for OpenVPN 2.4.",
    ),
    SelfTestFault(
        r"Cannot open TUN/TAP dev|Cannot ioctl TUNSETIFF|/dev/net/tun",
        "this computer gives OpenVPN no tunnel device",
        "Run the test as root. In a container or virtual machine its administrator has to allow /dev/net/tun.",
    ),
    SelfTestFault(
        r"certificate is not yet valid",
        "by this computer's clock ({now}) the control centre's certificate is not yet valid: the clock is behind",
        "Set the clock, then run the test again.",
    ),
    SelfTestFault(
        r"certificate has expired",
        "by this computer's clock ({now}) the control centre's certificate has expired",
        "Look whether the clock is right. If it is, tell the control centre.",
    ),
    SelfTestFault(
        r"VERIFY (X509NAME )?ERROR|VERIFY KU ERROR|VERIFY EKU ERROR",
        "what answers at {endpoint} is not the control centre's server",
        "Do not use this network for the VPN, and tell the control centre what network it is.",
    ),
    SelfTestFault(
        r"AUTH_FAILED",
        "the control centre does not admit this device's certificate: it was revoked, or a newer one is in use",
        "Use your newest hand-out. If this is the newest, ask the control centre.",
    ),
    SelfTestFault(
        r"server-pushed-halt|Received control message: HALT",
        "the control centre has just ended this device's session",
        "Ask the control centre.",
    ),
    SelfTestFault(
        r"ECONNREFUSED|Connection refused",
        "the control centre's computer answers, and its VPN server does not run",
        "Try again in some minutes, then tell the control centre.",
    ),
    SelfTestFault(
        r"Network is unreachable|No route to host|ENETUNREACH|EHOSTUNREACH",
        "this computer has no way to {endpoint}",
        "Connect it to the internet, then run the test again.",
    ),
    SelfTestFault(
        r"write UDP.*(Operation not permitted|Permission denied)|EPERM",
        "a firewall on this computer forbids what the VPN sends",
        "Allow {proto} to {endpoint}.",
    ),
    SelfTestFault(
        r"Cannot load|no start line|PEM_read|Insufficient key material|tls-crypt-v2 .*(error|fail)",
        "the profile is damaged: {line}",
        "Unpack the hand-out again. If that does not help, ask for a new one.",
    ),
)
REFUSED = (
    "the control centre answers, and then says nothing more: it does not take this device's certificate",
    (
        "It was revoked or has expired, or one of the two clocks is wrong. Look at this computer's ({now}), then ask "
        "the control centre."
    ),
)
"""What is wrong and what to do where a first answer came: the key that wraps is right, and the way is open."""
SILENCE = (
    "nothing comes back from {endpoint}",
    (
        "From here it cannot be told which it is: the network that you are in lets no {proto} to {endpoint} pass, or "
        "the control centre's server or its line is down, or it has another key (tls-crypt) than your profile. Try "
        "from another network, such as a telephone's. If it works there, ask the first one's administrator to allow "
        "{proto} to {endpoint}. If not, ask the control centre, and whether you need a new hand-out."
    ),
)
"""The same where nothing came."""

_WAIT_S = {MemberLink.FIBRE: 20, MemberLink.LTE: 40, MemberLink.SATELLITE: 120}
"""How long the tunnel may take; by satellite it was seen up in 4 to 35 s (facts 9)."""
_FEW = 3
"""Computers that are pinged besides the server."""


def program() -> str:
    """The text of the self-test, the same for all members: Python 3.8, standard library alone."""
    return (template_folder() / "handout" / "self_test.py").read_text(encoding="utf-8")


def facts(declaration: Declaration, identity: Identity, profile: Secret, file_name: str, contact: str) -> str:
    """What the self-test compares with, as JSON; of the profile only its hash."""
    member, certificate, vpn = identity.member, identity.certificate, declaration.pilot.vpn
    values: dict[str, Any] = {
        "pilot": declaration.pilot.name,
        "name": member.name,
        "address": str(member.address),
        "endpoint": str(remote(declaration, member)),
        "port": vpn.port,
        "proto": "udp" if vpn.transport is Transport.UDP else "tcp",
        "server": str(tunnel_of_server(declaration)),
        "not_before": int(certificate.not_before.timestamp()),
        "not_after": int(certificate.not_after.timestamp()),
        "wrap": str(certificate.wrap),
        "profile": file_name,
        "profile_sha256": hashlib.sha256(profile.reveal().encode()).hexdigest(),
        "wait_s": _WAIT_S[member.link],
        "ping": _pinged(declaration, member),
        "dds_port": dds_port(declaration, member),
        "contact": contact,
        "faults": [list(item) for item in FAULTS],
        "refused": list(REFUSED),
        "silence": list(SILENCE),
    }
    return json.dumps(values, indent=1, ensure_ascii=False) + "\n"


def _pinged(declaration: Declaration, member: Member) -> list[list[str]]:
    """Computers of ours that answer pings, the server aside: it is asked first."""
    server = tunnel_of_server(declaration)
    found = {
        address: name
        for item in reach(declaration, member)
        if item.ping
        for name, address in item.hosts
        if address not in {server, member.address}
    }
    return [[name, str(address)] for address, name in list(found.items())[:_FEW]]
