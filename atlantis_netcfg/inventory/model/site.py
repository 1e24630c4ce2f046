"""One site: its address plan, and the links that connect it to the control centre.

`group_vars/<site>.yml`, key `site`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, StrEnum
from math import ceil
from typing import Annotated

from pydantic import Field, StrictBool, StrictFloat, StrictInt

from atlantis_netcfg.core.packets import ECHO_BYTES
from atlantis_netcfg.inventory.model import _base
from atlantis_netcfg.inventory.model.checklist import ChecklistSettings
from atlantis_netcfg.inventory.model.dds import Dds, DdsPath
from atlantis_netcfg.inventory.model.endpoints import Endpoints
from atlantis_netcfg.inventory.model.pilot import ETHERNET, Column
from atlantis_netcfg.inventory.model.qualify import LinkThresholds, ThresholdsName


class TrafficClass(StrEnum):
    """Priority of traffic on a slow link; the order is the order of preference."""

    CONTROL = "control"
    """The tunnel goes first; whatever else the device sends goes last, as from any other device."""
    TELEMETRY = "telemetry"
    IMAGES = "images"
    BULK = "bulk"


class Reservation(_base.Model):
    """A DHCP address that always goes to the same network card."""

    name: _base.Name
    """Of the device that gets it; a host's own name where it is one of the inventory."""
    mac: _base.MacAddress
    """Of its network card."""
    address: _base.Address
    """In the LAN, outside the DHCP range."""
    traffic: TrafficClass = TrafficClass.CONTROL
    """What all that it sends counts as in the queue of a thin link; topics inside a tunnel cannot be told apart."""


class DhcpRange(_base.Model):
    """Addresses that are handed to unknown devices."""

    first: _base.Address
    """Of the range."""
    last: _base.Address
    """Of the range, included."""
    lease_minutes: Annotated[StrictInt, Field(ge=2, le=10080)] = 60
    """How long an address stays with a device that went silent."""


class Lan(_base.Model):
    """The site's local network: robots, gateway, operator stations."""

    network: _base.Network
    """Room for a router, a gateway computer and robots: /29 or larger."""
    gateway: _base.Address
    """The router's own address in it."""
    domain: _base.DnsName
    """DNS suffix of the LAN's names."""
    dhcp: DhcpRange
    reservations: tuple[Reservation, ...] = ()


class Management(_base.Model):
    """The network of the router's management port, where a technician's laptop stands."""

    network: _base.Network
    """Apart from the LAN."""
    technician: _base.Address
    """Address of the laptop on that port."""
    admit: Annotated[tuple[_base.Network, ...], Field(min_length=1)]
    """Prefixes from which the routers' own firewall admits management."""


class LinkKind(StrEnum):
    """What carries a site's traffic to the rest of the world."""

    WIFI_PTP = "wifi_ptp"
    LTE = "lte"
    SATELLITE = "satellite"
    ETHERNET = "ethernet"

    @property
    def traits(self) -> LinkTraits:
        """Properties of links of this kind."""
        return LINK_TRAITS[self]


class Pace(IntEnum):
    """How slow a path over a link may be, for what has to be tuned to it: DDS, the VPN."""

    FAST = 0
    MOBILE = 1
    SATELLITE = 2


@dataclass(frozen=True, slots=True)
class LinkTraits:
    """Properties of a kind of link: all differences between kinds are defined here."""

    column: str
    """Of the checklist, in which a location's link is looked at: of the report's Table 3, or our own `ethernet`."""
    pace: Pace
    thresholds: ThresholdsName
    """What a link of this kind is held against when it is measured."""
    box: str | None = None
    """Kind of device that carries it; None: a plain cable."""
    allow_list: bool = False
    """Only declared targets may pass, each byte is dear, and nothing is pinged beyond it."""
    bridge: bool = False
    """Ends at a served link of another site, whose radio is ours too."""


LINK_TRAITS: dict[LinkKind, LinkTraits] = {
    LinkKind.WIFI_PTP: LinkTraits(Column.WIFI, Pace.FAST, ThresholdsName.WIFI, "cpe", bridge=True),
    LinkKind.LTE: LinkTraits(Column.LTE, Pace.MOBILE, ThresholdsName.LTE, "lte_router"),
    LinkKind.SATELLITE: LinkTraits(
        Column.SATELLITE, Pace.SATELLITE, ThresholdsName.SATELLITE, "satellite_terminal", allow_list=True
    ),
    LinkKind.ETHERNET: LinkTraits(ETHERNET, Pace.FAST, ThresholdsName.WIFI),
}
"""One row a kind: a new one is a name above and its row here."""


class LinkGap(_base.Model):
    """Times in which a link carries nothing, both ways; a rehearsal draws when they come."""

    length_s: Annotated[StrictFloat, Field(gt=0, le=600)]
    """How long each of them lasts, in seconds."""
    per_hour: Annotated[StrictInt, Field(ge=1, le=120)]
    """How many there are in an hour."""


class LinkRate(_base.Model):
    """Performance of a link, for estimates and rehearsals. Jitter, loss and gaps are used only in rehearsals."""

    rtt_ms: Annotated[StrictFloat, Field(gt=0, le=5000)]
    """Round trip to the control centre, in milliseconds."""
    up_kbps: Annotated[StrictFloat, Field(gt=0)]
    """From the site, in kbit/s."""
    down_kbps: Annotated[StrictFloat, Field(gt=0)]
    """To the site, in kbit/s."""
    jitter_ms: Annotated[StrictFloat, Field(ge=0, le=5000)] = 0
    """By how much packets come later than half of the round trip, each way: two of three by less, in milliseconds."""
    loss: Annotated[StrictFloat, Field(ge=0, le=0.5)] = 0
    """Share of the packets that are lost each way, outside of gaps."""
    gaps: tuple[LinkGap, ...] = ()
    """Times in which it carries nothing; all together at most half of an hour in each."""


class Billing(_base.Model):
    """How the provider counts and what it asks, from the contract; a tariff that nobody has looked up is left out."""

    currency: _base.Currency = "EUR"
    """ISO 4217."""
    price_per_mb: Annotated[StrictFloat, Field(ge=0)]
    """For 10^6 bytes, both directions counted together."""
    min_session_bytes: Annotated[StrictInt, Field(ge=0)] = 0
    """What the shortest session is billed as."""
    floor_bytes_per_s: Annotated[StrictInt, Field(ge=0)] = 0
    """A long session is billed as so many bytes for each second, if that is more than what it carried."""
    floor_after_s: Annotated[StrictInt, Field(ge=0)] = 0
    """Length of a session from which that floor holds."""


LONGEST_PAUSE_S = 600
"""Between two questions to a canary; more seldom asked, a dead link would carry the traffic for too long."""


class Failover(_base.Model):
    """When traffic leaves a link of the site, and when it comes back."""

    hold_down_s: Annotated[StrictInt, Field(ge=20, le=600)] = 20
    """A link whose canaries have all been silent for so long is left for the next one, in seconds."""
    fail_back_s: Annotated[StrictInt, Field(ge=0, le=3600)] = 120
    """A better link is taken again when its canaries have answered for so long without a break, in seconds."""
    metered_probe_s: Annotated[StrictInt, Field(ge=10, le=LONGEST_PAUSE_S)] = 30
    """How often each canary of a link that costs by the byte is asked while all is well, in seconds; others: 5 s."""


class AllowedTarget(_base.Model):
    """A destination that may be reached over the satellite, besides the VPN and the time servers."""

    name: _base.Text
    """What it is for."""
    address: _base.Address
    """One host; a network cannot be admitted."""
    dns_name: _base.DnsName | None = None
    """The name behind the address, where there is one: that both still agree is checked, because names move."""
    port: Annotated[StrictInt, Field(ge=1, le=65535)] | None = None
    """None admits every port; with a port, `transport` says of which protocol."""
    transport: _base.Transport = _base.Transport.UDP
    """The protocol of `port`."""


_THIN_KBPS = 2000.0
_MONTH_S = 30 * 24 * 3600


class Link(_base.Model):
    """A long-haul link of the site. The order of the list is the order of preference."""

    name: _base.Name
    """What the link is called in plans and in `via=`."""
    kind: LinkKind
    """What carries it."""
    device: _base.HostName | None = None
    """The box at this end: CPE, 4G router or satellite terminal; none for a plain cable."""
    metered: StrictBool
    """True if every byte costs."""
    billing: Billing | None = None
    """Metered links only; None: nobody has looked up the tariff, so that costs are told in bytes."""
    cap_mb: Annotated[StrictFloat, Field(gt=0)] = 5.0
    """Metered links only: no single action sends more than this, in 10^6 bytes, whatever a person accepts."""
    standing_budget_mb: Annotated[StrictFloat, Field(gt=0)] | None = None
    """Metered links only: what may go over it in a month by itself, in 10^6 bytes; more is a warning."""
    standing_budget_eur: Annotated[StrictFloat, Field(gt=0)] | None = None
    """Metered links with a tariff in EUR only: the same as money."""
    dds: StrictBool | None = None
    """Whether DDS of the gateways crosses the link; null: only where `metered` is false."""
    network: _base.Network
    """Between the router and the next hop."""
    address: _base.Address
    """The router's own address in `network`."""
    gateway: _base.Address
    """The next hop."""
    canaries: tuple[_base.Address, ...] = ()
    """Two addresses beyond the link, pinged over it and used for nothing else; none: the link is not probed."""
    canary_budget_mb: Annotated[StrictFloat, Field(gt=0)] | None = None
    """Metered links only, a must for a satellite's canaries: what they may take in a month, in 10^6 bytes."""
    canary_budget_eur: Annotated[StrictFloat, Field(gt=0)] | None = None
    """Metered links with a tariff in EUR only: the same as money."""
    rate: LinkRate
    qualify: LinkThresholds = LinkThresholds()
    allow: tuple[AllowedTarget, ...] = ()
    """Satellite only: what may pass besides the VPN and the time servers. All else is dropped at the router."""
    refused_probes: tuple[AllowedTarget, ...] = ()
    """Satellite only: targets of our own outside the allow-list, to prove that they cannot be reached."""

    def carries(self, dds: Dds) -> bool:
        """Return whether DDS may use the link; by LAN addresses it always may, through the router's own tunnel."""
        return dds.over is DdsPath.LAN or (not self.metered if self.dds is None else self.dds)

    @property
    def has_standing_budget(self) -> bool:
        """Whether the inventory has a budget for standing traffic, which runs without a person's request."""
        return self.standing_budget_mb is not None or self.standing_budget_eur is not None

    @property
    def probe_target_budget_bytes(self) -> float | None:
        """Budget of the link's probes in bytes per 30 days, responses included; None: no limit."""
        most = [] if self.canary_budget_mb is None else [self.canary_budget_mb * 1e6]
        if self.canary_budget_eur is not None and self.billing is not None and self.billing.price_per_mb:
            most.append(self.canary_budget_eur / self.billing.price_per_mb * 1e6)
        return min(most, default=None)

    @property
    def probe_target_pause_s(self) -> int:
        """Least seconds between two probes of a probe target, by the budget; 0 without a budget."""
        budget = self.probe_target_budget_bytes
        return 0 if budget is None else ceil(_MONTH_S * len(self.canaries) * 2 * ECHO_BYTES / budget)

    @property
    def thin(self) -> bool:
        """Whether the link needs a queue: a satellite, or less than 2 Mbit/s from the site."""
        return self.kind.traits.allow_list or self.rate.up_kbps < _THIN_KBPS


class ServedLink(_base.Model):
    """A link that ends here and carries another site: the SCC's end of the Wi-Fi bridge."""

    name: _base.Name
    """What the link is called here."""
    device: _base.HostName
    """The CPE at this end."""
    network: _base.Network
    """The same as at the other end."""
    address: _base.Address
    """The router's own address in `network`."""
    carries: _base.Name
    """The site at the other end."""


class LocationRow(_base.Model):
    """The location's own row of the checklist; the report's location rows are lost, so it starts empty."""

    table3: tuple[Column, ...] = ()
    """Columns of Table 3 in which the location has a link or a modem of its own."""
    ethernet: StrictBool = False
    """Our extension, not part of Table 3."""
    endpoints: Endpoints = Endpoints()
    """How the pre-test checklist looks at each; the bearers speak for satellite, 4G and the Wi-Fi bridge."""


class Site(_base.Model):
    """A place of the pilot."""

    title: _base.Text
    """What people call the place."""
    lan: Lan
    management: Management
    bearers: Annotated[tuple[Link, ...], Field(min_length=1)]
    served_links: tuple[ServedLink, ...] = ()
    failover: Failover = Failover()
    location: LocationRow = LocationRow()
    checklist: ChecklistSettings = ChecklistSettings()
