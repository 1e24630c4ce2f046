"""The part of the declaration that a router's text depends on, and the one error when it lacks something."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from atlantis_netcfg.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.declaration.model import Device, Pilot, Router, Site


class RenderError(UsageError):
    """The declaration lacks what the template needs; `provision validate` tells the same with file and line."""


class DeclaredHost(Protocol):
    """A host of the inventory."""

    @property
    def name(self) -> str:
        """As the inventory calls it."""

    @property
    def site(self) -> str:
        """Key in `sites`."""

    @property
    def device(self) -> Device:
        """What it is."""


class Declared(Protocol):
    """The declaration, as far as rendering reads it."""

    @property
    def pilot(self) -> Pilot:
        """What all sites share."""

    @property
    def sites(self) -> Mapping[str, Site]:
        """By name."""

    @property
    def hosts(self) -> Mapping[str, DeclaredHost]:
        """By name."""


def router_of(host: DeclaredHost) -> Router:
    """Return the device of a host that is a router."""
    if host.device.kind != "router":
        raise RenderError(f"{host.name} is a {host.device.kind}, and only a router has a router's configuration")
    return host.device


def hosts_of(declaration: Declared, site: str) -> tuple[DeclaredHost, ...]:
    """Return the hosts of a site by name, so that the text does not depend on the order of files."""
    return tuple(host for _, host in sorted(declaration.hosts.items()) if host.site == site)


def address_in_site(device: Device, site: Site) -> str:
    """Return the address by which the hosts of its site know a device."""
    if device.kind == "router":
        return str(site.lan.gateway)
    return str(device.access.address if device.kind == "cpe" else device.address)
