"""What a router twin says of its ports: their links, and whom its bridge has heard on them."""

import pytest
from test_twin_around import Box


def test_monitor_shows_rate_of_ports_with_link() -> None:
    box = Box()
    box.run("/interface/ethernet/disable", "=numbers=ether3")
    up, down = box.rows("/interface/ethernet/monitor", "=numbers=ether4,ether3", "=once=")
    assert (up["name"], up["status"], up["rate"], up["full-duplex"]) == ("ether4", "link-ok", "1Gbps", "yes")
    assert (down["name"], down["status"]) == ("ether3", "no-link")
    assert "rate" not in down


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("=numbers=ether99", "=once="), "no such item"),
        (("=once=",), "missing =numbers="),
        (("=numbers=ether1", "=nonsense=1"), "unknown parameter nonsense"),
        (("=numbers=ether1",), "not rehearsed by the twin: /interface/ethernet/monitor without once"),
    ],
)
def test_monitor_errors_match_those_of_a_router(words: tuple[str, ...], message: str) -> None:
    assert message in Box().trap("/interface/ethernet/monitor", *words)


def test_bridge_lists_learned_hosts_per_port() -> None:
    box = Box(plugged={"ether4": ("02:00:5e:00:01:23",), "ether5": ("02:00:5E:00:01:24",)})
    rows = box.rows("/interface/bridge/host/print")
    heard = [(row["mac-address"], row["on-interface"], row["bridge"]) for row in rows if row["local"] == "false"]
    assert heard == [("02:00:5E:00:01:23", "ether4", "bridge-lan")]
    assert [row["on-interface"] for row in rows if row["local"] == "true"] == ["ether4"]


def test_disabled_port_learns_no_hosts() -> None:
    box = Box(plugged={"ether4": ("02:00:5E:00:01:23",)})
    box.run("/interface/ethernet/disable", "=numbers=ether4")
    assert box.rows("/interface/bridge/host/print") == []
