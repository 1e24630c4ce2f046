"""The text of both ends of the Wi-Fi bridge: what it says, whom it lets in, and that both ends fit together."""

from dataclasses import replace
from functools import cache
from ipaddress import ip_address, ip_network
from typing import Any

import pytest
from render_declared import GOLDEN, Declaration, declaration
from render_walk import Packet, Walk

from atlantis_netcfg.inventory.model import Cpe, Ptp, PtpProtocol
from atlantis_netcfg.operations.common.kinds import ManagedCpe, families
from atlantis_netcfg.routeros import desired, rsc
from atlantis_netcfg.routeros.render import RenderError, cpe, cpe_prerequisites, cpe_view
from atlantis_netcfg.routeros.rsc import Export

ENDS = ("scc-cpe", "coastal-cpe")
FAMILIES = ("wireless", "wifi")
shipped = cache(declaration)
RADIOS = {"wireless": "/interface/wireless", "wifi": "/interface/wifi"}


def with_ptp(given: Declaration, **changes: Any) -> Declaration:  # noqa: ANN401 - fields of Ptp
    hosts = dict(given.hosts)
    for name in ENDS:
        device = hosts[name].device
        assert isinstance(device, Cpe)
        ptp = Ptp.model_validate({**device.ptp.model_dump(), "key": device.ptp.key, **changes})
        hosts[name] = replace(hosts[name], device=device.model_copy(update={"ptp": ptp}))
    return replace(given, hosts=hosts)


def fitting(family: str) -> Declaration:
    return shipped() if family == "wireless" else with_ptp(shipped(), protocol=PtpProtocol.IEEE_80211)


def text(name: str, family: str, given: Declaration | None = None) -> str:
    given = given or fitting(family)
    return cpe(given, given.hosts[name], family)


def parsed(name: str, family: str, given: Declaration | None = None) -> Export:
    return rsc.parse(text(name, family, given), name)


def radio(name: str, family: str, given: Declaration | None = None) -> dict[str, str | None]:
    (row,) = (one for one in parsed(name, family, given).statements if one.menu == RADIOS[family])
    return dict(row.values)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("name", ENDS)
def test_text_matches_the_golden_file(name: str, family: str) -> None:
    assert text(name, family) == (GOLDEN / f"{name}-{family}.rsc").read_text("utf-8")


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("name", ENDS)
def test_text_is_valid_export_text_for_the_engine(name: str, family: str) -> None:
    export = parsed(name, family)
    assert rsc.parse(rsc.print_export(export)) == export
    assert RADIOS[family] in desired.read(text(name, family)).menus
    assert {one.menu for one in export.statements}.isdisjoint({RADIOS[other] for other in FAMILIES if other != family})


@pytest.mark.parametrize("family", FAMILIES)
def test_both_ends_have_matching_radio_settings(family: str) -> None:
    one, other = (radio(name, family) for name in ENDS)
    differing = {name for name in one.keys() | other.keys() if one.get(name) != other.get(name)}
    only_one_may_choose = {"channel.frequency"} if family == "wifi" else set[str]()
    assert differing == {"comment", "mode" if family == "wireless" else "configuration.mode"} | only_one_may_choose


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("name", ENDS)
def test_only_technicians_of_both_sites_have_access(name: str, family: str) -> None:
    walk = Walk(parsed(name, family))
    for source in ("10.10.0.1", "10.10.0.2", "10.64.100.10", "10.64.101.10"):
        for port in (22, 8729):
            assert walk.accepts("input", Packet(source, "10.10.0.4", "bridge-ptp", "", "tcp", port))
        assert walk.accepts("input", Packet(source, "10.10.0.4", "bridge-ptp", "", "icmp"))
        for port in (23, 80, 8291, 8728, 2000):
            assert not walk.accepts("input", Packet(source, "10.10.0.4", "bridge-ptp", "", "tcp", port))
    for source in ("10.64.1.21", "10.80.16.5", "203.0.113.9", "10.10.1.1"):
        for protocol, port in (("tcp", 22), ("tcp", 8729), ("icmp", 0), ("udp", 161)):
            assert not walk.accepts("input", Packet(source, "10.10.0.4", "bridge-ptp", "", protocol, port))
    assert walk.accepts("input", Packet("192.0.2.123", "10.10.0.4", "bridge-ptp", "", "udp", 123, "established"))
    assert not walk.accepts("forward", Packet("10.10.0.1", "10.64.1.21", "bridge-ptp", "bridge-ptp", "tcp", 22))


@pytest.mark.parametrize("name", ENDS)
def test_services_and_filter_admit_the_same(name: str) -> None:
    export = parsed(name, "wireless")
    listed = {str(one.get("address")) for one in export.statements if one.menu == "/ip/firewall/address-list"}
    for service in ("ssh", "api-ssl"):
        (row,) = (one for one in export.statements if one.menu == "/ip/service" and one.target == service)
        assert set(str(row.get("address")).split(",")) == listed


@pytest.mark.parametrize("name", ENDS)
def test_responses_are_routed_to_both_technicians_and_time_servers(name: str) -> None:
    export = parsed(name, "wireless")
    (address,) = (str(one.get("address")) for one in export.statements if one.menu == "/ip/address")
    here = ip_network(address, strict=False)
    routes = {
        str(one.get("dst-address")): str(one.get("gateway")) for one in export.statements if one.menu == "/ip/route"
    }
    assert all(ip_address(gateway) in here for gateway in routes.values())

    def gateway(to: str) -> str:
        fitting = [network for network in routes if ip_address(to) in ip_network(network)]
        return routes[max(fitting, key=lambda network: ip_network(network).prefixlen)]

    assert gateway("10.64.101.10") == "10.10.0.2", "the router of the site that is carried"
    assert gateway("10.64.100.10") == "10.10.0.1", "the router that serves the link"
    assert gateway("192.0.2.123") == "10.10.0.1"


@pytest.mark.parametrize(
    ("frequency", "width", "legacy", "newer"),
    [
        (5500, 20, "20mhz", "20mhz"),
        (5500, 40, "20/40mhz-Ce", "20/40mhz-Ce"),
        (5520, 40, "20/40mhz-eC", "20/40mhz-eC"),
        (5500, 80, "20/40/80mhz-Ceee", "20/40/80mhz"),
        (5540, 80, "20/40/80mhz-eeCe", "20/40/80mhz"),
        (5560, 80, "20/40/80mhz-eeeC", "20/40/80mhz"),
    ],
)
def test_channel_width_encodes_the_control_channel(frequency: int, width: int, legacy: str, newer: str) -> None:
    given = with_ptp(shipped(), protocol="802.11", frequency_mhz=frequency, width_mhz=width)
    assert radio("scc-cpe", "wireless", given)["channel-width"] == legacy
    assert radio("scc-cpe", "wifi", given)["channel.width"] == newer


@pytest.mark.parametrize(
    ("standard", "band", "legacy", "newer"),
    [
        ("802.11a", "5ghz", "5ghz-a", "5ghz-a"),
        ("802.11g", "2ghz", "2ghz-b/g", "2ghz-g"),
        ("802.11n", "2ghz", "2ghz-b/g/n", "2ghz-n"),
        ("802.11n", "5ghz", "5ghz-a/n", "5ghz-n"),
        ("802.11ac", "5ghz", "5ghz-a/n/ac", "5ghz-ac"),
    ],
)
def test_band_uses_the_names_of_the_driver_family(standard: str, band: str, legacy: str, newer: str) -> None:
    given = with_ptp(shipped(), protocol="802.11", standard=standard, band=band, frequency_mhz=2412)
    assert radio("scc-cpe", "wireless", given)["band"] == legacy
    assert radio("scc-cpe", "wifi", given)["channel.band"] == newer


def test_power_distance_and_dfs_reach_the_radio() -> None:
    long = {"distance_m": 42_000, "frequency_mhz": 5600, "tx_power_dbm": 12, "antenna_gain_dbi": 18}
    said = radio("scc-cpe", "wireless", with_ptp(shipped(), **long))
    assert said["nv2-cell-radius"] == "42"
    assert (said["tx-power"], said["tx-power-mode"], said["antenna-gain"]) == ("12", "all-rates-fixed", "18")
    assert said["skip-dfs-channels"] == "disabled", "the declared channel is one that has to be listened to for long"
    newer = radio("scc-cpe", "wifi", with_ptp(shipped(), protocol="802.11", **long))
    assert (newer["configuration.distance"], newer["configuration.tx-power"]) == ("42", "12")
    above = radio("scc-cpe", "wireless", with_ptp(shipped(), frequency_mhz=5660))
    assert above["skip-dfs-channels"] == "10min-cac", "a channel that begins where those of the radars end"
    short = radio("scc-cpe", "wireless")
    assert (short["nv2-cell-radius"], short["skip-dfs-channels"]) == ("10", "10min-cac")
    bare = radio("scc-cpe", "wireless", with_ptp(shipped(), tx_power_dbm=None, antenna_gain_dbi=None))
    assert bare["tx-power-mode"] == "default"
    assert bare.keys().isdisjoint({"tx-power", "antenna-gain"}), "what the factory knows of its antenna stays"


def test_wpa3_and_key_are_set_where_the_family_supports_them() -> None:
    given = with_ptp(shipped(), protocol="802.11", wpa="wpa3", standard="802.11ax")
    said = radio("scc-cpe", "wifi", given)
    assert said["security.authentication-types"] == "wpa3-psk"
    assert said["security.passphrase"] == "EXAMPLE-ptp-key"
    assert "nv2-preshared-key" not in radio("scc-cpe", "wireless", with_ptp(shipped(), protocol="802.11"))


@pytest.mark.parametrize(
    ("changes", "wanted"),
    [
        ({}, ("wireless",)),
        ({"protocol": "802.11"}, ("wireless", "wifi")),
        ({"protocol": "802.11", "menus": "wifi"}, ("wifi",)),
        ({"protocol": "802.11", "menus": "wireless"}, ("wireless",)),
        ({"protocol": "802.11", "wpa": "wpa3"}, ("wifi",)),
        ({"protocol": "802.11", "standard": "802.11ax"}, ("wifi",)),
    ],
)
def test_driver_families_that_support_the_inventory(changes: dict[str, str], wanted: tuple[str, ...]) -> None:
    device = with_ptp(shipped(), **changes).hosts["scc-cpe"].device
    assert isinstance(device, Cpe)
    assert families(device.ptp) == wanted


def test_unsupported_settings_are_refused() -> None:
    with pytest.raises(RenderError, match="the `wifi` menus do not support nv2"):
        text("scc-cpe", "wifi", shipped())
    with pytest.raises(RenderError, match=r"the `wireless` menus do not support 802\.11 with 802\.11ax"):
        text("scc-cpe", "wireless", with_ptp(shipped(), protocol="802.11", standard="802.11ax"))
    with pytest.raises(RenderError, match="only a CPE can have a CPE configuration"):
        cpe_view(shipped(), shipped().hosts["scc-router"], "wireless")
    alone = shipped()
    sites = {**alone.sites, "scc": alone.sites["scc"].model_copy(update={"served_links": ()})}
    with pytest.raises(RenderError, match="coastal-cpe is not an end of a link"):
        cpe_view(replace(alone, sites=sites), alone.hosts["coastal-cpe"], "wireless")


@pytest.mark.parametrize("name", ENDS)
def test_management_place_and_prerequisites(name: str) -> None:
    given = shipped()
    known = ManagedCpe(given, given.hosts[name])  # type: ignore[arg-type]  # the models alone stand for the loader's
    assert known.place.technician == "10.10.0.6", "the highest address of the link that nobody has"
    assert known.place.port == "ether1"
    found = {(one.menu, one.name) for one in cpe_prerequisites(given, given.hosts[name])}
    assert found == {("/certificate", "atlantis-api"), ("/interface/ethernet", "ether1")}
