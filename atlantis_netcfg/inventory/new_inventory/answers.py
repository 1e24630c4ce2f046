"""Input of `provision init`, from a file (`--answers`) or from questions; the rest is derived.

Without an answer a feature is left out, or gets an example value, marked `# EXAMPLE`: nothing is invented.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import AfterValidator, Field, StrictBool, StrictFloat, StrictInt, model_validator

from atlantis_netcfg.inventory import model
from atlantis_netcfg.inventory.model._base import Model, wrong
from atlantis_netcfg.inventory.model.computer import SshKey

if TYPE_CHECKING:
    from collections.abc import Callable
    from ipaddress import IPv4Network


def _room(longest: int) -> Callable[[IPv4Network], IPv4Network]:
    """Return a validator that requires a network of at least that size, for derived addresses."""

    def check(network: IPv4Network) -> IPv4Network:
        if network.prefixlen > longest:
            raise wrong(f"{network} is too small here", f"a network of /{longest} or larger")
        return network

    return check


LocalNetwork = Annotated[model.Network, AfterValidator(_room(26))]
LinkNetwork = Annotated[model.Network, AfterValidator(_room(29))]
VpnNetwork = Annotated[model.Network, AfterValidator(_room(20))]
MOST_SITES = 80
"""Each has its addresses in the infrastructure's pool."""
Ports = Annotated[StrictInt, Field(ge=4, le=48)]


class CableAnswers(Model):
    """A plain cable to a provider."""

    network: model.Network | None = None
    """Between the router and the provider's box."""
    address: model.Address | None = None
    """The router's own address in it."""
    gateway: model.Address | None = None
    """The provider's box."""
    canaries: tuple[model.Address, ...] = ()
    """Two addresses beyond the link that may be pinged."""
    rate: model.LinkRate | None = None
    """Round trip in ms, up and down in kbit/s."""


class BridgeAnswers(Model):
    """The directional Wi-Fi bridge to the control centre."""

    network: LinkNetwork | None = None
    """Of the bridge, both ends."""
    ssid: model.Ssid | None = None
    """Name of the radio network."""
    protocol: Literal["nv2", "802.11"] = "nv2"
    """What the radios speak; `wifi` menus know 802.11 only."""
    frequency_mhz: StrictInt | None = None
    """Centre of a 5 GHz channel that the country allows."""
    distance_m: Annotated[StrictInt, Field(ge=1, le=50_000)] | None = None
    """Between the ends."""
    antenna_gain_dbi: Annotated[StrictInt, Field(ge=0, le=30)] | None = None
    """Of the antennas, from their data sheet."""
    tx_power_dbm: Annotated[StrictInt, Field(ge=0, le=40)] | None = None
    """At the antenna's socket."""
    canaries: tuple[model.Address, ...] = ()
    """Two addresses beyond the link that may be pinged."""
    rate: model.LinkRate | None = None
    """Round trip in ms, up and down in kbit/s."""


class LteAnswers(Model):
    """The 4G unit and its SIM."""

    network: LinkNetwork | None = None
    """Between the router and the unit."""
    driver: model.LteDriver = model.LteDriver.MANUAL
    """How the unit is spoken to."""
    apn: model.Text | None = None
    """From the SIM's contract; none: the network's own."""
    price_per_mb: Annotated[StrictFloat, Field(ge=0)] | None = None
    """In EUR for 10^6 bytes, from the contract; none: costs are told in bytes."""
    canaries: tuple[model.Address, ...] = ()
    """Two addresses beyond the link that may be pinged."""
    rate: model.LinkRate | None = None
    """Round trip in ms, up and down in kbit/s."""


class SatelliteAnswers(Model):
    """The satellite terminal."""

    network: LinkNetwork | None = None
    """Between the router and the terminal."""
    price_per_mb: Annotated[StrictFloat, Field(ge=0)] | None = None
    """In EUR for 10^6 bytes, from the contract; none: costs are told in bytes."""


class GatewayAnswers(Model):
    """The data gateway computer of a site."""

    ssh_key: SshKey | None = None
    """The line of a technician's .pub file; none: no card is made."""
    layout: model.ImageLayout = model.ImageLayout.ODROID_N2
    """Of the vendor's image; the report's computer is an ODROID N2."""


class SiteAnswers(Model):
    """A test site."""

    title: model.Text | None = None
    """What people call the place; none: its name."""
    lan: LocalNetwork | None = None
    """The local network."""
    management: LocalNetwork | None = None
    """The network of the router's management port, where a technician's laptop stands."""
    domain: model.DnsName | None = None
    """DNS suffix of the local network."""
    router_ports: Ports | None = None
    """How many Ethernet ports the router has."""
    wifi_bridge: BridgeAnswers | None = None
    cable: CableAnswers | None = None
    lte: LteAnswers | None = None
    satellite: SatelliteAnswers | None = None
    gateway: GatewayAnswers | None = None


class CentreAnswers(Model):
    """The far end of all links, where the VPN's server stands."""

    name: model.Name = "scc"
    """Short name of the place."""
    title: model.Text | None = None
    """What people call the place; none: its name."""
    lan: LocalNetwork | None = None
    """The local network."""
    management: LocalNetwork | None = None
    """The network of the router's management port, where a technician's laptop stands."""
    domain: model.DnsName | None = None
    """DNS suffix of the local network."""
    router_ports: Ports | None = None
    """How many Ethernet ports the router has."""
    uplink: CableAnswers = CableAnswers()
    computer: StrictBool = True
    """Whether a computer runs the control centre's services."""


class VpnAnswers(Model):
    """The OpenVPN that joins sites, robots and partners."""

    endpoint: model.Address | None = None
    """Public address at which every site reaches the server."""
    endpoint_name: model.DnsName | None = None
    """DNS name in the server's certificate."""
    network: VpnNetwork | None = None
    """All tunnel addresses."""


class PilotAnswers(Model):
    """What holds for every site."""

    name: model.Text
    """What the pilot is called."""
    country: Literal["portugal", "belgium"]
    """Regulatory domain of the radios."""
    time_zone: model.Text | None = None
    """Of the IANA database; none: the country's."""
    time_servers: tuple[model.Address, ...] = ()
    """Addresses of time servers that every site reaches."""
    ros_distribution: model.RosDistribution | None = None
    """Release of ROS 2 on the gateways; none: neither ROS nor DDS is set up."""
    partners: tuple[Literal["inesc", "iqua", "eca", "udg", "vtt"], ...] = ()
    """Organisations of the report that join through the VPN."""


class InventoryAnswers(Model):
    """All answers; sites by their short names."""

    pilot: PilotAnswers
    vpn: VpnAnswers = VpnAnswers()
    control_centre: CentreAnswers = CentreAnswers()
    sites: Annotated[dict[model.Name, SiteAnswers], Field(min_length=1, max_length=MOST_SITES)]

    @model_validator(mode="after")
    def _names(self) -> Self:
        if self.control_centre.name in self.sites:
            message = f"`{self.control_centre.name}` is the name of the control centre and of a site"
            raise wrong(message, "give one of them another name")
        return self
