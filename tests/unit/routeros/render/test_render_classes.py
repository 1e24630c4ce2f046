"""Classes of traffic: who is marked, ahead of what, and the share of each queue on a thin link."""

import pytest
from render_declared import Declaration, declaration, with_site

from atlantis_netcfg.inventory.model import TrafficClass
from atlantis_netcfg.routeros import rsc
from atlantis_netcfg.routeros.render import router, router_view

DECLARED = declaration()


def classed(site: str = "coastal", **traffic: TrafficClass) -> Declaration:
    lan = DECLARED.sites[site].lan
    rows = tuple(row.model_copy(update={"traffic": traffic.get(row.name, row.traffic)}) for row in lan.reservations)
    return with_site(DECLARED, site, lan=lan.model_copy(update={"reservations": rows}))


def rows(declared: Declaration, menu: str, site: str = "coastal") -> list[dict[str, str]]:
    export = rsc.parse(router(declared, declared.router(site)))
    return [
        {name: value or "" for name, value in row.values}
        for row in export.statements
        if row.menu == menu and row.verb == "add"
    ]


def test_site_without_classes_is_unchanged() -> None:
    assert router(classed(), DECLARED.router("coastal")) == router(DECLARED, DECLARED.router("coastal"))
    assert [row["name"] for row in rows(DECLARED, "/queue/tree")] == [
        "satellite",
        "satellite-control",
        "satellite-rest",
    ]


def test_device_traffic_is_marked_before_the_tunnel() -> None:
    """Its own tunnel goes to the same address and port as the gateway's, which is control."""
    marks = [row for row in rows(classed(zarco=TrafficClass.IMAGES), "/ip/firewall/mangle") if "new-packet-mark" in row]
    assert [row["new-packet-mark"] for row in marks] == ["images", "control", "control"]
    assert marks[0] == {
        "action": "mark-packet",
        "chain": "postrouting",
        "comment": "atlantis: satellite, images of zarco",
        "new-packet-mark": "images",
        "out-interface": "ether3",
        "passthrough": "no",
        "src-address": "10.64.1.23",
    }


def test_queues_are_ordered_and_guarantee_less_than_the_link_rate() -> None:
    declared = classed(zarco=TrafficClass.BULK, stork=TrafficClass.IMAGES, sparus=TrafficClass.TELEMETRY)
    whole, *queues = rows(declared, "/queue/tree")
    assert [(row["packet-mark"], row["priority"]) for row in queues] == [
        ("control", "1"),
        ("telemetry", "3"),
        ("images", "5"),
        ("bulk", "7"),
        ("no-mark", "8"),
    ]
    assert sum(int(row["limit-at"]) for row in queues) < int(whole["max-limit"]) == 352_000 * 4 // 5
    assert {(row["parent"], row["max-limit"]) for row in queues} == {("satellite", whole["max-limit"])}


def test_only_classes_that_are_in_use_have_a_queue() -> None:
    view = router_view(classed(zarco=TrafficClass.BULK, stork=TrafficClass.BULK), DECLARED.router("coastal"))
    assert [(item.name, [host.name for host in item.hosts]) for item in view.classes] == [("bulk", ["zarco", "stork"])]


@pytest.mark.parametrize(("up_kbps", "thin"), [(1999.0, True), (2000.0, False)])
def test_a_slow_link_is_thin(up_kbps: float, thin: bool) -> None:  # noqa: FBT001 - a parameter of pytest
    bearer = DECLARED.sites["coastal"].bearers[1]
    slow = bearer.model_copy(update={"rate": bearer.rate.model_copy(update={"up_kbps": up_kbps})})
    assert (bearer.thin, slow.thin) == (False, thin)


def test_a_fast_site_has_no_queue() -> None:
    assert rows(classed("scc", **{"scc-control": TrafficClass.BULK}), "/queue/tree", "scc") == []
