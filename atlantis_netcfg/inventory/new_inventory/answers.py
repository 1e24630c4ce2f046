"""Input of `provision inventory init`, from a file (`--answers`) or from questions; the rest is derived.

Without an answer a feature is left out, or gets an example value, marked `# EXAMPLE`: nothing is invented.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import AfterValidator, Field, StrictBool, StrictFloat, StrictInt, model_validator

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.inventory.findings import why_no_name
from atlantis_netcfg.inventory.model._base import Model, wrong
from atlantis_netcfg.inventory.model.computer import SshKey

if TYPE_CHECKING:
    from collections.abc import Callable
    from ipaddress import IPv4Network


def _room(longest: int) -> Callable[[IPv4Network], IPv4Network]:
    """Return a validator that requires a network of at least that size, for derived addresses."""

    def check(network: IPv4Network) -> IPv4Network:
        if network.prefixlen > longest:
            raise wrong(msg(f"{arg(network)} is too small here"), msg(f"use a network of /{arg(longest)} or larger"))
        return network

    return check


LocalNetwork = Annotated[model.Network, AfterValidator(_room(26))]
LinkNetwork = Annotated[model.Network, AfterValidator(_room(29))]
VpnNetwork = Annotated[model.Network, AfterValidator(_room(20))]
MOST_SITES = 80
"""Maximum number of sites; each uses addresses of the infrastructure pool."""
MOST_PARTNERS = 15
"""Maximum number of partners: a VPN network of /20 has 16 pools, one of them for infrastructure."""
PARTNERS = {
    "inesc": "INESC TEC",
    "iqua": "IQUA Robotics",
    "eca": "ECA",
    "udg": "Universitat de Girona",
    "vtt": "VTT",
    "spaceapps": "SPACEAPPS",
}
"""Organisations of the report, in its order."""
Ports = Annotated[StrictInt, Field(ge=4, le=48)]


def partner_row(text: str) -> tuple[str, str]:
    """Return the short and the full name of a partner; of the report's, either name is enough."""
    near = (why_no_name(text.lower()) or ("", text.lower()))[1]
    for short_name, full_name in PARTNERS.items():
        if text.lower() in {short_name, full_name.lower()}:
            return short_name, full_name
    return near, text


def _distinct(partners: tuple[str, ...]) -> tuple[str, ...]:
    names = [partner_row(text)[0] for text in partners]
    for text, name in zip(partners, names, strict=True):
        if why_no_name(name) is not None:
            raise wrong(msg(f"no partner can be named `{arg(text)}`"), "a name has letters or digits")
        if names.count(name) > 1:
            raise wrong(msg(f"two partners have the name `{arg(name)}`"), "name each partner once")
    return partners


class CableAnswers(Model):
    """A plain cable to a provider."""

    network: model.Network | None = None
    """Network between the router and the provider's device; None: not answered."""
    address: model.Address | None = None
    """Address of the router in that network."""
    gateway: model.Address | None = None
    """Address of the provider's device."""
    canaries: tuple[model.Address, ...] = ()
    """Two probe targets beyond the link that may be pinged."""
    rate: model.LinkRate | None = None
    """Round trip in ms, up and down in kbit/s."""


class BridgeAnswers(Model):
    """The directional Wi-Fi bridge to the control centre."""

    network: LinkNetwork | None = None
    """Network of the bridge, for both ends."""
    ssid: model.Ssid | None = None
    """Name of the radio network."""
    protocol: Literal["nv2", "802.11"] = "nv2"
    """Radio protocol; `wifi` menus support only 802.11."""
    frequency_mhz: StrictInt | None = None
    """Centre frequency of a 5 GHz channel allowed in the country."""
    distance_m: Annotated[StrictInt, Field(ge=1, le=50_000)] | None = None
    """Distance between the ends."""
    antenna_gain_dbi: Annotated[StrictInt, Field(ge=0, le=30)] | None = None
    """Antenna gain, from the data sheet."""
    tx_power_dbm: Annotated[StrictInt, Field(ge=0, le=40)] | None = None
    """Transmit power at the antenna connector."""
    canaries: tuple[model.Address, ...] = ()
    """Two probe targets beyond the link that may be pinged."""
    rate: model.LinkRate | None = None
    """Round trip in ms, up and down in kbit/s."""


class LteAnswers(Model):
    """The 4G unit and its SIM."""

    network: LinkNetwork | None = None
    """Network between the router and the unit."""
    driver: model.LteDriver = model.LteDriver.MANUAL
    """Driver that configures the unit."""
    apn: model.Text | None = None
    """APN from the SIM's contract; None: the network's default."""
    price_per_mb: Annotated[StrictFloat, Field(ge=0)] | None = None
    """In EUR for 10^6 bytes, from the contract; None: costs are shown in bytes."""
    canaries: tuple[model.Address, ...] = ()
    """Two probe targets beyond the link that may be pinged."""
    rate: model.LinkRate | None = None
    """Round trip in ms, up and down in kbit/s."""


class SatelliteAnswers(Model):
    """The satellite terminal."""

    network: LinkNetwork | None = None
    """Network between the router and the terminal."""
    price_per_mb: Annotated[StrictFloat, Field(ge=0)] | None = None
    """In EUR for 10^6 bytes, from the contract; None: costs are shown in bytes."""


class GatewayAnswers(Model):
    """The data gateway computer of a site."""

    ssh_key: SshKey | None = None
    """Line of a technician's .pub file; None: no card is made."""
    layout: model.ImageLayout = model.ImageLayout.ODROID_N2
    """Layout of the vendor's image; the report's computer is an ODROID N2."""


class SiteAnswers(Model):
    """A test site."""

    title: model.Text | None = None
    """Display name of the place; None: its short name."""
    lan: LocalNetwork | None = None
    management: LocalNetwork | None = None
    """Network of the router's management port, for a technician's laptop."""
    domain: model.DnsName | None = None
    """DNS suffix of the local network."""
    router_ports: Ports | None = None
    """Number of the router's Ethernet ports."""
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
    """Display name of the place; None: its short name."""
    lan: LocalNetwork | None = None
    management: LocalNetwork | None = None
    """Network of the router's management port, for a technician's laptop."""
    domain: model.DnsName | None = None
    """DNS suffix of the local network."""
    router_ports: Ports | None = None
    """Number of the router's Ethernet ports."""
    uplink: CableAnswers = CableAnswers()
    computer: StrictBool = True
    """Whether a computer runs the services of the control centre."""


class VpnAnswers(Model):
    """The OpenVPN that joins sites, robots and partners."""

    endpoint: model.Address | None = None
    """Public address of the server, reachable from every site."""
    endpoint_name: model.DnsName | None = None
    """DNS name in the server's certificate."""
    network: VpnNetwork | None = None
    """All tunnel addresses."""


class PilotAnswers(Model):
    """What holds for every site."""

    name: model.Text
    """Display name of the pilot."""
    country: model.Country
    """Regulatory domain of the radios; `later` allows rehearsals only."""
    time_zone: model.Text | None = None
    """Name from the IANA database; None: the country's time zone."""
    time_servers: tuple[model.Address, ...] = ()
    """Addresses of time servers reachable from every site."""
    ros_distribution: model.RosDistribution | None = None
    """Release of ROS 2 on the gateways; None: neither ROS nor DDS is set up."""
    partners: Annotated[tuple[model.Text, ...], Field(max_length=MOST_PARTNERS), AfterValidator(_distinct)] = ()
    """Organisations that join through the VPN: short names of the report's, or names of others."""


class InventoryAnswers(Model):
    """All answers; sites by their short names."""

    pilot: PilotAnswers
    vpn: VpnAnswers = VpnAnswers()
    control_centre: CentreAnswers = CentreAnswers()
    sites: Annotated[dict[model.Name, SiteAnswers], Field(min_length=1, max_length=MOST_SITES)]

    @model_validator(mode="after")
    def _check_names(self) -> Self:
        if self.control_centre.name in self.sites:
            message = msg(f"`{arg(self.control_centre.name)}` is the name of both the control centre and a site")
            raise wrong(message, "give one of them another name")
        return self
