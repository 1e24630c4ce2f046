"""The cost of listening for robots from outside a site whose links are all metered."""

from __future__ import annotations

from ipaddress import IPv4Address
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.links.cost import Preview, preview
from atlantis_netcfg.operations import robots
from atlantis_netcfg.operations.common.site_links import link_of
from atlantis_netcfg.robots.network import ANNOUNCE_S

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.inventory import Inventory

_ANNOUNCEMENT: Final = 445
"""Bytes on the link: 375 were measured on average, without the Ethernet header; the VPN adds its own."""
_AROUND_A_MESSAGE: Final = 160
"""Header bytes of DDS, UDP, IP and the VPN per message."""


def listening_cost(inventory: Inventory, site: str, seconds: float, address: Callable[[], str]) -> Preview | None:
    """Return the cost of robots' configurations and telemetry over the site's first link, for a remote listener.

    None: the site has an unmetered link, or `address` returns one of its LAN or of this computer alone. Topics that no
    vehicle's `telemetry:` names are not included. Raises as `robots_of`, and whatever `address` raises.
    """
    links = inventory.sites[site].bearers
    if not all(each.metered for each in links):
        return None
    place = IPv4Address(address())
    if place.is_loopback or place in inventory.sites[site].lan.network:
        return None
    sources, _ = robots.robots_of(inventory)
    here = [each for each in sources if each.vehicle in robots.expected_at(inventory, site)]
    rates = [(1.0, each.size) for each in here]
    rates += [
        (topic.rate_hz, topic.size_bytes) for each in here for topic in inventory.vehicles[str(each.vehicle)].telemetry
    ]
    steady = sum(rate * (octets + _AROUND_A_MESSAGE) for rate, octets in rates)
    ports = len(set(robots.peers_of(inventory, [site]))) * (robots.dds_of(inventory).participants + 1)
    announcements = ports * (seconds / ANNOUNCE_S + 1) * _ANNOUNCEMENT
    return preview(round(seconds * steady + announcements), seconds, link_of(inventory, site, links[0].name))
