"""Who talks to whom all the time, by the declaration: each source, each bearer, each site; and the budgets."""

from dataclasses import replace
from ipaddress import IPv4Address
from pathlib import Path

import pytest

from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import (
    Billing,
    Dds,
    DdsPath,
    DdsPeer,
    RosDistribution,
    TelemetryData,
    TelemetryTopic,
)
from atlantis_netcfg.links.standing_traffic import DAY_S, StandingFlow, TrafficSource
from atlantis_netcfg.operations.common.traffic_budget import inventory_warnings, over_budget, standing_traffic

SHIPPED = Path(__file__).parents[4] / "inventory"
_SENT, _REFUSED = 11 * 536 * DAY_S / 20, 6 * 564 * DAY_S / 20
"""Of one process of Fast DDS, to a computer whose other nine ports are closed, through the VPN."""
FLOOR = Billing(price_per_mb=8.0, min_session_bytes=5000, floor_bytes_per_s=300, floor_after_s=300)
_DAILY, _HOURLY = 2500, 24 * 2500
"""New keys, in one direction: of gateways and computers, and of a router."""
_PINGS = 68 * DAY_S / 170


@pytest.fixture(scope="module")
def shipped() -> Inventory:
    return load(SHIPPED)


@pytest.fixture(scope="module")
def pilot(shipped: Inventory) -> Inventory:
    """The shipped one without telemetry, and DDS crosses every link."""
    vehicles = {name: each.model_copy(update={"telemetry": ()}) for name, each in shipped.vehicles.items()}
    return crossing(replace(shipped, vehicles=vehicles), "wifi-ptp", "4g", "satellite")


def crossing(pilot: Inventory, *links: str) -> Inventory:
    """DDS crosses these links of the two sites, and no other."""
    sites = {
        name: site.model_copy(
            update={
                "bearers": tuple(each.model_copy(update={"dds": each.name in links}) for each in site.bearers),
            }
        )
        if name != "scc"
        else site
        for name, site in pilot.sites.items()
    }
    return replace(pilot, sites=sites)


def with_dds(pilot: Inventory, **more: object) -> Inventory:
    dds = Dds.model_validate({"distribution": RosDistribution.HUMBLE, **more})
    return replace(pilot, pilot=pilot.pilot.model_copy(update={"dds": dds}))


def flows(pilot: Inventory, site: str, bearer: str) -> dict[TrafficSource, StandingFlow]:
    (traffic,) = (one for one in standing_traffic(pilot, site) if one.link.name == bearer)
    return {flow.source: flow for flow in traffic.flows}


def test_standing_traffic_over_a_satellite(pilot: Inventory) -> None:
    found = flows(pilot, "coastal", "satellite")
    assert list(found) == [TrafficSource.TIME, TrafficSource.VPN, TrafficSource.DDS]
    assert found[TrafficSource.DDS].up == found[TrafficSource.DDS].down == pytest.approx(_SENT + _REFUSED)
    # The router's tunnel is quiet and sends pings; the gateway's has announcements instead.
    assert found[TrafficSource.VPN].up == pytest.approx(_PINGS + _HOURLY + _DAILY)
    assert found[TrafficSource.TIME].both == pytest.approx(2 * 2 * 2 * 76 * DAY_S / 1024)


def test_no_dds_over_a_metered_satellite(shipped: Inventory) -> None:
    """By itself, because it is metered. Its tunnels send pings, and nothing of a vehicle crosses it either."""
    topic = TelemetryTopic(topic="/pose", data=TelemetryData.NUMBERS, rate_hz=2.0, size_bytes=120)
    sparus = shipped.vehicles["sparus"].model_copy(update={"telemetry": (topic,)})
    declared = replace(shipped, vehicles={**shipped.vehicles, "sparus": sparus})
    found = flows(declared, "coastal", "satellite")
    assert list(found) == [TrafficSource.TIME, TrafficSource.VPN]
    assert found[TrafficSource.VPN].up == pytest.approx(2 * _PINGS + _HOURLY + _DAILY)
    assert TrafficSource.TELEMETRY in flows(declared, "coastal", "wifi-ptp")


def test_centre_receives_announcements_over_links_open_to_dds(pilot: Inventory) -> None:
    """Over a link that DDS may cross, of a site that has another one: what it sends finds a listener each time."""
    heard = 536 * DAY_S / 20
    found = flows(crossing(pilot, "wifi-ptp"), "coastal", "wifi-ptp")[TrafficSource.DDS]
    assert (found.up, found.down) == pytest.approx((_SENT, heard + _REFUSED))
    there = flows(crossing(pilot, "wifi-ptp", "4g"), "scc", "uplink")[TrafficSource.DDS]
    assert (there.up, there.down) == pytest.approx((2 * (heard + _REFUSED), 2 * _SENT))


def test_foreign_tunnel_crosses_every_link(shipped: Inventory) -> None:
    """A robot's own computer announces itself to the centre and to the gateway, whose answers are kept off."""
    peers = (DdsPeer(name="sparus-onboard", address=IPv4Address("10.80.17.5"), site="coastal"),)
    pair = _SENT + _REFUSED
    found = flows(with_dds(shipped, peers=peers), "coastal", "satellite")[TrafficSource.DDS]
    assert (found.up, found.down) == pytest.approx((2 * pair, 2 * pair))
    over_lan = flows(with_dds(shipped, over=DdsPath.LAN), "coastal", "satellite")[TrafficSource.DDS]
    assert over_lan.up == pytest.approx(pair)


def test_probe_targets_are_pinged_over_every_link_that_has_them(pilot: Inventory) -> None:
    """docs/links.md has the same figures: 8.7 MB a day, and 0.97."""
    found = {one.link.name: one.idle_day_bytes for one in standing_traffic(pilot, "coastal")}
    assert found == {"wifi-ptp": 8_709_120, "4g": 967_680, "satellite": 0}


def test_dds_profile_of_the_slowest_link_applies_to_every_link(pilot: Inventory) -> None:
    assert (
        flows(pilot, "coastal", "wifi-ptp")[TrafficSource.DDS]
        == flows(pilot, "coastal", "satellite")[TrafficSource.DDS]
    )


def test_without_dds_every_tunnel_sends_pings(pilot: Inventory) -> None:
    bare = replace(pilot, pilot=pilot.pilot.model_copy(update={"dds": None}))
    found = flows(bare, "coastal", "satellite")
    assert list(found) == [TrafficSource.TIME, TrafficSource.VPN]
    assert found[TrafficSource.VPN].up == pytest.approx(2 * _PINGS + _HOURLY + _DAILY)


def test_server_site_carries_the_traffic_of_all_sites(pilot: Inventory) -> None:
    found = flows(pilot, "scc", "uplink")
    there = [flows(pilot, site, "satellite")[TrafficSource.DDS] for site in ("coastal", "te4sea")]
    assert found[TrafficSource.DDS].down == pytest.approx(sum(flow.up for flow in there))
    assert TrafficSource.CANARIES not in found


def test_computers_of_one_site_communicate_through_the_server(pilot: Inventory) -> None:
    """A robot's own computer: to the centre and back, and with the gateway both ways twice; it has its own tunnel."""
    peers = (DdsPeer(name="sparus-onboard", address=IPv4Address("10.80.17.5"), site="coastal"),)
    alone, together = with_dds(pilot), with_dds(pilot, peers=peers)
    before, after = (flows(one, "coastal", "satellite") for one in (alone, together))
    pair = _SENT + _REFUSED
    assert after[TrafficSource.DDS].up - before[TrafficSource.DDS].up == pytest.approx(3 * pair)
    assert after[TrafficSource.DDS].down - before[TrafficSource.DDS].down == pytest.approx(3 * pair)
    assert after[TrafficSource.VPN].up - before[TrafficSource.VPN].up == pytest.approx(_DAILY)


def test_dds_over_the_lan_uses_the_tunnel_of_the_router(pilot: Inventory) -> None:
    found = flows(with_dds(pilot, over=DdsPath.LAN), "coastal", "satellite")
    assert found[TrafficSource.DDS].up == pytest.approx(_SENT + _REFUSED)
    assert found[TrafficSource.VPN].up == pytest.approx(
        _PINGS + _HOURLY + _DAILY
    )  # now it is the gateway's that is quiet


def test_dds_processes_announce_to_each_other(pilot: Inventory) -> None:
    found = flows(with_dds(pilot, processes=10), "coastal", "satellite")[TrafficSource.DDS]
    assert found.up == pytest.approx(10 * 20 * 536 * DAY_S / 20)


def test_telemetry_counts_only_vehicles_tested_at_the_site(pilot: Inventory) -> None:
    topic = TelemetryTopic(topic="/pose", data=TelemetryData.NUMBERS, rate_hz=2.0, size_bytes=120)
    sparus = pilot.vehicles["sparus"].model_copy(update={"telemetry": (topic,)})
    declared = replace(pilot, vehicles={**pilot.vehicles, "sparus": sparus})
    expected = StandingFlow(TrafficSource.TELEMETRY, 2 * (160 + 52 + 120) * DAY_S, 0)
    assert flows(declared, "coastal", "satellite")[TrafficSource.TELEMETRY] == expected
    coastal = declared.sites["coastal"]
    without = coastal.model_copy(update={"checklist": coastal.checklist.model_copy(update={"vehicles": ("zarco",)})})
    elsewhere = replace(declared, sites={**declared.sites, "coastal": without})
    assert TrafficSource.TELEMETRY not in flows(elsewhere, "coastal", "satellite")


def test_metered_link_without_a_budget_is_a_warning(pilot: Inventory) -> None:
    satellite = pilot.sites["coastal"].bearers[2].model_copy(update={"standing_budget_eur": None})
    found = over_budget(satellite, standing_traffic(pilot, "coastal")[2])
    assert found is not None
    assert (found.verdict, found.code) == (Verdict.WARN, "no-standing-budget")
    assert found.message == (
        "no budget in the inventory for background traffic over satellite: 2412.7 MB a month (19301.91 EUR)"
    )
    assert over_budget(pilot.sites["coastal"].bearers[0], standing_traffic(pilot, "coastal")[0]) is None


def test_the_shipped_links_keep_to_their_budgets(shipped: Inventory, monkeypatch: pytest.MonkeyPatch) -> None:
    """The routers' own tunnels are the dear part: nobody knows how often RouterOS renews its keys."""
    assert inventory_warnings(shipped) == ()

    def prices() -> list[float]:
        found = [one for site in ("coastal", "te4sea") for one in standing_traffic(shipped, site)]
        return [float(one.bill.price) for one in found if one.link.name == "satellite" and one.bill.price is not None]

    assert [price < 80 for price in prices()] == [True, True]
    monkeypatch.setattr("atlantis_netcfg.vpn.identity.ROUTEROS_RENEGOTIATION_S", DAY_S)
    assert [price < 50 for price in prices()] == [True, True]


@pytest.mark.parametrize(
    ("budget", "words"),
    [
        ({"standing_budget_mb": 2500.0}, None),
        ({"standing_budget_eur": 20000.0}, None),
        ({"standing_budget_mb": 2400.0}, "2400 MB (`standing_budget_mb`)"),
        ({"standing_budget_eur": 136.0}, "136 EUR (`standing_budget_eur`)"),
    ],
)
def test_exceeded_budget_is_a_warning(pilot: Inventory, budget: dict[str, float], words: str | None) -> None:
    coastal = pilot.sites["coastal"]
    bearers = [
        *coastal.bearers[:2],
        coastal.bearers[2].model_copy(update={"standing_budget_eur": None, "billing": FLOOR, **budget}),
    ]
    changed = coastal.model_copy(update={"bearers": tuple(bearers)})
    kept = crossing(pilot, "wifi-ptp", "4g").sites["te4sea"]
    declared = replace(pilot, sites={**pilot.sites, "coastal": changed, "te4sea": kept})
    found = over_budget(bearers[2], standing_traffic(declared, "coastal")[2])
    assert (found is None) == (words is None)
    assert len(inventory_warnings(declared)) == (found is not None)
    if found is not None:
        assert (found.verdict, found.code) == (Verdict.WARN, "standing-over-budget")
        assert found.message == (
            f"2412.7 MB of background traffic a month over satellite (19301.91 EUR) exceeds its budget of {words}"
        )
