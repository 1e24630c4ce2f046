"""Both ends of a bridge are judged, each told the other one's hardware address; and names of the allow-list."""

import asyncio
from collections.abc import Iterable, Mapping
from pathlib import Path

import pytest

from atlantis_netcfg.inventory import load
from atlantis_netcfg.links import LinkState
from atlantis_netcfg.links.wifi import Family, read
from atlantis_netcfg.operations.links import collect as looking
from atlantis_netcfg.operations.links.status import BoxesStatus, RadioLook, Silent, of_bridge

DECLARATION = load(Path(__file__).resolve().parents[4] / "inventory")
NEAR, FAR = DECLARATION.hosts["coastal-cpe"], DECLARATION.hosts["scc-cpe"]
MACS = {"near": "02:00:5E:00:00:01", "far": "02:00:5E:00:00:02", "other": "02:00:5E:00:00:03"}


def radio(mine: str, heard: str | None, level: int = -50) -> RadioLook:
    """A radio that hears somebody, or nobody."""
    rows = [] if heard is None else [{"interface": "wlan1", "mac-address": MACS[heard], "signal-strength": str(level)}]
    access_point = mine == "far"
    word = "running-ap" if access_point else "connected-to-ess" if heard else "searching-for-network"
    return RadioLook(read(Family.WIRELESS, rows, {"status": word}, "wlan1"), MACS[mine])


def codes(own: BoxesStatus) -> list[str]:
    return [f"{one.message.partition(':')[0]} {one.code}" for one in own.findings]


def test_both_radios_are_registered_with_each_other() -> None:
    own = of_bridge((NEAR, radio("near", "far", -50)), (FAR, radio("far", "near", -52)))
    assert (own.state, codes(own), own.silent) == (LinkState.UP, [], ())
    assert (own.quality["signal_dbm"], own.quality["far_signal_dbm"]) == (-50.0, -52.0)


def test_strong_signal_at_the_far_end_is_reported_there() -> None:
    own = of_bridge((NEAR, radio("near", "far", -50)), (FAR, radio("far", "near", -20)))
    assert codes(own) == ["scc-cpe signal-strong"]


def test_wrong_peer_is_reported() -> None:
    own = of_bridge((NEAR, radio("near", "other")), (FAR, radio("far", None)))
    assert codes(own) == ["coastal-cpe wrong-peer", "scc-cpe not-associated"]
    assert own.state is LinkState.SEARCHING


def test_peer_is_not_judged_while_the_far_end_is_silent() -> None:
    silent = Silent("scc-cpe", "no response")
    own = of_bridge((NEAR, radio("near", "other")), (FAR, silent))
    assert (own.state, codes(own), own.silent) == (LinkState.UP, [], (silent,))
    assert "far_signal_dbm" not in own.quality


def test_silent_far_end_of_a_down_bridge_is_inconclusive() -> None:
    own = of_bridge((NEAR, radio("near", None)), (FAR, Silent("scc-cpe", "no response", "has it power?")))
    assert [f"{one.verdict.value} {one.code}" for one in own.findings] == [
        "FAIL not-associated",
        "INCONCLUSIVE far-end-unreachable",
    ]
    assert own.silent == ()


def test_silent_near_end_shows_only_the_far_signal() -> None:
    own = of_bridge((NEAR, Silent("coastal-cpe", "no response")), (FAR, radio("far", "near", -52)))
    assert own.quality == {"far_signal_dbm": -52.0}
    assert own.state is LinkState.UP


def test_a_device_without_a_radio_is_down() -> None:
    own = of_bridge((NEAR, RadioLook(None)), (FAR, None))
    assert (own.state, codes(own)) == (LinkState.DOWN, ["coastal-cpe no-radio"])


def test_unqueried_bridge_has_an_empty_status() -> None:
    assert of_bridge((NEAR, None), (FAR, None)) == BoxesStatus()


def test_moved_allow_list_name_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    async def moved(names: Iterable[str]) -> Mapping[str, frozenset[str] | None]:
        return {name: frozenset({"203.0.113.99"}) for name in names}

    monkeypatch.setattr(looking, "resolve", moved)
    found = asyncio.run(looking._names(DECLARATION, "coastal"))
    assert {one.code for one in found["satellite"]} == {"allow-list-name-moved"}
    assert found["wifi-ptp"] == ()
