"""The links of a site with their cost per byte, from the inventory."""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.errors import UsageError, nearest
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.links.cost import MeteredLink, Tariff

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.inventory.model import Link

CABLE: Final = "lan"
"""Link name of the technician's cable."""
_MB: Final = 1_000_000


def links_of(inventory: Inventory, site: str) -> Mapping[str, MeteredLink]:
    """Return every link of a site by name, including the technician's cable."""
    links = (_link(site, site_link) for site_link in inventory.sites[site].bearers)
    return {CABLE: MeteredLink(CABLE, site, is_metered=False), **{link.name: link for link in links}}


def link_of(inventory: Inventory, site: str, name: str) -> MeteredLink:
    """Return one link of a site; raise KeyError for an unknown name (`site_link_of` checks it before)."""
    return links_of(inventory, site)[name]


def link_named(inventory: Inventory, site: str, name: str) -> Link:
    """Return the link of that name; raise UsageError, which suggests the nearest name."""
    links = {link.name: link for link in inventory.sites[site].bearers}
    if name not in links:
        near = nearest(name, links)
        choices = msg(f"its links are: {arg(join(', ', links))}")
        raise UsageError(
            f"`{arg(site)}` has no link `{arg(name)}`",
            hint=f"did you mean `link={arg(near)}`? {arg(choices)}" if near else choices,
        )
    return links[name]


def _link(site: str, link: Link) -> MeteredLink:
    billing = link.billing if link.metered else None
    tariff = None
    if billing is not None:
        tariff = Tariff(
            price_per_mb=Decimal(str(billing.price_per_mb)),
            currency=billing.currency,
            min_session_bytes=billing.min_session_bytes,
            floor_bytes_per_s=billing.floor_bytes_per_s,
            floor_after_s=billing.floor_after_s,
        )
    return MeteredLink(link.name, site, link.metered, tariff, round(link.cap_mb * _MB) if link.metered else None)
