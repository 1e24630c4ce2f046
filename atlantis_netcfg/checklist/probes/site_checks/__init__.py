"""The site's own checks: what other marine projects learned the hard way, looked at before every test.

None of them is a cell of Table 3; each is an item `<site>/site/<name>` of its own, by the tool alone where it can. They
ask the router for rows and the gateway computer for what its programs print, and send nothing but DHCP questions, some
ARP questions, the announcement of a DDS participant to the gateway computer itself and five pings, all inside the
site's own networks. What is not declared at a site is skipped, and says why; VPN and DDS never are. How each could be
fooled, and what stops it, stands in docs/probes.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes.site_checks import (
    _certificates,
    _clock,
    _dds,
    _default_route,
    _duplicates,
    _factory,
    _one_subnet,
    _poe,
    _rogue_dhcp,
    _satellite,
    _static,
    _vpn,
)
from atlantis_netcfg.checklist.probes.site_checks._site import by_hand, own_site

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.probes.cell import Cell
    from atlantis_netcfg.checklist.probes.step import Step

__all__ = ["NAMES", "steps"]

_CHECKS = {
    "rogue-dhcp": _rogue_dhcp.of,
    "duplicate-addresses": _duplicates.of,
    "one-subnet-twice": _one_subnet.of,
    "default-route": _default_route.of,
    "static-addresses": _static.of,
    "factory-defaults": _factory.of,
    "clock": _clock.of,
    "vpn": _vpn.of,
    "dds": _dds.of,
    "certificates": _certificates.of,
    "poe": _poe.of,
    "satellite-filter": _satellite.of,
}
NAMES = tuple(_CHECKS)
"""Of the checks, in the order in which a technician would look."""


def steps(cell: Cell) -> tuple[Step, ...]:
    """Give every check: of what no program can see here a person is asked, what does not apply is skipped by name."""
    site = own_site(cell)
    if site.router is None:
        do = "Look at it yourself: the site has no router of ours that could be asked."
        return tuple(by_hand(name, name.replace("-", " "), do, _HOLDS.format(name), (site.name,)) for name in NAMES)
    return tuple(make(site) for make in _CHECKS.values())


_HOLDS = "What docs/check.md says of `{}` holds."
