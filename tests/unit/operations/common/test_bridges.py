from dataclasses import replace

import pytest

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.operations.common.schedule import bridges

BOTH = ["coastal-cpe", "scc-cpe"]


def ptp(declaration: Inventory) -> str:
    """The name of the bearer that the bridge is."""
    return next(
        bearer.name for site in declaration.sites.values() for bearer in site.bearers if bearer.kind == "wifi_ptp"
    )


@pytest.mark.parametrize(("far", "near"), [("scc-cpe", "coastal-cpe"), ("coastal-cpe", "scc-cpe")])
def test_end_reached_over_the_bridge_is_far(declaration: Inventory, far: str, near: str) -> None:
    (bridge,) = bridges(declaration, BOTH, via={far: ptp(declaration)})
    assert (bridge.near.name, bridge.far.name) == (near, far)


@pytest.mark.parametrize("name", BOTH)
def test_where_both_are_on_cables_the_site_decides(declaration: Inventory, name: str) -> None:
    site = declaration.hosts[name].site
    (bridge,) = bridges(declaration, [name], near_site=site)
    assert bridge.near.name == name
    assert {bridge.near.name, bridge.far.name} == set(BOTH)


def test_ambiguous_location_is_refused(declaration: Inventory) -> None:
    with pytest.raises(UsageError, match="and the near one is not known") as refused:
        bridges(declaration, BOTH)
    assert "coastal" in (refused.value.hint or "")
    with pytest.raises(UsageError, match="are both reached over the bridge between them"):
        bridges(declaration, BOTH, via=dict.fromkeys(BOTH, ptp(declaration)))


def test_hosts_that_are_no_bridge_ends_have_no_bridge(declaration: Inventory) -> None:
    assert bridges(declaration, ["coastal-router"]) == ()
    alone = replace(declaration, hosts={"coastal-cpe": declaration.hosts["coastal-cpe"]})
    assert bridges(alone, ["coastal-cpe"]) == ()
