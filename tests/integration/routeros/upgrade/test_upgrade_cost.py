"""Packages over links that are paid by the byte: refused before the first byte, whatever came before."""

from pathlib import Path
from typing import Any, cast

import pytest
from npk_files import write

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.events import ignore
from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.links.cost import CostRefusal
from atlantis_netcfg.operations import Request
from atlantis_netcfg.operations.common.session_link import site_link_of
from atlantis_netcfg.operations.common.site_links import link_of
from atlantis_netcfg.operations.upgrade import PreparedUpgrade, _cost
from atlantis_netcfg.routeros.packages import Upgrade, read_npk

INVENTORY = Path(__file__).parents[4] / "inventory"
ROUTER = "coastal-router"


@pytest.fixture(scope="module")
def declaration() -> Inventory:
    return load(INVENTORY)


def request(tmp_path: Path, via: str, **more: Any) -> Request:  # noqa: ANN401 - fields of Request
    return Request(state=tmp_path / "state", via={ROUTER: via}, command="provision device upgrade", **more)


def prepared(declaration: Inventory, tmp_path: Path, via: str, size: int) -> PreparedUpgrade:
    """An upgrade as it is after the device was looked at; the rest of it is not asked for before the cost is."""
    package = read_npk(write(tmp_path, "routeros", "7.21.5", "arm64", payload=size))
    upgrade = Upgrade((package,), Version(7, 21, 5), ("routeros",))
    bearer = site_link_of(declaration, declaration.hosts[ROUTER], via)
    cost = _cost(upgrade, bearer, link_of(declaration, "coastal", via))
    nothing = cast("Any", None)
    return PreparedUpgrade(nothing, nothing, upgrade, bearer, cost, nothing)


def test_device_is_not_contacted_before_cost_is_accepted(declaration: Inventory, tmp_path: Path) -> None:
    path = write(tmp_path, "routeros", "7.21.5", "arm64")
    with pytest.raises(CostRefusal, match="nothing was sent: over metered link satellite of coastal") as refused:
        PreparedUpgrade.of(declaration, declaration.hosts[ROUTER], [path], request(tmp_path, "satellite"), ignore)
    assert refused.value.exit is ExitCode.FAILED
    assert not (tmp_path / "state").exists()


def test_files_beyond_the_cap_are_refused_even_if_cost_is_accepted(declaration: Inventory, tmp_path: Path) -> None:
    beyond = prepared(declaration, tmp_path, "satellite", 6_000_000)
    accepted = request(tmp_path, "satellite", accept_cost=True)
    with pytest.raises(CostRefusal, match=r"the limit for one action is 5\.0 MB") as refused:
        beyond.affordable(accepted)
    assert "`cap_mb` of link `satellite` in group_vars/coastal.yml" in (refused.value.hint or "")
    with pytest.raises(CostRefusal, match=r"the limit for one action is 5\.0 MB"):
        beyond.carry_out(declaration, accepted)
    assert not (tmp_path / "state").exists()
    beyond.affordable(request(tmp_path, "satellite", rehearsed=True))
    prepared(declaration, tmp_path, "lan", 6_000_000).affordable(request(tmp_path, "lan"))


def test_files_below_the_cap_are_refused_until_cost_is_accepted(declaration: Inventory, tmp_path: Path) -> None:
    dear = prepared(declaration, tmp_path, "satellite", 2_000_000)
    dear.affordable(request(tmp_path, "satellite"))
    assert dear.cost.bill.payload_bytes > 2_000_000 * 1.1
    with pytest.raises(CostRefusal, match="the cost was not accepted"):
        dear.carry_out(declaration, request(tmp_path, "satellite"))
    assert not (tmp_path / "state").exists()
