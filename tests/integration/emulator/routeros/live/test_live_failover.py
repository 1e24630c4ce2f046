"""Fail-over of an attached router by real probes: what the default route of its namespace is."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from live_stage import PROBE_TARGETS, LiveStage, live_site

from atlantis_netcfg.emulator.routeros.dataplane.live import PacketProbe

pytestmark = [
    pytest.mark.namespace,
    pytest.mark.skipif(os.geteuid() != 0, reason="making a network namespace needs root"),
]


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[LiveStage]:
    with live_site(tmp_path) as made:
        yield made


def leads_to_nothing(stage: LiveStage, address: str) -> bool:
    return stage.run("router", "ip", "route", "show", address).startswith("blackhole")


def test_silent_probe_targets_move_the_default_route_and_answers_return_it(stage: LiveStage) -> None:
    stage.wait(60)
    assert stage.way_out() == "ether1"
    flow = "-p udp -s 10.10.0.2 -d 8.8.8.8 --sport 5000 --dport 5001 -t 600"
    stage.run("router", "conntrack", "-I", *flow.split())
    stage.silence("wifi-ptp", *PROBE_TARGETS["wifi-ptp"])
    stage.wait(15)
    assert stage.way_out() == "ether1"
    assert stage.connections("8.8.8.8:5001") == ["10.10.0.2:5000"]
    stage.wait(20)
    assert stage.way_out() == "ether2"
    assert stage.connections("8.8.8.8:5001") == []
    stage.silence("wifi-ptp")
    stage.wait(100)
    assert stage.way_out() == "ether2"
    stage.wait(40)
    assert stage.way_out() == "ether1"
    assert [row for row in stage.rows("/log/print") if row["topics"] == "script,error"] == []


def test_one_silent_probe_target_moves_nothing(stage: LiveStage) -> None:
    stage.wait(60)
    stage.silence("wifi-ptp", PROBE_TARGETS["wifi-ptp"][0])
    stage.wait(60)
    assert stage.way_out() == "ether1"


def test_check_gateway_leaves_a_next_hop_that_is_cut_off(stage: LiveStage) -> None:
    (target, _) = PROBE_TARGETS["4g"]
    stage.wait(60)
    assert stage.way_out(target) == "ether2"
    stage.run("4g", *["ip", "link", "set", "near", "down"])
    stage.wait(9)
    assert not leads_to_nothing(stage, target)
    stage.wait(20)
    assert leads_to_nothing(stage, target)
    stage.run("4g", *["ip", "link", "set", "near", "up"])
    stage.wait(15)
    assert stage.way_out(target) == "ether2"


@pytest.mark.parametrize(("arrival_s", "is_response"), [(0.9, True), (4.1, False)])
def test_answer_after_the_timeout_does_not_count_whenever_it_is_read(arrival_s: float, is_response: bool) -> None:  # noqa: FBT001 - a case
    probe = PacketProbe(lambda _end: (arrival_s, 64), sent_at=0.0, end=1.0)
    assert probe.has_response(0.0) is is_response
    assert probe.response == ((arrival_s, 64) if is_response else None)
