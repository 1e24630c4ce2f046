"""Rules between the parts of an inventory: one small function per rule, one module per theme.

A rule takes the draft and yields a `Finding` for every violation, at the value that a person would change. It checks
valid parts only, so it never fails because of an error that is reported elsewhere; a reference to a part that exists
but is invalid is skipped. A new rule is a function in the module of its theme and a name in its `RULES`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.inventory.rules import (
    checklist,
    dds,
    endpoints,
    gateways,
    lan,
    links,
    lte,
    management,
    networks,
    ports,
    qualify,
    radio,
    retrieval,
    satellite,
    secrets,
    services,
    vehicles,
    vpn,
    wifi,
)

if TYPE_CHECKING:
    from atlantis_netcfg.inventory._draft import Rule

__all__ = ["RULES", "WARNINGS"]

RULES: tuple[Rule, ...] = (
    *management.GROUPS_RULES,
    *networks.RULES,
    *lan.RULES,
    *lan.UNIQUE_ADDRESSES_RULES,
    *management.RULES,
    *links.RULES,
    *links.BRIDGES_RULES,
    *endpoints.PROBES_RULES,
    *lte.FAILOVER_RULES,
    *satellite.COST_RULES,
    *satellite.RULES,
    *ports.RULES,
    *ports.POWER_RULES,
    *radio.RULES,
    *radio.EIRP_RULES,
    *lte.RULES,
    *gateways.GATEWAY_RULES,
    *gateways.RULES,
    *services.RULES,
    *retrieval.RULES,
    *vpn.RULES,
    *vpn.PARTNERS_RULES,
    *qualify.RULES,
    *dds.RULES,
    *vehicles.RULES,
    *endpoints.RULES,
    *checklist.RULES,
    *wifi.RULES,
    *management.CLOCK_RULES,
    *secrets.RULES,
)

WARNINGS: tuple[Rule, ...] = (*lan.WARNINGS, *radio.WARNINGS, *satellite.COST_WARNINGS, *vehicles.WARNINGS)
"""Rules for values that are allowed but not recommended; their findings stop nothing."""
