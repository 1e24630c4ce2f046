"""Access policy of the VPN: a list of permissions, from inventory and members. The rest is denied.

`Policy.allows` decides for any two addresses, and the firewall is the same list as nftables rules. In a site's LAN the
hosts of the inventory are ours, and everything else is a guest: a robot may be a partner's, whoever has connected it.
Traffic that does not pass the server, such as that between two computers of one LAN, cannot be denied here.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, date, datetime, time, timedelta
from enum import StrEnum
from functools import cached_property
from ipaddress import IPv4Address, IPv4Network
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.routeros.render import environment, nft_comment
from atlantis_netcfg.vpn import identity

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping

    from atlantis_netcfg.inventory import Host, Inventory


class Protocol(StrEnum):
    """Protocols that the firewall distinguishes; ICMP means echo, as ICMP errors pass with their flow."""

    ICMP = "icmp"
    TCP = "tcp"
    UDP = "udp"


@dataclass(frozen=True, slots=True)
class Flow:
    """Traffic sent by the initiator, to a port; ICMP has none."""

    protocol: Protocol
    port: int | None = None


@dataclass(frozen=True, slots=True)
class PolicyTraffic:
    """A set of flows. No protocol: every flow; no ports: every port."""

    protocol: Protocol | None = None
    ports: range | None = None

    def holds(self, flow: Flow) -> bool:
        """Return True if a flow belongs to this set."""
        if self.protocol is None:
            return True
        return flow.protocol is self.protocol and (self.ports is None or flow.port in self.ports)


ANYTHING = PolicyTraffic()
PING = PolicyTraffic(Protocol.ICMP)


@dataclass(frozen=True, slots=True)
class Zone:
    """Addresses with equal treatment; the name is that of their set in the firewall."""

    name: str
    networks: tuple[IPv4Network, ...]

    def holds(self, address: IPv4Address) -> bool:
        """Return True if the zone contains the address."""
        return any(address in network for network in self.networks)


@dataclass(frozen=True, slots=True)
class Permission:
    """Permission to open a kind of flow. No source or destination: the server itself."""

    source: Zone | None
    destination: Zone | None
    traffic: PolicyTraffic
    why: str
    """Short reason, used as a comment in the firewall."""


@dataclass(frozen=True, slots=True)
class Party:
    """One end of a flow."""

    name: str
    address: IPv4Address


@dataclass(frozen=True)
class Policy:
    """The complete access policy."""

    server: Party
    server_addresses: frozenset[IPv4Address]
    """Addresses of the server in the tunnel and in its LAN: packets to them are for the server itself."""
    members: Mapping[str, tuple[IPv4Network, ...]]
    """Admitted members by name: the tunnel address, and for a site's router also the networks behind it."""
    beside: Zone
    """LAN of the server, and networks that its router connects to it: reached without the tunnel."""
    permissions: tuple[Permission, ...]

    @cached_property
    def member_zone(self) -> Zone:
        """The zone of all addresses behind the tunnel."""
        return zone_of("p_members", (network for networks in self.members.values() for network in networks))

    @property
    def zones(self) -> tuple[Zone, ...]:
        """Every zone that a permission names, once; the firewall has a set for each."""
        named_zones = (
            zone
            for permission in self.permissions
            for zone in (permission.source, permission.destination)
            if zone is not None
        )
        return tuple({zone.name: zone for zone in named_zones}.values())

    def allows(self, source: Party, destination: Party, flow: Flow) -> bool:
        """Return True if the source may open this flow, and gets the replies."""
        ends = (source.address, destination.address)
        if not all(self._is_known(address) for address in ends):
            return False
        if not any(self.member_zone.holds(address) for address in ends):
            return True  # without the tunnel
        return any(
            permission.traffic.holds(flow)
            and self._is_in_zone(permission.source, source.address)
            and self._is_in_zone(permission.destination, destination.address)
            for permission in self.permissions
        )

    def _is_known(self, address: IPv4Address) -> bool:
        return address in self.server_addresses or self.member_zone.holds(address) or self.beside.holds(address)

    def _is_in_zone(self, zone: Zone | None, address: IPv4Address) -> bool:
        local = address in self.server_addresses
        return local if zone is None else not local and zone.holds(address)


def zone_of(name: str, networks: Iterable[IPv4Network]) -> Zone:
    """Return a zone with sorted networks, without duplicates or nesting: a firewall set allows no overlap."""
    network_set = set(networks)
    wide = [item for item in network_set if item.prefixlen < item.max_prefixlen]
    return Zone(
        name,
        tuple(
            sorted(
                network for network in network_set if not any(network != net and network.subnet_of(net) for net in wide)
            )
        ),
    )


def policy(inventory: Inventory, membership: identity.MembershipList) -> Policy:
    """Return the policy of a pilot, without revoked members and those whose partner or host left the inventory."""
    return _PolicyDraft(inventory, membership).policy()


_HOST_KINDS = frozenset({identity.MemberKind.HOST, identity.MemberKind.ROUTER})
"""Kinds of the pilot's own members that are hosts in the inventory."""


class _PolicyDraft:
    """Builder of a policy from the zones of a pilot."""

    def __init__(self, inventory: Inventory, membership: identity.MembershipList) -> None:
        self._pilot = inventory.pilot
        self._partners = inventory.partners
        self._sites = inventory.sites
        self._hosts = inventory.hosts
        self._all_vehicles = inventory.vehicles
        self._members = [item for item in membership.members.values() if item.good and self._is_declared(item)]
        self._behind = {member.name: self._networks(member) for member in self._members}

    def _is_declared(self, member: identity.Member) -> bool:
        if member.partner is None and member.kind in _HOST_KINDS:
            return member.name in self._hosts
        return member.partner is None or member.partner in self._partners

    def _networks(self, member: identity.Member) -> tuple[IPv4Network, ...]:
        """Return the tunnel address, and for a site's router also the networks behind it."""
        local = (IPv4Network(member.address),)
        host = self._hosts.get(member.name) if member.partner is None else None
        if host is None or not isinstance(host.device, model.Router):
            return local
        return (*local, *self._site_networks(host.site))

    def _site_networks(self, name: str) -> tuple[IPv4Network, ...]:
        site = self._sites[name]
        return site.lan.network, site.management.network

    def policy(self) -> Policy:
        server = self._hosts[self._pilot.vpn.server]
        addresses = _addresses(server, lan=True)
        return Policy(
            server=Party(server.name, addresses[0]),
            server_addresses=frozenset(addresses),
            members=self._behind,
            beside=Zone("p_server_site", self._site_networks(server.site)),
            permissions=(
                *self._host_permissions(),
                *self._of_guests(),
                *self._partner_permissions(),
                *self._of_server(),
            ),
        )

    def _host_permissions(self) -> Iterator[Permission]:
        local = [IPv4Network(member.address) for member in self._members if _ours(member)]
        host_networks = [IPv4Network(address) for host in self._hosts.values() for address in self._in_lan(host)]
        hosts = zone_of("p_site_hosts", (*local, *host_networks, *self._management()))
        yield Permission(hosts, hosts, ANYTHING, "our hosts and technicians")
        yield Permission(self._managers(), zone_of("p_site_lans", self._lans()), ANYTHING, "technicians to the LANs")

    def _of_guests(self) -> Iterator[Permission]:
        """Yield permissions of guest devices: with control centres, gateways (robots) and the VPN's services."""
        guests = self._zone_of_members("p_guest_devices", lambda member: not _ours(member), self._lans())
        robots = self._zone_of_members(
            "p_all_robots", lambda item: item.kind is identity.MemberKind.ROBOT, self._vehicles(self._all_vehicles)
        )
        yield from self._both_ways(guests, self._speaking("p_control_centres", model.ControlCentre), "control centres")
        yield from self._both_ways(robots, self._speaking("p_site_gateways", model.Gateway), "robots and gateways")
        for service in self._pilot.vpn.services:
            traffic = PolicyTraffic(Protocol(service.transport), range(service.port, service.port + 1))
            yield Permission(guests, self._serving(service.host), traffic, service.name)

    def _partner_permissions(self) -> Iterator[Permission]:
        for name, partner in self._partners.items():
            zone = zone_of(f"p_{name}", (IPv4Network(item.address) for item in self._members if item.partner == name))
            yield Permission(zone, zone, ANYTHING, msg(f"within {arg(name)}"))
            yield from self._services_for(name, zone)
            if partner.sees:
                robots = [IPv4Network(member.address) for member in self._members if member.vehicle in partner.sees]
                visible_zone = zone_of(f"p_{name}_sees", (*robots, *self._vehicles(partner.sees)))
                yield from self._both_ways(zone, visible_zone, msg(f"what {arg(name)} sees"))
            # In a LAN nobody proves who he is: an address there is worth less than one in the VPN.
            theirs = self._vehicles([key for key, vehicle in self._all_vehicles.items() if vehicle.partner == name])
            if theirs:
                yield from self._both_ways(
                    zone, zone_of(f"p_{name}_lan", theirs), msg(f"robots of {arg(name)} in LANs")
                )

    def _services_for(self, partner: str, zone: Zone) -> Iterator[Permission]:
        """Yield permissions for services of our computers that are open to this partner."""
        for host in self._hosts.values():
            for service in host.device.services if isinstance(host.device, model.ServerComputer) else ():
                if service.port is not None and partner in service.partners:
                    traffic = PolicyTraffic(Protocol(service.transport), range(service.port, service.port + 1))
                    yield Permission(zone, self._serving(host.name), traffic, service.name)

    def _of_server(self) -> Iterator[Permission]:
        """Yield permissions to the server itself: only technicians, as a site's LAN also contains partners' robots.

        The server's own LAN is not covered: traffic that arrives there without the tunnel is not handled by this
        firewall.
        """
        everybody = zone_of("p_members", (network for networks in self._behind.values() for network in networks))
        yield Permission(everybody, None, PING, "is the server there?")
        yield Permission(self._managers(), None, ANYTHING, "technicians")
        yield Permission(None, everybody, ANYTHING, "the server's own")

    def _both_ways(self, zone: Zone, other: Zone, why: str) -> Iterator[Permission]:
        """Yield permissions in both directions for ping, and for DDS if the pilot has it."""
        for traffic in (PING, *_dds(self._pilot.dds)):
            yield Permission(zone, other, traffic, why)
            yield Permission(other, zone, traffic, why)

    def _zone_of_members(
        self, name: str, predicate: Callable[[identity.Member], bool], more: Iterable[IPv4Network] = ()
    ) -> Zone:
        return zone_of(name, (*(IPv4Network(member.address) for member in self._members if predicate(member)), *more))

    def _managers(self) -> Zone:
        return self._zone_of_members(
            "p_all_managers",
            lambda member: _ours(member) and member.kind is identity.MemberKind.LAPTOP,
            self._management(),
        )

    def _management(self) -> tuple[IPv4Network, ...]:
        return tuple(site.management.network for site in self._sites.values())

    def _lans(self) -> tuple[IPv4Network, ...]:
        return tuple(site.lan.network for site in self._sites.values())

    def _in_lan(self, host: Host) -> tuple[IPv4Address, ...]:
        if isinstance(host.device, model.Router):
            return (self._sites[host.site].lan.gateway,)
        return (host.device.address,) if isinstance(host.device, model.LanBox) else ()

    def _vehicles(self, keys: Collection[str]) -> tuple[IPv4Network, ...]:
        """Return the reserved LAN addresses of these vehicles."""
        reservations = (row for site in self._sites.values() for row in site.lan.reservations if row.name in keys)
        return tuple(IPv4Network(row.address) for row in reservations)

    def _speaking(self, name: str, kind: type[model.ControlCentre | model.Gateway]) -> Zone:
        """Return the zone of our DDS computers: in the VPN, and in the LANs if the pilot's DDS uses them."""
        lan = self._pilot.dds is not None and self._pilot.dds.over is model.DdsPath.LAN
        dds_hosts = (host for host in self._hosts.values() if isinstance(host.device, kind))
        return zone_of(name, (IPv4Network(address) for host in dds_hosts for address in _addresses(host, lan=lan)))

    def _serving(self, host: str) -> Zone | None:
        """Return the zone of a computer of ours; None if it is the server itself."""
        if host == self._pilot.vpn.server:
            return None
        addresses = _addresses(self._hosts[host], lan=False)
        return zone_of(f"p_host_{host}", (IPv4Network(address) for address in addresses))


def _ours(member: identity.Member) -> bool:
    """Return True for a computer of the pilot; a robot is a guest, whoever owns it."""
    return member.partner is None and member.kind is not identity.MemberKind.ROBOT


def _dds(dds: model.Dds | None) -> tuple[PolicyTraffic, ...]:
    """Return the unicast ports of all participants; multicast does not pass the tunnel."""
    return () if dds is None else (PolicyTraffic(Protocol.UDP, dds.ports),)


def _addresses(host: Host, *, lan: bool) -> tuple[IPv4Address, ...]:
    """Return the addresses of a host: in the tunnel, if it has one there, then in its LAN."""
    device = host.device
    if isinstance(device, model.Router):
        return () if device.vpn_client is None else (device.vpn_client.address,)
    if not isinstance(device, model.LanBox):
        return ()
    local = () if device.vpn_address is None else (device.vpn_address,)
    return (*local, device.address) if lan else local


TABLE = "p_atlantis_vpn"
"""Name of the nftables table, family inet."""
MEMBERS_SET = "p_members"
"""Firewall set of admitted members: an element that is removed has no traffic from then on."""
_PING = "icmp type { echo-request, echo-reply }"
_ANSWER = "ct state established ct direction reply"


def firewall(inventory: Inventory, membership: identity.MembershipList) -> str:
    """Return the rules for `nft -f`, which loads them atomically; loading is idempotent.

    Established connections are not matched: each packet is checked on its own, and only replies of services are
    recognised by their connection. Therefore traffic that the policy no longer permits is cut as soon as the rules are
    loaded.
    """
    vpn = inventory.pilot.vpn
    ends_s = None if vpn.shared_key_until is None else _end_of_day_s(vpn.shared_key_until)
    return text(policy(inventory, membership), shared_key_ends_s=ends_s, port=vpn.port)


def _end_of_day_s(day: str) -> int:
    """Return the first second after a day (UTC), in seconds since 1970."""
    return int(datetime.combine(date.fromisoformat(day) + timedelta(days=1), time.min, UTC).timestamp())


def text(matrix: Policy, *, shared_key_ends_s: int | None = None, port: int = 1194) -> str:
    """Return the rules of a policy. From `shared_key_ends_s` on (since 1970), the shared key opens no sessions."""
    return (
        environment()
        .get_template("openvpn/vpn.nft.j2")
        .render(
            zones=matrix.zones,
            forward=[line for item in matrix.permissions for line in _forward(item)],
            input=[line for permission in matrix.permissions for line in _input(permission)],
            shared_key_ends_s=shared_key_ends_s,
            port=port,
        )
    )


def _forward(permission: Permission) -> Iterator[str]:
    """Yield rules for traffic that passes the server."""
    if permission.source is None or permission.destination is None:
        return
    source, destination = permission.source.name, permission.destination.name
    yield f"ip saddr @{source} ip daddr @{destination} {_match(permission.traffic)}accept {nft_comment(permission.why)}"
    if permission.traffic.ports is not None:
        answer = f"{permission.traffic.protocol} sport {_ports(permission.traffic.ports)} {_ANSWER}"
        yield f"ip saddr @{destination} ip daddr @{source} {answer} accept {nft_comment('its responses')}"
    elif permission.traffic == ANYTHING and source != destination:
        yield f"ip saddr @{destination} ip daddr @{source} {_ANSWER} accept {nft_comment('its responses')}"


def _input(permission: Permission) -> Iterator[str]:
    """Yield rules for traffic to the server; only ping requests need one, as replies match by connection."""
    if permission.source is not None and permission.destination is None:
        match = (
            "icmp type echo-request " if permission.traffic.protocol is Protocol.ICMP else _match(permission.traffic)
        )
        yield f"ip saddr @{permission.source.name} {match}accept {nft_comment(permission.why)}"


def _match(traffic: PolicyTraffic) -> str:
    """Return the match with a trailing space; empty for all traffic."""
    if traffic.protocol is None:
        return ""
    if traffic.ports is None:
        return f"{_PING} " if traffic.protocol is Protocol.ICMP else f"meta l4proto {traffic.protocol} "
    return f"{traffic.protocol} dport {_ports(traffic.ports)} "


def _ports(ports: range) -> str:
    return str(ports[0]) if len(ports) == 1 else f"{ports[0]}-{ports[-1]}"
