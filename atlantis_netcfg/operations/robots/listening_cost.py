"""What listening for robots costs from beyond a site, all of whose links are paid by the byte."""

from __future__ import annotations

from ipaddress import IPv4Address
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.links.cost import Preview, preview
from atlantis_netcfg.operations import robots
from atlantis_netcfg.operations.common.site_links import link_of
from atlantis_netcfg.robots.network import ANNOUNCE_S

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.inventory import Declaration

_ANNOUNCEMENT: Final = 445
"""Bytes over the link: 375 were counted on average, without Ethernet's header; the VPN adds its own."""
_AROUND_A_MESSAGE: Final = 160
"""Headers of DDS, UDP, IP and the VPN."""


def listening_cost(declaration: Declaration, site: str, seconds: float, address: Callable[[], str]) -> Preview | None:
    """What robots' configurations and declared telemetry come to over the site's first link, for who listens elsewhere.

    None: the site has a link that is not paid by the byte, or `address` gives one of its LAN or of this computer alone.
    Topics that `telemetry:` of no vehicle names are not in it. Raises as `robots_of`, and whatever `address` raises.
    """
    bearers = declaration.sites[site].bearers
    if not all(each.metered for each in bearers):
        return None
    place = IPv4Address(address())
    if place.is_loopback or place in declaration.sites[site].lan.network:
        return None
    sources, _ = robots.robots_of(declaration)
    here = [each for each in sources if each.vehicle in robots.expected_at(declaration, site)]
    rates = [(1.0, each.size) for each in here]
    rates += [
        (topic.rate_hz, topic.size_bytes)
        for each in here
        for topic in declaration.vehicles[str(each.vehicle)].telemetry
    ]
    steady = sum(rate * (octets + _AROUND_A_MESSAGE) for rate, octets in rates)
    ports = len(set(robots.peers_of(declaration, [site]))) * (robots.dds_of(declaration).participants + 1)
    announcements = ports * (seconds / ANNOUNCE_S + 1) * _ANNOUNCEMENT
    return preview(round(seconds * steady + announcements), seconds, link_of(declaration, site, bearers[0].name))
