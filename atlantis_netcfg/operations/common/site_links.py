"""The links of a site with their cost per byte, from the inventory."""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.errors import UsageError, nearest
from atlantis_netcfg.links.cost import MeteredLink, Tariff

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.inventory import Declaration
    from atlantis_netcfg.inventory.model import Bearer

CABLE: Final = "lan"
"""The technician's cable."""
_MB: Final = 1_000_000


def links_of(declaration: Declaration, site: str) -> Mapping[str, MeteredLink]:
    """Return every link of a site by name, including the technician's cable."""
    links = (_link(site, bearer) for bearer in declaration.sites[site].bearers)
    return {CABLE: MeteredLink(CABLE, site, is_metered=False), **{link.name: link for link in links}}


def link_of(declaration: Declaration, site: str, name: str) -> MeteredLink:
    """Return one link of a site; raise KeyError for an unknown name (`bearer_of` checks it before)."""
    return links_of(declaration, site)[name]


def bearer_named(declaration: Declaration, site: str, name: str) -> Bearer:
    """Return the link of that name; raise UsageError, which suggests the nearest name."""
    bearers = {bearer.name: bearer for bearer in declaration.sites[site].bearers}
    if name not in bearers:
        near = nearest(name, bearers)
        choices = f"its links are: {', '.join(bearers)}"
        raise UsageError(
            f"`{site}` has no link `{name}`", hint=f"did you mean `link={near}`? {choices}" if near else choices
        )
    return bearers[name]


def _link(site: str, bearer: Bearer) -> MeteredLink:
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
    return MeteredLink(
        bearer.name, site, bearer.metered, tariff, round(bearer.cap_mb * _MB) if bearer.metered else None
    )
