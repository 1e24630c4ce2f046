"""What must hold between the parts of a declaration. One small function a rule, one module a theme.

A rule takes the draft and yields a `Finding` for every breach, at the value that a person would change. It looks at
valid parts only, so a rule never fails because of an error that is told elsewhere; a reference to a part that is
declared but invalid is passed over. A new rule is a function in the module of its theme and a name in its `RULES`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.declaration.rules import (
    clock,
    dds,
    endpoints,
    gateways,
    lan,
    links,
    lte,
    management,
    networks,
    ports,
    radio,
    satellite,
    secrets,
    vehicles,
    vpn,
)
from atlantis_netcfg.declaration.rules import endpoints as probes
from atlantis_netcfg.declaration.rules import gateways as gateway
from atlantis_netcfg.declaration.rules import lan as unique_addresses
from atlantis_netcfg.declaration.rules import links as bridges
from atlantis_netcfg.declaration.rules import lte as failover
from atlantis_netcfg.declaration.rules import management as groups
from atlantis_netcfg.declaration.rules import ports as power
from atlantis_netcfg.declaration.rules import radio as eirp
from atlantis_netcfg.declaration.rules import satellite as cost
from atlantis_netcfg.declaration.rules import vpn as partners

if TYPE_CHECKING:
    from atlantis_netcfg.declaration._draft import Rule

__all__ = ["RULES"]

RULES: tuple[Rule, ...] = (
    *groups.GROUPS_RULES,
    *networks.RULES,
    *lan.RULES,
    *unique_addresses.UNIQUE_ADDRESSES_RULES,
    *management.RULES,
    *links.RULES,
    *bridges.BRIDGES_RULES,
    *probes.PROBES_RULES,
    *failover.FAILOVER_RULES,
    *cost.COST_RULES,
    *satellite.RULES,
    *ports.RULES,
    *power.POWER_RULES,
    *radio.RULES,
    *eirp.EIRP_RULES,
    *lte.RULES,
    *gateway.GATEWAY_RULES,
    *gateways.RULES,
    *vpn.RULES,
    *partners.PARTNERS_RULES,
    *dds.RULES,
    *vehicles.RULES,
    *endpoints.RULES,
    *clock.RULES,
    *secrets.RULES,
)
