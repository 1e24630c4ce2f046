"""Template data of a router: prepared text and numbers, so that the template reads like an export.

Also here: the part of the inventory that a router's text depends on, and the error raised when something is missing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg, join

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.inventory import model


BRIDGE = "bridge-lan"
DOWN_OFFSET = 100
"""Added to the distance of the routes of a failed link."""


@dataclass(frozen=True, slots=True)
class Prerequisite:
    """Something that must exist on the device before the desired text is applied, as the text refers to it."""

    menu: str
    """Menu as API path, like `/certificate`."""
    name: str
    """`name` of the row; for `/interface/ethernet` its `default-name`."""
    reason: str
    """What refers to it, for the error message when it is missing."""


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
    """The router's address, with prefix length."""
    network: str
    gateway: str
    domain: str
    hosts: tuple[NamedAddress, ...]
    """Declared computers in this LAN; any other device may be a partner's."""
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
    """The router's address, with prefix length."""
    network: str
    admit: tuple[str, ...]
    api_port: int
    certificate: str


@dataclass(frozen=True, slots=True)
class Managers:
    """A network whose hosts may manage the router, and the interface list that it comes in by."""

    way: str
    """Description of the route in the rule's comment; empty at the technician's port."""
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
class JudgedLink:
    """How a link with probe targets is monitored, and when it is left and used again; times in seconds."""

    has_gateway_check: bool
    """Probing is free: `check-gateway` also monitors, and a route without it holds the link meanwhile."""
    watch_s: float
    """Seconds between two requests to a probe target while it responds."""
    timeout_s: float
    silence: int
    """Consecutive unanswered packets that amount to the declared silence."""
    silence_gap_s: float
    steady: int
    """Consecutive answered packets that amount to the declared time without interruption."""
    steady_gap_s: float
    daily_bytes: int
    """Bytes per day of both probe targets in normal operation, replies included."""
    unsteady_bytes: int | None
    """Maximum bytes on a day with constant interruptions; None: its probe targets have no budget."""


@dataclass(frozen=True, slots=True)
class Uplink(LinkView):
    """A link. `place` is its position in the order of preference, from 1."""

    gateway: str
    kind: model.LinkKind
    place: int
    probe_targets: tuple[str, ...]
    targets: tuple[PingTarget, ...]
    probing: JudgedLink | None
    """None: unprobed or last, so it is kept while its port has a link."""
    later: tuple[str, ...]
    """The router's own addresses on the links after this one."""
    up_bps: int
    """Rate from the site in bits per second."""
    thin: bool
    """So slow that control must be sent first."""
    dds: bool
    """Whether DDS may use the link; if not, the router reports that to the gateway."""

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
    """Priority of its queue, after control (1) and before the rest (8)."""
    share: int
    """Guaranteed share: one part of this many of the link; all queues together are guaranteed less than all."""
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
    """Factory name of the radio."""
    family: str
    """`wireless` or `wifi`."""
    is_ap: bool
    ssid: str
    protocol: str
    """Value of `wireless-protocol` in RouterOS."""
    band: str
    frequency_mhz: int
    width: str
    country: str
    installation: str
    skip_dfs: str
    """Channels that an access point avoids when it must choose a different one."""
    key: Secret
    authentication: str
    tx_power_dbm: int | None
    antenna_gain_dbi: int | None
    cell_radius_km: int = 10
    """Cell radius of nv2; below 10 km RouterOS refuses it (Manual, Nv2)."""
    distance_km: int | None = None
    """Distance in km; None: the distance needs no setting."""
    is_isolated: bool = False
    """Stations cannot reach each other through the radio."""

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
    """Classes with a reservation; control and the rest always exist."""
    served_links: tuple[LinkView, ...]
    tunnel: TunnelView | None
    server_in_lan: bool
    """The VPN server is a host of this LAN, so traffic to other sites enters and leaves by the same bridge."""
    remotes: tuple[Remote, ...]
    vpn_network: str
    """Network of the tunnel addresses."""
    dds_ports: str | None
    """Unicast ports of the pilot's DDS, like 7410-7429."""
    names: tuple[NamedAddress, ...]
    forwards: tuple[PortForward, ...]
    access_point: RadioView | None = None
    """The router's radio, which vehicles join; None: no radio."""
    switches: tuple[NamedAddress, ...] = ()
    """Switches of the LAN; managers reach them through this router and appear there with its address."""

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
            NamedAddress(join(", ", dict.fromkeys(target_names)), address) for address, target_names in names.items()
        )

    @property
    def radios(self) -> tuple[Uplink, ...]:
        """The links whose far end is one of our routers."""
        return tuple(uplink for uplink in self.uplinks if uplink.kind.traits.bridge)


class RenderError(UsageError):
    """The inventory lacks what the template needs; `provision inventory validate` reports it with file and line."""


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
        raise RenderError(
            f"{arg(host.name)} is a {arg(host.device.kind)}; only a router can have a router configuration"
        )
    return host.device


def hosts_of(inventory: InventoryView, site: str) -> tuple[DeclaredHost, ...]:
    """Return the hosts of a site by name, so that the text does not depend on the order of files."""
    return tuple(host for _, host in sorted(inventory.hosts.items()) if host.site == site)


def address_in_site(device: model.Device, site: model.Site) -> str:
    """Return the device's address within its site."""
    if device.kind == "router":
        return str(site.lan.gateway)
    if device.kind == "switch":
        return str(device.access.address)
    return str(device.access.address if device.kind == "cpe" else device.address)
