"""A satellite that stands before other links: declared, watched at this end alone, left when its terminal is dead."""

from __future__ import annotations

import shutil
from dataclasses import replace
from typing import TYPE_CHECKING

import yaml
from quay_world import INVENTORY, World, shipped

from atlantis_netcfg.declaration import load

if TYPE_CHECKING:
    from pathlib import Path

TERMINAL = "10.10.2.1"


def first() -> World:
    given = shipped()
    site = given.sites["coastal"]
    wifi, lte, satellite = site.bearers
    changed = site.model_copy(update={"bearers": (satellite, wifi, lte)})
    made = World("coastal", declaration=replace(given, sites={**given.sites, "coastal": changed}))
    made.passes(60)
    return made


def test_such_an_order_is_valid(tmp_path: Path) -> None:
    root = tmp_path / "inventory"
    shutil.copytree(INVENTORY, root)
    path = root / "group_vars" / "te4sea.yml"
    declared = yaml.safe_load(path.read_text(encoding="utf-8"))
    declared["site"]["bearers"].reverse()
    del declared["site"]["failover"]["metered_probe_s"]
    path.write_text(yaml.safe_dump(declared), encoding="utf-8")
    assert [bearer.name for bearer in load(root).sites["te4sea"].bearers] == ["satellite", "4g"]


def test_it_carries_the_traffic_until_its_terminal_is_dead() -> None:
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


def test_nothing_is_sent_over_it() -> None:
    quay = first()
    asked = {row["host"] for row in quay.rows("/tool/netwatch")}
    assert asked == set(quay.canaries("wifi-ptp"))  # 4g is the last one now
    (route,) = [row for row in quay.rows("/ip/route") if row.get("comment") == "atlantis: satellite, not probed"]
    assert (route["check-gateway"], route["distance"]) == ("arp", "10")
