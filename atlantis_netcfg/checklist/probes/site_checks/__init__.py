"""The site's own checks, from the experience of other marine projects, run before every test.

None of them is a cell of Table 3; each is an item `<site>/site/<name>`, run by the tool alone if possible. They read
rows from the router and program output from the gateway computer. They send only DHCP discoveries, IPv6 router
solicitations, some ARP requests, the announcement of a DDS participant to the gateway computer itself, five pings
inside the site's own networks and the VPN, and a few messages through the VPN to the control centre. A check whose
subject is not in the inventory is skipped, with the reason; VPN, messages and DDS are never skipped.
docs/engineers/probes.md describes how each could be deceived, and what prevents that.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes.site_checks import addresses
from atlantis_netcfg.checklist.probes.site_checks.access_point import access_point_check
from atlantis_netcfg.checklist.probes.site_checks.certificates import certificates_check
from atlantis_netcfg.checklist.probes.site_checks.clock import clock_check
from atlantis_netcfg.checklist.probes.site_checks.data_reaches import NAME as DATA_REACHES
from atlantis_netcfg.checklist.probes.site_checks.data_reaches import data_reaches_check
from atlantis_netcfg.checklist.probes.site_checks.dds import dds_check
from atlantis_netcfg.checklist.probes.site_checks.factory import factory_defaults_check
from atlantis_netcfg.checklist.probes.site_checks.link_qualified import link_qualified_checks
from atlantis_netcfg.checklist.probes.site_checks.parse import by_hand, own_site
from atlantis_netcfg.checklist.probes.site_checks.poe import poe_check
from atlantis_netcfg.checklist.probes.site_checks.uplinks import default_route_check, satellite_filter_check
from atlantis_netcfg.checklist.probes.site_checks.vpn import vpn_check
from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.probes.base import Cell, Step

__all__ = ["NAMES", "steps"]

_CHECKS = {
    "rogue-dhcp": addresses.rogue_dhcp_check,
    "rogue-router": addresses.rogue_router_check,
    "duplicate-addresses": addresses.duplicate_addresses_check,
    "one-subnet-twice": addresses.one_subnet_twice_check,
    "default-route": default_route_check,
    "static-addresses": addresses.static_addresses_check,
    "factory-defaults": factory_defaults_check,
    "clock": clock_check,
    "vpn": vpn_check,
    DATA_REACHES: data_reaches_check,
    "dds": dds_check,
    "certificates": certificates_check,
    "poe": poe_check,
    "satellite-filter": satellite_filter_check,
}
NAMES = tuple(_CHECKS)
"""Names of the checks, in the order in which a technician would look."""


def steps(cell: Cell) -> tuple[Step, ...]:
    """Return all checks; a person does those no program can do, and those that do not apply are skipped with a reason.

    One more is added if a radio of the gateway opens a network, and one for each link with measurements in the
    inventory.
    """
    site = own_site(cell)
    if site.router is None:
        do = "Check it yourself: the site has no router in the inventory that could be queried."
        return tuple(
            by_hand(
                name,
                name.replace("-", " "),
                do,
                msg(f"What docs/checklist.md says about `{arg(name)}` is true."),
                (site.name,),
            )
            for name in NAMES
        )
    return (*(make(site) for make in _CHECKS.values()), *access_point_check(site), *link_qualified_checks(site))
