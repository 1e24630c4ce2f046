"""Template data of a router: prepared text and numbers, so that the template reads like an export.

Also here: the part of the inventory that a router's text depends on, and the error raised when something is missing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from atlantis_netcfg.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.inventory import model


BRIDGE = "bridge-lan"
DOWN_OFFSET = 100
"""Added to the distance of routes by a link that was given up."""


@dataclass(frozen=True, slots=True)
class Prerequisite:
    """Something that must exist on the device before the desired text is applied, as the text refers to it."""

    menu: str
    """In the form of the API, like `/certificate`."""
    name: str
    """The row's `name`; of `/interface/ethernet` its `default-name`."""
    reason: str
    """What refers to it, for the sentence that says it is missing."""


@dataclass(frozen=True, slots=True)
class NamedAddress:
    """A name for an address: DHCP reservation, DNS entry, time server."""

    name: str
    address: str
    mac: str | None = None


@dataclass(frozen=True, slots=True)
class PortView:
    """One Ethernet port; `purpose` is `lan`, `management`, `off` or the name of the link on it."""

    name: str
    purpose: str
    is_disabled: bool
    poe_out: str | None
    poe_priority: int | None


@dataclass(frozen=True, slots=True)
class LanView:
    """The bridged ports and what is served on them."""

    address: str
    """The router's own, with prefix length."""
    network: str
    gateway: str
    domain: str
    hosts: tuple[NamedAddress, ...]
    """The declared computers in it; whatever else is plugged in may be a partner's."""
    ports: tuple[str, ...]
    pool: str
    """First and last address, like 10.64.1.100-10.64.1.199."""
    lease_time_s: int
    reservations: tuple[NamedAddress, ...]


@dataclass(frozen=True, slots=True)
class ManagementView:
    """The technician's port, and who else may manage the router."""

    port: str
    address: str
    """The router's own, with prefix length."""
    network: str
    admit: tuple[str, ...]
    api_port: int
    certificate: str


@dataclass(frozen=True, slots=True)
class Managers:
    """A network whose hosts may manage the router, and the interface list that it comes in by."""

    way: str
    """In the words of the rule's comment; empty at the technician's port."""
    interfaces: str
    network: str


@dataclass(frozen=True, slots=True)
class LinkView:
    """A port with one of our addresses that leads out of the site."""

    name: str
    port: str
    address: str
    interface_address: str
    """`address` with prefix length."""
    network: str


@dataclass(frozen=True, slots=True)
class PingTarget:
    """A destination that is allowed over the satellite; `port` and `transport` are both set or both None."""

    name: str
    address: str
    port: int | None
    transport: str | None


@dataclass(frozen=True, slots=True)
class JudgedBearer:
    """How a link with probe targets is monitored, and when it is left and used again; times in seconds."""

    has_gateway_check: bool
    """It costs nothing to ask: `check-gateway` watches too, and a route without it holds the link meanwhile."""
    watch_s: float
    """Between two questions to a canary while it answers."""
    timeout_s: float
    silence: int
    """So many packets in a row unanswered are the declared silence."""
    silence_gap_s: float
    steady: int
    """So many packets in a row answered are the declared time without a break."""
    steady_gap_s: float
    daily_bytes: int
    """What both canaries cost a day while all is well, answers included."""
    unsteady_bytes: int | None
    """At most, on a day on which the link comes and goes all the time; None: its canaries have no budget."""


@dataclass(frozen=True, slots=True)
class Uplink(LinkView):
    """A link. `place` is its position in the order of preference, from 1."""

    gateway: str
    kind: model.BearerKind
    place: int
    canaries: tuple[str, ...]
    targets: tuple[PingTarget, ...]
    probing: JudgedBearer | None
    """None: it is not left for another one while its port has a link, be it unprobed or the last."""
    later: tuple[str, ...]
    """The router's own addresses on the links that come after this one."""
    up_bps: int
    """From the site."""
    thin: bool
    """So slow that control has to go first."""
    dds: bool
    """Whether DDS may cross it; where not, the router tells the gateway so."""

    @property
    def distance(self) -> int:
        """Distance of its default routes while it works; steps of ten leave room for `holding_distance`."""
        return 10 * self.place

    @property
    def holding_distance(self) -> int:
        """Distance of the default route that keeps the link in use until it has been silent long enough."""
        return self.distance + 1

    @property
    def down_distance(self) -> int:
        """Distance of its default routes while it is down: behind every working link, but better than no route."""
        return self.distance + DOWN_OFFSET

    @property
    def holding_down_distance(self) -> int:
        """Distance of the holding route while the link is down."""
        return self.holding_distance + DOWN_OFFSET

    @property
    def shaped_bps(self) -> int:
        """Shaping rate: four fifths of the rate from the site, so that the queue is here and not in the terminal."""
        return self.up_bps * 4 // 5

    @property
    def table(self) -> str:
        """Name of the routing table that contains only this link."""
        return f"via-{self.name}"

    @property
    def chain(self) -> str:
        """Name of the firewall chain for traffic that leaves over this link."""
        return f"to-{self.name}"

    @property
    def chain_in(self) -> str:
        """Name of the firewall chain for traffic that came in by this link."""
        return f"from-{self.name}"


@dataclass(frozen=True, slots=True)
class ClassView:
    """A traffic class below control, and the LAN hosts assigned to it."""

    name: str
    priority: int
    """Of its queue, after control (1) and before the rest (8)."""
    share: int
    """One of so many parts of the link is its own, whatever the others send; all queues together have less than all."""
    hosts: tuple[NamedAddress, ...]


@dataclass(frozen=True, slots=True)
class TunnelView:
    """The router's own end of the VPN."""

    interface: str
    connect_to: str
    endpoint: str
    port: int
    transport: str
    cipher: str
    certificate: str
    user: str
    password: Secret


@dataclass(frozen=True, slots=True)
class Remote:
    """A network behind the VPN; `gateway` is the tunnel interface, or the VPN server if it is in the LAN."""

    name: str
    network: str
    gateway: str


@dataclass(frozen=True, slots=True)
class PortForward:
    """A port of each of our outer addresses, forwarded to a LAN host."""

    name: str
    transport: str
    port: int
    to: str


@dataclass(frozen=True, slots=True)
class RadioView:
    """One radio, in the terms of its family of menus."""

    name: str
    """Factory name."""
    family: str
    """`wireless` or `wifi`."""
    is_ap: bool
    ssid: str
    protocol: str
    """RouterOS' word for `wireless-protocol`."""
    band: str
    frequency_mhz: int
    width: str
    country: str
    installation: str
    skip_dfs: str
    """Which channels an access point keeps off when it has to choose another one."""
    key: Secret
    authentication: str
    tx_power_dbm: int | None
    antenna_gain_dbi: int | None
    cell_radius_km: int = 10
    """Of nv2; below 10 km RouterOS refuses it (Manual, Nv2)."""
    distance_km: int | None = None
    """Only where the distance needs it."""
    is_isolated: bool = False
    """Stations do not reach one another through it."""

    @property
    def is_nv2(self) -> bool:
        """True if the key is nv2's own; the security profile is for 802.11."""
        return self.protocol == "nv2"


@dataclass(frozen=True, slots=True)
class RouterView:
    """Template data for one router."""

    name: str
    title: str
    time_zone: str
    time_servers: tuple[NamedAddress, ...]
    bridge: str
    ports: tuple[PortView, ...]
    lan: LanView
    management: ManagementView
    managers: tuple[Managers, ...]
    uplinks: tuple[Uplink, ...]
    classes: tuple[ClassView, ...]
    """Those that a reservation is given; control and the rest are always there."""
    served_links: tuple[LinkView, ...]
    tunnel: TunnelView | None
    server_in_lan: bool
    """The VPN server is a host of this LAN, so traffic to other sites enters and leaves by the same bridge."""
    remotes: tuple[Remote, ...]
    vpn_network: str
    """Tunnel addresses."""
    dds_ports: str | None
    """Unicast ports of the pilot's DDS, like 7410-7429."""
    names: tuple[NamedAddress, ...]
    forwards: tuple[PortForward, ...]
    access_point: RadioView | None = None
    """Its own radio, where vehicles join it."""
    switches: tuple[NamedAddress, ...] = ()
    """Of the LAN: who manages them by way of this router has its address there."""

    @property
    def satellites(self) -> tuple[Uplink, ...]:
        """The links with an allow-list."""
        return tuple(uplink for uplink in self.uplinks if uplink.kind.traits.allow_list)

    @property
    def probed_uplinks(self) -> tuple[Uplink, ...]:
        """The links that are monitored, and left for another one when they fail."""
        return tuple(uplink for uplink in self.uplinks if uplink.probing is not None)

    @property
    def thin(self) -> tuple[Uplink, ...]:
        """The slow links, on which control traffic has priority."""
        return tuple(uplink for uplink in self.uplinks if uplink.thin)

    @property
    def allow_list(self) -> tuple[NamedAddress, ...]:
        """Targets of the satellite links, each address once, as RouterOS refuses duplicates in a list."""
        names: dict[str, list[str]] = {}
        for target in (target for satellite in self.satellites for target in satellite.targets):
            names.setdefault(target.address, []).append(target.name)
        return tuple(
            NamedAddress(", ".join(dict.fromkeys(target_names)), address) for address, target_names in names.items()
        )

    @property
    def radios(self) -> tuple[Uplink, ...]:
        """The links whose far end is one of our routers."""
        return tuple(uplink for uplink in self.uplinks if uplink.kind.traits.bridge)


class RenderError(UsageError):
    """The inventory lacks what the template needs; `provision validate` reports it with file and line."""


class DeclaredHost(Protocol):
    """A host of the inventory."""

    @property
    def name(self) -> str:
        """Name in the inventory."""

    @property
    def site(self) -> str:
        """Key of the site in `sites`."""

    @property
    def device(self) -> model.Device:
        """The device model of the host."""


class InventoryView(Protocol):
    """The part of the inventory that rendering reads."""

    @property
    def pilot(self) -> model.Pilot:
        """Settings shared by all sites."""

    @property
    def sites(self) -> Mapping[str, model.Site]:
        """Sites by name."""

    @property
    def hosts(self) -> Mapping[str, DeclaredHost]:
        """Hosts by name."""


def router_of(host: DeclaredHost) -> model.Router:
    """Return the router of a host. Raises RenderError if it is another device."""
    if host.device.kind != "router":
        raise RenderError(f"{host.name} is a {host.device.kind}, and only a router has a router's configuration")
    return host.device


def hosts_of(declaration: InventoryView, site: str) -> tuple[DeclaredHost, ...]:
    """Return the hosts of a site by name, so that the text does not depend on the order of files."""
    return tuple(host for _, host in sorted(declaration.hosts.items()) if host.site == site)


def address_in_site(device: model.Device, site: model.Site) -> str:
    """Return the device's address within its site."""
    if device.kind == "router":
        return str(site.lan.gateway)
    if device.kind == "switch":
        return str(device.access.address)
    return str(device.access.address if device.kind == "cpe" else device.address)
