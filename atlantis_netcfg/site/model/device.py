"""The boxes of a site, told apart by `kind`. `host_vars/<host>.yml`, key `device`."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Literal

from pydantic import Field, StrictBool, StrictInt

from atlantis_netcfg.site.model._base import (
    Address,
    HostName,
    MacAddress,
    Model,
    Name,
    PortName,
    SecretText,
    Ssid,
    Text,
)
from atlantis_netcfg.site.model.pilot import Transport

__all__ = [
    "Access",
    "ControlCentre",
    "Cpe",
    "Device",
    "Forward",
    "Gateway",
    "LteRouter",
    "Poe",
    "PoeMode",
    "Port",
    "PortUse",
    "PowerSource",
    "Ptp",
    "PtpMode",
    "PtpProtocol",
    "Router",
    "SatelliteTerminal",
    "VpnClient",
    "VpnServer",
]


class PowerSource(Model):
    """The PoE port that feeds a device."""

    device: HostName
    """The router of the same site."""
    port: PortName
    """A port of it that has `poe`."""


class _Box(Model):
    model: Text | None = None
    """What is printed on it; null until the partner has told."""
    mac: MacAddress | None = None
    """Of its network card."""
    powered_by: PowerSource | None = None
    """None if it has a supply of its own."""


class Access(Model):
    """How the toolkit reaches a RouterOS device."""

    address: Address
    """A router's on its management port, a CPE's in the network of its link."""
    port: Annotated[StrictInt, Field(ge=1, le=65535)] = 8729
    """Of service `api-ssl`."""
    user: Text = "provision"
    """In group `full`."""
    password: SecretText
    """Vaulted, or EXAMPLE-…."""
    via: Name = "lan"
    """`lan` from the management port, or the bearer over which the technician works."""


class PoeMode(StrEnum):
    """RouterOS' words (MikroTik manual, PoE-Out)."""

    AUTO_ON = "auto-on"
    FORCED_ON = "forced-on"
    OFF = "off"


class Poe(Model):
    """Power on a port; 0 is the last to be cut when power is short."""

    out: PoeMode = PoeMode.AUTO_ON
    """RouterOS' `poe-out`."""
    priority: Annotated[StrictInt, Field(ge=0, le=99)] = 10
    """RouterOS' `poe-priority`."""


class PortUse(StrEnum):
    """What a port of the router is for."""

    LAN = "lan"
    LINK = "link"
    MANAGEMENT = "management"
    OFF = "off"


class Port(Model):
    """One Ethernet port of the router."""

    name: PortName
    """The factory name (`default-name`), like ether1."""
    use: PortUse
    link: Name | None = None
    """With `use: link`: the bearer or served link on it."""
    poe: Poe | None = None
    """Only for ports that can feed power."""


class VpnClient(Model):
    """The router itself is the site's end of the VPN."""

    certificate: Text
    """Name of the client certificate on the device."""
    user: Annotated[Text, Field(max_length=27)]
    """RouterOS sends one even with certificates, 27 characters at most (MikroTik manual, OpenVPN)."""
    password: SecretText
    """Vaulted, or EXAMPLE-…."""
    address: Address
    """Its fixed tunnel address, inside the infrastructure pool."""


class Forward(Model):
    """A port of the public address that leads to a host of the LAN."""

    transport: Transport
    port: Annotated[StrictInt, Field(ge=1, le=65535)]
    """The same outside and inside."""
    to: HostName
    """A host of the site's LAN."""


class Router(_Box):
    """The MikroTik router of a site."""

    kind: Literal["router"]
    access: Access
    ports: Annotated[tuple[Port, ...], Field(min_length=2)]
    """Every port of the box, also those that are off."""
    vpn_client: VpnClient | None = None
    """None where another host is the site's end of the VPN."""
    forwards: tuple[Forward, ...] = ()
    """What the public address lets in."""


class PtpMode(StrEnum):
    """Which end of the bridge."""

    ACCESS_POINT = "access_point"
    STATION = "station"


class PtpProtocol(StrEnum):
    """RouterOS' words for `wireless-protocol`."""

    IEEE_80211 = "802.11"
    NSTREME = "nstreme"
    NV2 = "nv2"


class Ptp(Model):
    """Radio settings of one end; both ends must agree."""

    peer: HostName
    mode: PtpMode
    ssid: Ssid
    protocol: PtpProtocol
    standard: Literal["802.11a", "802.11g", "802.11n", "802.11ac", "802.11ax"]
    band: Literal["2ghz", "5ghz"]
    frequency_mhz: StrictInt
    width_mhz: Literal[20, 40, 80] = 20
    country: Literal["portugal", "belgium"]
    outdoor: StrictBool = True
    key: SecretText


class Cpe(_Box):
    """One end of the directional Wi-Fi bridge."""

    kind: Literal["cpe"]
    access: Access
    ptp: Ptp


class LteRouter(_Box):
    """The outdoor 3G/4G unit."""

    kind: Literal["lte_router"]
    address: Address


class SatelliteTerminal(_Box):
    """The Thales VesseLINK: no machine interface of it is documented, so its own settings are declared, not driven."""

    kind: Literal["satellite_terminal"]
    address: Address


class _LanHost(_Box):
    address: Address
    """In the site's LAN."""
    vpn_address: Address | None = None


class Gateway(_LanHost):
    """The data gateway computer."""

    kind: Literal["gateway"]


class VpnServer(_LanHost):
    """Runs the OpenVPN server."""

    kind: Literal["vpn_server"]


class ControlCentre(_LanHost):
    """Runs the control centre's services."""

    kind: Literal["control_centre"]


Device = Annotated[
    Router | Cpe | LteRouter | SatelliteTerminal | Gateway | VpnServer | ControlCentre,
    Field(discriminator="kind"),
]
