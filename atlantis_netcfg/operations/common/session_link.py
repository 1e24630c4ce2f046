"""The link that carries the session to a device, and the timeouts that follow from it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg, join
from atlantis_netcfg.operations.common.kinds import get_managed_device, is_supported
from atlantis_netcfg.operations.common.site_links import CABLE
from atlantis_netcfg.routeros.estimate import LinkMetrics

if TYPE_CHECKING:
    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.inventory.model import Link as Declared
    from atlantis_netcfg.routeros.api import Endpoint

FAST_S: Final = 0.2
"""Round trip time in seconds below which a link has no gaps of minutes, as a satellite link has."""
PATIENCE_S: Final = 15.0
"""Timeout in seconds for connection and login over a fast link: a device that is present responds at once."""
_REPLY_S: Final = 60.0
"""Timeout for a response over a fast link: a small board may run a script for seconds, or wait for its flash."""

LAN = LinkMetrics(name=CABLE, rtt_s=0.001, rate_up_bps=100e6, rate_down_bps=100e6, is_metered=False)
"""Link profile of the technician's cable: an ordinary 100 Mbit/s port."""


def site_link_of(inventory: Inventory, host: Host, via: str | None = None) -> LinkMetrics:
    """Return the link to a device; `via` overrides the inventory. Raise UsageError if the site has no such link."""
    name = via or (get_managed_device(inventory, host).access.via if is_supported(host) else LAN.name)
    if name == LAN.name:
        return LAN
    links = {link.name: link for link in inventory.sites[host.site].bearers}
    if name not in links:
        choices = join(", ", [LAN.name, *links])
        raise UsageError(f"`via={arg(name)}`: {arg(host.site)} has no such link", hint=f"its links: {arg(choices)}")
    return as_link(links[name])


def with_timeouts(endpoint: Endpoint, link: LinkMetrics) -> Endpoint:
    """Return the endpoint with the timeouts that its link needs.

    A cable or a bridge on land has no gaps: a dead device there is given up in seconds. Everything else keeps the
    defaults, which outlast the gaps of 70 s of a satellite; so does a metered link, since a modem that searches for its
    network is silent for as long.
    """
    if link.is_metered or link.rtt_s >= FAST_S:
        return endpoint
    return replace(endpoint, connect_timeout_s=PATIENCE_S, reply_timeout_s=_REPLY_S)


def as_link(link: Declared) -> LinkMetrics:
    """Convert a link of the inventory to the units of estimates."""
    return LinkMetrics(
        name=link.name,
        rtt_s=link.rate.rtt_ms / 1000,
        rate_up_bps=link.rate.up_kbps * 1000,
        rate_down_bps=link.rate.down_kbps * 1000,
        is_metered=link.metered,
    )
