"""The text of a switch, and what its site's router has for it."""

from dataclasses import replace
from ipaddress import IPv4Network
from typing import TYPE_CHECKING, Any

import pytest
from render_declared import Declaration, Host, declaration, with_site

from atlantis_netcfg.inventory.model import Switch
from atlantis_netcfg.routeros import rsc
from atlantis_netcfg.routeros.render import RenderError, router, switch

if TYPE_CHECKING:
    from atlantis_netcfg.routeros.rsc import Export

RADIO = {
    "ssid": "EXAMPLE-BUOY",
    "standard": "802.11ax",
    "band": "5ghz",
    "frequency_mhz": 5580,
    "country": "portugal",
    "key": "EXAMPLE-buoy-key",
}


def with_switch(site: str = "coastal", **changes: Any) -> tuple[Declaration, Host]:  # noqa: ANN401 - keys of a device
    given = declaration()
    lan = given.sites[site].lan
    device = {
        "kind": "switch",
        "access": {"address": str(lan.gateway + 4), "password": "EXAMPLE-switch"},
        "ports": [
            {"name": "ether1", "use": "uplink"},
            {"name": "ether2", "use": "lan"},
            {"name": "ether3", "use": "lan", "isolated": True, "poe": {"out": "forced-on", "priority": 3}},
            {"name": "ether4", "use": "off"},
        ],
        **changes,
    }
    host = Host("a-switch", site, Switch.model_validate(device))
    return replace(given, hosts={**given.hosts, host.name: host}), host


def rows(text: str, menu: str) -> list[dict[str, str | None]]:
    export: Export = rsc.parse(text, "a text")
    return [dict(item.values) for item in export.statements if item.menu == "/" + menu[1:].replace(" ", "/")]


def test_isolated_ports_share_a_bridge_horizon() -> None:
    bridged = rows(switch(*with_switch()), "/interface bridge port")
    assert [(row["interface"], row.get("horizon")) for row in bridged] == [
        ("ether1", None),
        ("ether2", None),
        ("ether3", "1"),
    ]
    assert {row["bridge"] for row in bridged} == {"bridge-lan"}


def test_poe_and_disabled_ports_are_rendered() -> None:
    ports = {row["name"]: row for row in rows(switch(*with_switch()), "/interface ethernet")}
    assert (ports["ether3"]["poe-out"], ports["ether3"]["poe-priority"]) == ("forced-on", "3")
    assert [name for name, row in ports.items() if row["disabled"] == "yes"] == ["ether4"]


def test_only_the_router_may_manage_the_switch() -> None:
    text = switch(*with_switch())
    assert [row["address"] for row in rows(text, "/ip firewall address-list")] == ["10.64.1.1"]
    assert [row["address"] for row in rows(text, "/ip address")] == ["10.64.1.5/24"]
    (api,) = [row for row in rows(text, "/ip service") if row.get("tls-version")]
    assert api["address"] == "10.64.1.1/32"


def test_switch_at_the_vpn_server_admits_vpn_clients() -> None:
    given, host = with_switch("scc")
    admitted = [row["address"] for row in rows(switch(given, host), "/ip firewall address-list")]
    assert admitted == ["10.64.0.1", "10.80.0.0/24"]


def test_router_masquerades_managers_towards_the_switch() -> None:
    given, host = with_switch()
    hidden = [row for row in rows(router(given, given.router("coastal")), "/ip firewall nat") if "dst-address" in row]
    assert {row["dst-address"] for row in hidden} == {str(host.device.access.address)}  # type: ignore[union-attr]
    assert {row["src-address"] for row in hidden} == {"10.64.101.0/24", "10.80.0.0/24"}
    assert {(row["action"], row["chain"], row["out-interface-list"]) for row in hidden} == {
        ("masquerade", "srcnat", "LAN")
    }


def test_only_admitted_networks_are_masqueraded() -> None:
    given, _ = with_switch()
    management = given.sites["coastal"].management
    alone = management.model_copy(update={"admit": (IPv4Network("10.64.101.0/24"),)})
    text = router(with_site(given, "coastal", management=alone), given.router("coastal"))
    hidden = [row["src-address"] for row in rows(text, "/ip firewall nat") if "dst-address" in row]
    assert hidden == ["10.64.101.0/24"]


def test_a_radio_is_a_port_of_the_bridge() -> None:
    text = switch(*with_switch(access_point=RADIO))
    (radio,) = rows(text, "/interface wifi")
    assert (radio["configuration.mode"], radio["configuration.ssid"]) == ("ap", "EXAMPLE-BUOY")
    (port,) = [row for row in rows(text, "/interface bridge port") if row["interface"] == "wifi1"]
    assert port["horizon"] == "1"


def test_radio_without_isolation_has_no_horizon() -> None:
    text = switch(*with_switch(access_point={**RADIO, "isolated": False}))
    (port,) = [row for row in rows(text, "/interface bridge port") if row["interface"] == "wifi1"]
    assert "horizon" not in port


def test_router_cannot_be_rendered_as_a_switch() -> None:
    given = declaration()
    with pytest.raises(RenderError, match="coastal-router is a router"):
        switch(given, given.router("coastal"))
