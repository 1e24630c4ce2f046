"""A satellite that stands before other links: watched at this end alone, or by canaries that keep to their budget."""

import shutil
import sys
from dataclasses import replace
from ipaddress import IPv4Address
from pathlib import Path
from typing import Any

import pytest
import yaml
from quay_world import INVENTORY, World, shipped

from atlantis_netcfg.inventory import InventoryInvalid, load
from atlantis_netcfg.links.standing_traffic import TrafficSource
from atlantis_netcfg.operations.common.traffic_budget import standing_traffic
from atlantis_netcfg.routeros import rsc
from atlantis_netcfg.routeros.render import router, router_view

sys.path.append(str(Path(__file__).parents[3] / "unit" / "routeros" / "render"))
from render_walk import Packet, Walk

TERMINAL = "10.10.2.1"
CANARIES = ("198.51.100.41", "198.51.100.42")
HOLD_DOWN_S, FAIL_BACK_S = 90, 120
BUDGET_MB, BUDGET_EUR, PAUSE_S = 10.0, 80.0, 88
"""What the budget admits in a month: two canaries, 168 bytes each time. EUR by the shipped EXAMPLE tariff."""


def first(**more: Any) -> World:  # noqa: ANN401 - fields of Bearer
    given = shipped()
    site = given.sites["coastal"]
    wifi, lte, satellite = site.bearers
    satellite = satellite.model_copy(update=more)
    failover = site.failover.model_copy(update={"hold_down_s": HOLD_DOWN_S} if more else {})
    changed = site.model_copy(update={"bearers": (satellite, wifi, lte), "failover": failover})
    made = World("coastal", declaration=replace(given, sites={**given.sites, "coastal": changed}))
    made.passes(60)
    return made


def test_satellite_first_order_is_valid(tmp_path: Path) -> None:
    root = tmp_path / "inventory"
    shutil.copytree(INVENTORY, root)
    path = root / "group_vars" / "te4sea.yml"
    declared = yaml.safe_load(path.read_text(encoding="utf-8"))
    declared["site"]["bearers"].reverse()
    del declared["site"]["failover"]["metered_probe_s"]
    path.write_text(yaml.safe_dump(declared), encoding="utf-8")
    assert [bearer.name for bearer in load(root).sites["te4sea"].bearers] == ["satellite", "4g"]


def test_satellite_carries_traffic_until_its_terminal_is_dead() -> None:
    quay = first()
    before = quay.device.export(header=False)
    assert quay.order() == ["satellite"]
    quay.silence([TERMINAL])
    quay.passes(25)
    assert quay.active() == "wifi-ptp"
    quay.silence([])
    quay.passes(25)
    assert quay.order() == ["satellite", "wifi-ptp", "satellite"]
    assert quay.device.export(header=False) == before


def test_nothing_is_probed_over_the_satellite() -> None:
    quay = first()
    asked = {row["host"] for row in quay.rows("/tool/netwatch")}
    assert asked == set(quay.canaries("wifi-ptp"))  # 4g is the last one now
    (route,) = [row for row in quay.rows("/ip/route") if row.get("comment") == "atlantis: satellite, not probed"]
    assert (route["check-gateway"], route["distance"]) == ("arp", "10")


def budgeted() -> World:
    return first(canaries=tuple(map(IPv4Address, CANARIES)), canary_budget_mb=BUDGET_MB)


def test_budgeted_probe_targets_trigger_failover_behind_a_live_terminal() -> None:
    """Its terminal answers all the time."""
    quay = budgeted()
    before = quay.device.export(header=False)
    begun = quay.now
    quay.silence(CANARIES)
    quay.passes(PAUSE_S + HOLD_DOWN_S + 60)
    assert quay.order() == ["satellite", "wifi-ptp"]
    assert HOLD_DOWN_S <= quay.seen[-1][0] - begun <= PAUSE_S + HOLD_DOWN_S + 15
    begun = quay.now
    quay.silence([])
    quay.passes(PAUSE_S + FAIL_BACK_S + 60)
    assert quay.active() == "satellite"
    assert FAIL_BACK_S <= quay.seen[-1][0] - begun <= PAUSE_S + FAIL_BACK_S + 45
    assert quay.device.export(header=False) == before
    assert quay.errors() == []


def test_gaps_of_70_s_do_not_fail_over() -> None:
    """Two gaps, the second 70 s later in the time between two questions: together they leave no moment out."""
    quay = budgeted()
    met = 0
    for _ in range(2):
        quay.silence(CANARIES)
        quay.passes(70)
        rows = quay.rows("/tool/netwatch")
        met += any(row["name"].endswith("-silence") and row["disabled"] == "false" for row in rows)
        quay.silence([])
        quay.passes(PAUSE_S)
    assert met >= 1
    assert quay.order() == ["satellite"]


def test_terminal_is_watched_with_budgeted_probe_targets() -> None:
    quay = budgeted()
    quay.silence([TERMINAL, *CANARIES])
    quay.passes(25)
    assert quay.active() == "wifi-ptp"


def test_probe_traffic_is_within_the_budget_and_reported() -> None:
    quay = budgeted()
    (satellite, *_) = standing_traffic(quay.declaration, "coastal")
    (asked,) = [flow for flow in satellite.flows if flow.source is TrafficSource.CANARIES]
    assert 9_890_000 < 30 * asked.both <= 10_000_000
    assert (
        f"each probe target is pinged every {PAUSE_S} s: 9.9 MB of its 10.0 MB a month in the inventory; on a day "
        "when the link is unstable, up to 1.3 MB"
    ) in satellite.words
    watched = {row["name"]: row["interval"] for row in quay.rows("/tool/netwatch")}
    assert [watched[f"satellite-{canary}-watch"] for canary in CANARIES] == ["1m28s", "1m28s"]


@pytest.mark.parametrize("budget", [{}, {"canary_budget_mb": BUDGET_MB}, {"canary_budget_eur": BUDGET_EUR}])
def test_probe_budget_in_euro_equals_bytes_and_is_required(tmp_path: Path, budget: dict[str, float]) -> None:
    root = tmp_path / "inventory"
    shutil.copytree(INVENTORY, root)
    path = root / "group_vars" / "coastal.yml"
    declared = yaml.safe_load(path.read_text(encoding="utf-8"))
    wifi, lte, satellite = declared["site"]["bearers"]
    declared["site"]["bearers"] = [{**satellite, "canaries": list(CANARIES), **budget}, wifi, lte]
    declared["site"]["failover"] = {"hold_down_s": HOLD_DOWN_S, "fail_back_s": FAIL_BACK_S}
    path.write_text(yaml.safe_dump(declared), encoding="utf-8")
    if budget:
        assert load(root).sites["coastal"].bearers[0].probe_target_pause_s == PAUSE_S
        return
    with pytest.raises(InventoryInvalid, match="pinging them is billed day and night"):
        load(root)


def test_allow_list_lets_only_the_probes_of_the_router_pass() -> None:
    quay = budgeted()
    host = quay.declaration.hosts["coastal-router"]
    view = router_view(quay.declaration, host)
    walk = Walk(rsc.parse(router(quay.declaration, host), host.name))
    port, own = view.uplinks[0].port, view.uplinks[0].address
    for canary in CANARIES:
        ping = Packet(own, canary, out_interface=port, protocol="icmp")
        assert walk.accepts("output", ping)
        assert not walk.accepts("output", replace(ping, protocol="udp", dst_port=53))
        assert not walk.accepts("forward", replace(ping, src="10.64.1.21", in_interface=view.bridge))
        answer = Packet(canary, own, in_interface=port, protocol="icmp", state="established")
        assert walk.accepts("input", answer)
        assert not walk.accepts("input", replace(answer, state="new"))
    assert not walk.accepts("output", Packet(own, "198.51.100.43", out_interface=port, protocol="icmp"))
