from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.emulator.routeros import ControlError, RunningSite
from atlantis_netcfg.emulator.routeros.answers import Answer
from atlantis_netcfg.emulator.routeros.certificates import issue
from atlantis_netcfg.emulator.routeros.device import Device
from atlantis_netcfg.emulator.routeros.environment import update_surroundings
from atlantis_netcfg.emulator.routeros.spec import (
    DiscoveryNeighbour,
    EmulatorSpec,
    Environment,
    Load,
    RouterSpec,
    SiteSpec,
    User,
    Validity,
)

CLOCK = datetime(2026, 11, 22, 10, 0, tzinfo=UTC)
SEED = """
/interface bridge
add name=bridge-lan
/interface bridge port
add bridge=bridge-lan interface=ether4
/ip address
add address=10.64.1.1/24 interface=bridge-lan
/ip dhcp-server
add interface=bridge-lan name=dhcp-lan disabled=no
/ip dhcp-server lease
add address=10.64.1.23 mac-address=02:00:5E:00:01:23 server=dhcp-lan
add address=10.64.1.24 mac-address=02:00:5E:00:01:24 server=dhcp-lan
/interface ovpn-client
add connect-to=vpn.example.org name=ovpn-scc user=router disabled=no certificate=atlantis-vpn
/system ntp client
set enabled=yes
/system ntp client servers
add address=192.0.2.123
"""


class Box:
    def __init__(self, **around: Any) -> None:  # noqa: ANN401 - fields of Around
        spec = RouterSpec(
            name="box",
            users=(User(name="provision"),),
            certificates=("atlantis-api", "atlantis-vpn"),
            clock=CLOCK,
            poe_ports=("ether1", "ether2"),
            around=Environment(**around),
            seed=SEED,
        )
        self.device = Device(spec, lambda: 1000.0)
        self.device.give_certificate(
            "atlantis-vpn", issue({"common-name": "EXAMPLE", "key-size": "prime256v1"}, now=CLOCK)
        )
        self.caller = self.device.login("provision", "", via="api-ssl", address="10.64.101.10")

    def run(self, *words: str) -> list[Answer]:
        return self.device.run(self.caller, list(words))

    def rows(self, *words: str) -> list[dict[str, str]]:
        told = self.run(*words)
        assert told[-1].kind == "!done", told[-1].words
        return [dict(word[1:].partition("=")[::2] for word in one.words) for one in told if one.kind == "!re"]

    def trap(self, *words: str) -> str:
        return next(word for one in self.run(*words) if one.kind == "!trap" for word in one.words if "message" in word)

    def poe(self, ports: str) -> list[dict[str, str]]:
        return self.rows("/interface/ethernet/poe/monitor", f"=numbers={ports}", "=once=")


def test_surroundings_are_empty_by_default() -> None:
    box = Box()
    assert box.rows("/ip/neighbor/print") == []
    assert {row["status"] for row in box.rows("/ip/dhcp-server/lease/print")} == {"waiting"}
    assert [row["running"] for row in box.rows("/interface/ovpn-client/print")] == ["false"]
    assert [row["status"] for row in box.rows("/system/ntp/client/print")] == ["waiting"]
    assert [row["poe-out-status"] for row in box.poe("ether1,ether2")] == ["waiting-for-load"] * 2
    assert len(box.rows("/ip/address/print")) == 2


def test_network_cards_answer_ping_and_arp_with_their_own_mac() -> None:
    box = Box(cards={"10.64.1.23": "02:00:5e:00:01:23", "192.168.2.2": "02:00:5E:00:AA:01"})
    arp = {row["address"]: (row["mac-address"], row["interface"]) for row in box.rows("/ip/arp/print")}
    assert arp == {"10.64.1.23": ("02:00:5E:00:01:23", "bridge-lan")}
    assert box.rows("/ping", "=address=10.64.1.23", "=count=1")[0]["received"] == "1"
    words = ("=address=192.168.2.2", "=arp-ping=yes", "=interface=bridge-lan", "=count=1")
    assert box.rows("/tool/ping", *words)[0]["received"] == "1"


def test_poe_status_follows_load_and_setting() -> None:
    box = Box(loads={"ether1": Load(milliamps=224, volts=23.2), "ether2": Load(status="short-circuit")})
    first = {"name": "ether1", "poe-out": "auto-on", "poe-out-status": "powered-on"}
    figures = {"poe-out-voltage": "23.2V", "poe-out-current": "224mA", "poe-out-power": "5.2W"}
    assert box.poe("ether1,ether2") == [
        {**first, **figures},
        {"name": "ether2", "poe-out": "auto-on", "poe-out-status": "short-circuit"},
    ]
    box.rows("/interface/ethernet/set", "=.id=ether1", "=poe-out=off")
    assert box.poe("ether1") == [{"name": "ether1", "poe-out": "off", "poe-out-status": "off"}]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("=numbers=ether3", "=once="), "no such item"),
        (("=numbers=nope", "=once="), "no such item"),
        (("=numbers=ether1",), "not rehearsed by the twin: /interface/ethernet/poe/monitor without once"),
        (("=once=",), "missing =numbers="),
        (("=numbers=ether1", "=once=", "=nonsense=1"), "unknown parameter nonsense"),
    ],
    ids=("a port that cannot feed", "no port", "without once", "without ports", "an unknown word"),
)
def test_poe_monitor_rejects_invalid_arguments(words: tuple[str, ...], message: str) -> None:
    assert message in Box().trap("/interface/ethernet/poe/monitor", *words)


def test_a_connected_tunnel_has_an_address_and_runs() -> None:
    box = Box(tunnels={"ovpn-scc": "10.80.0.11/16"})
    assert [row["running"] for row in box.rows("/interface/ovpn-client/print")] == ["true"]
    made = [row for row in box.rows("/ip/address/print") if row.get("interface") == "ovpn-scc"]
    assert [(row["address"], row["network"], row["dynamic"]) for row in made] == [
        ("10.80.0.11/16", "10.80.0.0", "true")
    ]
    box.rows("/interface/ovpn-client/set", "=.id=ovpn-scc", "=disabled=yes")
    assert [row["running"] for row in box.rows("/interface/ovpn-client/print")] == ["false"]
    assert len(box.rows("/ip/address/print")) == 2


def test_dhcp_leases_and_ntp_status() -> None:
    box = Box(leases={"10.64.1.23": "bound", "10.64.1.24": "busy"}, time_server="192.0.2.123")
    bound, busy = box.rows("/ip/dhcp-server/lease/print")
    assert (bound["status"], bound["active-mac-address"], bound["active-server"]) == (
        "bound",
        "02:00:5E:00:01:23",
        "dhcp-lan",
    )
    assert (busy["status"], "active-address" in busy) == ("busy", False)
    assert box.rows("/system/ntp/client/print")[0]["status"] == "synchronized"
    box.rows("/system/ntp/client/set", "=enabled=no")
    assert box.rows("/system/ntp/client/print")[0]["status"] == "stopped"
    assert Box(time_server="192.0.2.9").rows("/system/ntp/client/print")[0]["status"] == "waiting"


def test_neighbours_are_seen_on_discovery_interfaces() -> None:
    box = Box(
        called=(
            DiscoveryNeighbour(
                identity="MikroTik", interface="bridge-lan", mac="02:00:5e:00:aa:02", address="10.64.1.77"
            ),
        )
    )
    (row,) = box.rows("/ip/neighbor/print")
    assert (row["identity"], row["mac-address"], row["address"]) == ("MikroTik", "02:00:5E:00:AA:02", "10.64.1.77")
    box.rows("/ip/neighbor/discovery-settings/set", "=discover-interface-list=none")
    assert box.rows("/ip/neighbor/print") == []
    box.rows("/ip/neighbor/discovery-settings/set", "=discover-interface-list=!none")
    assert len(box.rows("/ip/neighbor/print")) == 1
    assert (
        Box(called=(DiscoveryNeighbour(identity="x", interface="nope", mac="02:00:5E:00:AA:02"),)).rows(
            "/ip/neighbor/print"
        )
        == []
    )


def test_dhcp_alert_reports_unknown_servers() -> None:
    box = Box(dhcp_servers={"bridge-lan": ("02:00:5e:00:aa:03", "02:00:5E:00:AA:04")})
    words = ("=interface=bridge-lan", "=valid-server=02:00:5E:00:AA:04", "=disabled=no")
    box.run("/ip/dhcp-server/alert/add", *words)
    (row,) = box.rows("/ip/dhcp-server/alert/print")
    assert row["unknown-server"] == "02:00:5E:00:AA:03"
    box.rows("/ip/dhcp-server/alert/set", f"=.id={row['.id']}", "=disabled=yes")
    assert "unknown-server" not in box.rows("/ip/dhcp-server/alert/print")[0]


def test_certificate_validity_dates() -> None:
    since, until = CLOCK - timedelta(days=400), CLOCK - timedelta(days=1)
    box = Box(validity={"atlantis-vpn": Validity(since=since, until=until)})
    rows = {row["name"]: row for row in box.rows("/certificate/print")}
    assert rows["atlantis-vpn"]["invalid-after"] == "2026-11-21 10:00:00"
    assert rows["atlantis-vpn"]["expired"] == "true"
    assert "invalid-after" not in rows["atlantis-api"]


def test_surroundings_can_change_while_router_runs() -> None:
    box = Box(loads={"ether1": Load()}, tunnels={"ovpn-scc": "10.80.0.11/16"})
    assert update_surroundings(box.device.core, {"tunnels": {}})["tunnels"] == {}
    assert box.rows("/interface/ovpn-client/print")[0]["running"] == "false"
    assert box.poe("ether1")[0]["poe-out-status"] == "powered-on"
    for nonsense in ({"moods": 1}, {"tunnels": {"ovpn-scc": "nowhere"}}):
        with pytest.raises(ValueError, match="validation error"):
            update_surroundings(box.device.core, nonsense)


def test_site_control_changes_surroundings(tmp_path: Path) -> None:
    with RunningSite(SiteSpec(name="site", emulators=(EmulatorSpec(router=RouterSpec(name="box")),)), tmp_path) as site:
        told = site.do("box", "around", leases={"10.64.1.23": "bound"})
        assert told["leases"] == {"10.64.1.23": "bound"}
        with pytest.raises(ControlError, match="Extra inputs are not permitted"):
            site.do("box", "around", moods=1)
