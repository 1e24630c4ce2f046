"""What the boxes of a site have in common."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, StrictInt

from atlantis_netcfg.declaration.model._base import (
    Address,
    Fingerprint,
    HostKey,
    HostName,
    MacAddress,
    Model,
    Name,
    PortName,
    SecretText,
    Text,
)


class PowerSource(Model):
    """The PoE port that feeds a device."""

    device: HostName
    """The router of the same site."""
    port: PortName
    """A port of it that has `poe`."""


class Box(Model):
    """What every box has."""

    model: Text | None = None
    """What is printed on it; null until the partner has told."""
    mac: MacAddress | None = None
    """Of its network card."""
    powered_by: PowerSource | None = None
    """None if it has a supply of its own."""


class LanBox(Box):
    """A host of the site's LAN."""

    address: Address
    """In the site's LAN."""
    vpn_address: Address | None = None


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
    fingerprint: Fingerprint | None = None
    """Of its certificate; None: it is known on this computer alone, by `provision adopt` or `provision trust`."""
    host_key: HostKey | None = None
    """Of its SSH server; None: it is known on this computer alone, by `provision adopt`."""
    via: Name = "lan"
    """`lan` from the management port, or the bearer over which the technician works."""
