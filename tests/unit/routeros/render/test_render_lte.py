"""The text of a MikroTik LTE box: as it is shipped, what it lets through, and that the device takes it."""

from dataclasses import replace

import pytest
from hypothesis import given as drawn
from hypothesis import strategies as st
from render_declared import GOLDEN, Host, declaration
from render_walk import Packet, Walk

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.emulator.routeros import Device, ManagementSpec, ModemSpec, RouterSpec
from atlantis_netcfg.inventory.model import LteDriver, LteRouter, Sim
from atlantis_netcfg.routeros import rsc
from atlantis_netcfg.routeros.render import RenderError, environment, lte, lte_prerequisites, lte_view

DECLARED = declaration()
BOX = DECLARED.hosts["coastal-4g"]
WALK = Walk(rsc.parse(lte(DECLARED, BOX), "coastal-4g"))
ROUTER, OUTSIDE = "10.10.1.2", "198.51.100.7"
SILENT = ("/ip/cloud", "/system/ntp/client", "/system/clock", "/ip/dns")


def box(**sim: object) -> Host:
    assert isinstance(BOX.device, LteRouter)
    return replace(BOX, device=BOX.device.model_copy(update={"sim": Sim.model_validate(sim)}))


def modem(host: Host) -> tuple[dict[str, str | None], dict[str, str | None]]:
    """The rows of the APN profile and of the modem."""
    rows = {row.menu: dict(row.values) for row in rsc.parse(lte(DECLARED, host), "box").statements}
    return rows["/interface/lte/apn"], rows["/interface/lte"]


def test_text_matches_the_golden_file() -> None:
    assert lte(DECLARED, BOX) == (GOLDEN / "coastal-4g.rsc").read_text("utf-8")


def test_text_is_valid_export_text() -> None:
    export = rsc.parse(lte(DECLARED, BOX), "coastal-4g")
    printed = rsc.print_export(export)
    assert rsc.parse(printed) == export
    for row in export.statements:
        names = [name for name, _ in row.values]
        assert names == sorted(names), row


def test_full_subscription_is_rendered() -> None:
    host = box(apn="umts", user="me", password="p w", pin="1234", roaming=True, bands=(3, 20))
    profile, row = modem(host)
    assert profile == {
        "apn": "umts",
        "authentication": "chap",
        "comment": "atlantis: the SIM's contract",
        "name": "atlantis",
        "password": "p w",
        "use-network-apn": "no",
        "use-peer-dns": "no",
        "user": "me",
    }
    assert (row["allow-roaming"], row["apn-profiles"], row["band"], row["pin"]) == ("yes", "atlantis", "3,20", "1234")


def test_minimal_subscription_is_rendered() -> None:
    profile, row = modem(box())
    assert (profile["use-network-apn"], profile["authentication"]) == ("yes", "none")
    assert "password" not in profile
    assert (row["allow-roaming"], row["band"]) == ("no", "")
    assert "pin" not in row


def test_device_sends_no_traffic_of_its_own() -> None:
    rows = {row.menu: dict(row.values) for row in rsc.parse(lte(DECLARED, BOX), "box").statements}
    said = {menu: rows[menu] for menu in SILENT}
    assert (said["/ip/cloud"]["update-time"], said["/ip/cloud"]["ddns-enabled"]) == ("no", "auto")
    assert said["/system/ntp/client"] == {"enabled": "no"}
    assert said["/system/clock"]["time-zone-autodetect"] == "no"
    assert said["/ip/dns"] == {"allow-remote-requests": "no", "servers": ""}
    assert "/ip/dhcp-server" not in rows


@drawn(
    st.ip_addresses(v=4).map(str),
    st.sampled_from(["tcp", "udp", "icmp"]),
    st.sampled_from([22, 53, 80, 8291, 8729]),
    st.sampled_from(["new", "established", "related", "invalid", "untracked"]),
)
def test_nothing_from_4g_reaches_the_device(src: str, protocol: str, port: int, state: str) -> None:
    packet = Packet(src, "100.72.9.14", in_interface="lte1", protocol=protocol, dst_port=port, state=state)
    assert not WALK.accepts("input", packet)


@drawn(st.ip_addresses(v=4).map(str), st.sampled_from(["ether1", "lte1"]))
def test_only_responses_come_in_from_4g(dst: str, out: str) -> None:
    packet = Packet(OUTSIDE, dst, in_interface="lte1", out_interface=out, protocol="tcp", dst_port=443)
    assert not WALK.accepts("forward", packet)
    assert WALK.accepts("forward", replace(packet, state="established"))


@pytest.mark.parametrize("port", [22, 8729])
def test_management_is_allowed_only_from_the_link(port: int) -> None:
    packet = Packet(ROUTER, "10.10.1.1", in_interface="ether1", protocol="tcp", dst_port=port)
    assert WALK.accepts("input", packet)
    assert not WALK.accepts("input", replace(packet, in_interface="lte1"))
    assert not WALK.accepts("input", replace(packet, src="10.64.1.21"))
    assert not WALK.accepts("input", replace(packet, dst_port=80))


def test_router_traffic_leaves_masqueraded() -> None:
    packet = Packet(ROUTER, OUTSIDE, in_interface="ether1", out_interface="lte1", protocol="udp", dst_port=1194)
    assert WALK.accepts("forward", packet)
    assert WALK.translation("srcnat", packet) == ("masquerade", "")
    assert not WALK.accepts("forward", replace(packet, src="10.64.1.21"))
    assert not WALK.accepts("forward", replace(packet, state="invalid"))


@pytest.mark.parametrize("version", ["7.18.2", "7.21.5"])
def test_emulator_accepts_every_row_and_stays_reachable(version: str) -> None:
    port, technician = "ether1", ROUTER
    spec = RouterSpec(
        name="coastal-4g",
        version=version,
        ports=(port,),
        poe_ports=(),
        modem=ModemSpec(),
        management=ManagementSpec(address="10.10.1.1/29", port=port, technician=technician),
    )
    device = Device(spec, lambda: 0.0)
    caller = device.login("provision", "", via="api-ssl", address=technician)
    text = lte(DECLARED, box(apn="internet", user="me", password="x", bands=(3,)))
    for row in rsc.parse(text, "box").statements:
        if (row.menu, row.get("comment")) == ("/ip/address", "atlantis: management"):
            continue
        words = [f"{row.menu}/{row.verb}"]
        words += [f"=.id={value}" for name, value in row.find or () if name == "default-name"]
        words += [f"=.id={row.target}"] if row.target is not None else []
        answers = device.run(caller, [*words, *(f"={name}={value or ''}" for name, value in row.values)])
        assert not [answer for answer in answers if answer.kind == "!trap"], (row, answers)
        assert device.path_open(technician, "10.10.1.1", "api-ssl"), row
    assert not device.path_open("10.64.1.21", "10.10.1.1", "api-ssl")


def test_prerequisites_are_listed() -> None:
    assert {(row.menu, row.name) for row in lte_prerequisites(DECLARED, BOX)} == {
        ("/certificate", "atlantis-api"),
        ("/interface/ethernet", "ether1"),
        ("/interface/lte", "lte1"),
    }


def test_api_port_follows_the_inventory() -> None:
    assert isinstance(BOX.device, LteRouter)
    assert BOX.device.access is not None
    moved = BOX.device.access.model_copy(update={"port": 18729})
    view = lte_view(DECLARED, replace(BOX, device=BOX.device.model_copy(update={"access": moved})))
    assert view.management.api_port == 18729


def test_other_devices_are_refused() -> None:
    assert isinstance(BOX.device, LteRouter)
    other = replace(BOX, device=BOX.device.model_copy(update={"driver": LteDriver.MANUAL}))
    with pytest.raises(RenderError, match="coastal-4g is not an LTE device with driver routeros"):
        lte(DECLARED, other)
    with pytest.raises(RenderError, match="coastal-router is not an LTE device"):
        lte(DECLARED, DECLARED.router("coastal"))


def test_device_without_a_link_is_refused() -> None:
    lost = replace(BOX, name="lost-4g", device=BOX.device.model_copy(update={"address": "10.10.1.5"}))
    with pytest.raises(RenderError, match="lost-4g is the gateway of no link of coastal") as caught:
        lte(DECLARED, lost)
    assert caught.value.hint == "see `bearers` in group_vars/coastal.yml: one needs `device: lost-4g`"


def test_secrets_are_quoted() -> None:
    view = replace(lte_view(DECLARED, BOX), user="u", password=Secret('a "b" $c'))
    text = environment().get_template("routeros/lte.rsc.j2").render(lte=view)
    (row,) = [one for one in rsc.parse(text, "box").statements if one.menu == "/interface/lte/apn"]
    assert row.get("password") == 'a "b" $c'
