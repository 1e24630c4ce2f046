"""What must hold between the parts of a declaration. One small function a rule, one module a theme.

A rule takes the draft and yields a `Finding` for every breach, at the value that a person would change. It looks at
valid parts only, so a rule never fails because of an error that is told elsewhere; a reference to a part that is
declared but invalid is passed over. A new rule is a function in the module of its theme and a name in its `RULES`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.declaration.rules import (
    bridges,
    clock,
    cost,
    dds,
    eirp,
    endpoints,
    failover,
    gateway,
    gateways,
    groups,
    lan,
    links,
    lte,
    management,
    networks,
    partners,
    ports,
    power,
    probes,
    radio,
    satellite,
    secrets,
    unique_addresses,
    vehicles,
    vpn,
)

if TYPE_CHECKING:
    from atlantis_netcfg.declaration._draft import Rule

__all__ = ["RULES"]

RULES: tuple[Rule, ...] = (
    *groups.RULES,
    *networks.RULES,
    *lan.RULES,
    *unique_addresses.RULES,
    *management.RULES,
    *links.RULES,
    *bridges.RULES,
    *probes.RULES,
    *failover.RULES,
    *cost.RULES,
    *satellite.RULES,
    *ports.RULES,
    *power.RULES,
    *radio.RULES,
    *eirp.RULES,
    *lte.RULES,
    *gateway.RULES,
    *gateways.RULES,
    *vpn.RULES,
    *partners.RULES,
    *dds.RULES,
    *vehicles.RULES,
    *endpoints.RULES,
    *clock.RULES,
    *secrets.RULES,
)
