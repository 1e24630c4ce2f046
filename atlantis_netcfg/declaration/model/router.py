"""A site's router. `host_vars/<host>.yml`, key `device`."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Literal

from pydantic import Field, StrictInt

from atlantis_netcfg.declaration.model._base import Address, HostName, Model, Name, PortName, SecretText, Text
from atlantis_netcfg.declaration.model._box import Access, Box
from atlantis_netcfg.declaration.model.pilot import Transport

__all__ = ["Forward", "Poe", "PoeMode", "Port", "PortUse", "Router", "VpnClient"]


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


class Router(Box):
    """The MikroTik router of a site."""

    kind: Literal["router"]
    access: Access
    ports: Annotated[tuple[Port, ...], Field(min_length=2)]
    """Every port of the box, also those that are off."""
    vpn_client: VpnClient | None = None
    """None where another host is the site's end of the VPN."""
    forwards: tuple[Forward, ...] = ()
    """What the public address lets in."""
