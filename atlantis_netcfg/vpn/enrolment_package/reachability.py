"""What a member may reach, and who may reach it, in words: read from the policy that the firewall is made of."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from ipaddress import IPv4Network
from typing import TYPE_CHECKING

from atlantis_netcfg.vpn.identity import MembershipList
from atlantis_netcfg.vpn.policy import ANYTHING, PING, Protocol, policy
from atlantis_netcfg.vpn.server import tunnel_address

if TYPE_CHECKING:
    from collections.abc import Iterator
    from ipaddress import IPv4Address

    from atlantis_netcfg.declaration import Declaration
    from atlantis_netcfg.vpn.identity import Member
    from atlantis_netcfg.vpn.policy import Permission, Policy, Traffic, Zone

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


def _words(traffic: Traffic, why: str) -> str:
    """What passes, for people; `why` names a service."""
    if traffic == ANYTHING:
        return "everything"
    if traffic == PING:
        return "ping"
    ports = traffic.ports or range(0)
    name = str(traffic.protocol).upper()
    return f"DDS ({name} {ports[0]} to {ports[-1]})" if len(ports) > 1 else f"{why} ({name} {ports[0]})"
