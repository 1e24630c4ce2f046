"""The declared bearers of a site in the words of `bearers.cost` and `bearers.policy`."""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.bearers.cost import Link, Tariff
from atlantis_netcfg.bearers.policy import Way
from atlantis_netcfg.declaration.model import Router
from atlantis_netcfg.operations.bearers import LAN

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.declaration.model import Bearer

__all__ = ["link_of", "links_of", "ports_of", "ways_of"]

_MB: Final = 1_000_000


def links_of(declaration: Declaration, site: str) -> Mapping[str, Link]:
    """Every link of a site by its name, the technician's cable among them."""
    declared = (_link(site, bearer) for bearer in declaration.sites[site].bearers)
    return {LAN.name: Link(LAN.name, site, metered=False), **{link.name: link for link in declared}}


def link_of(declaration: Declaration, site: str, name: str) -> Link:
    """One link of a site. KeyError if it has none of that name: `bearer_of` has looked before."""
    return links_of(declaration, site)[name]


def ways_of(declaration: Declaration, host: Host) -> tuple[Way, ...]:
    """The bearers as the router of the site knows them; none for a device that is not a router."""
    if not isinstance(host.device, Router):
        return ()
    ports = {bearer: port for port, bearer in ports_of(host).items()}
    return tuple(
        Way(
            name=bearer.name,
            gateway=str(bearer.gateway),
            address=str(bearer.address),
            canaries=tuple(map(str, bearer.canaries)),
            port=ports.get(bearer.name),
            kind=bearer.kind.value,
            metered=bearer.metered,
        )
        for bearer in declaration.sites[host.site].bearers
    )


def ports_of(host: Host) -> Mapping[str, str]:
    """Port of a router to the link that hangs on it, in the order of the declaration."""
    if not isinstance(host.device, Router):
        return {}
    return {port.name: port.link for port in host.device.ports if port.link is not None}


def _link(site: str, bearer: Bearer) -> Link:
    billing = bearer.billing if bearer.metered else None
    tariff = None
    if billing is not None:
        tariff = Tariff(
            price_per_mb=Decimal(str(billing.price_per_mb)),
            currency=billing.currency,
            min_session_bytes=billing.min_session_bytes,
            floor_bytes_per_s=billing.floor_bytes_per_s,
            floor_after_s=billing.floor_after_s,
        )
    return Link(bearer.name, site, bearer.metered, tariff, round(bearer.cap_mb * _MB) if bearer.metered else None)
