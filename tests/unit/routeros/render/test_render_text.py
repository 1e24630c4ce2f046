from dataclasses import replace
from pathlib import Path

import pytest
from jinja2 import UndefinedError
from pydantic import TypeAdapter
from render_declared import GOLDEN, SITES, Declaration, declaration, with_router, with_site

from atlantis_netcfg.core import paths
from atlantis_netcfg.inventory.model import Forward, Router, Transport
from atlantis_netcfg.inventory.satellite_allow_list import derive_targets
from atlantis_netcfg.routeros import render, rsc
from atlantis_netcfg.routeros.render import (
    Prerequisite,
    RenderError,
    environment,
    prerequisites,
    router,
    router_view,
    template_folder,
)
from atlantis_netcfg.routeros.render._environment import MARK, duration

WITHOUT_COMMENT = {"/system/logging", "/system/logging/action"}
ENTIRE = (
    *("/interface bridge port", "/ip dhcp-client", "/interface list member", "/ip firewall address-list"),
    *("/ip firewall filter", "/ip firewall nat", "/ip firewall mangle", "/ip route", "/routing rule"),
)
ENTIRE_WITH_A_CHOICE = ("/queue tree", "/tool netwatch")
"""Where there is another link to go to, and one that is thin."""


def parsed(site: str, given: Declaration | None = None) -> rsc.Export:
    given = given or declaration()
    return rsc.parse(router(given, given.router(site)), f"{site}-router")


@pytest.mark.parametrize("site", SITES)
def test_text_matches_the_golden_file(site: str) -> None:
    given = declaration()
    assert router(given, given.router(site)) == (GOLDEN / f"{site}-router.rsc").read_text("utf-8")


@pytest.mark.parametrize("site", SITES)
def test_text_is_valid_export_text(site: str) -> None:
    export = parsed(site)
    printed = rsc.print_export(export)
    assert rsc.parse(printed) == export
    assert rsc.print_export(rsc.parse(printed)) == printed


@pytest.mark.parametrize("site", SITES)
def test_arguments_are_sorted_as_in_an_export(site: str) -> None:
    for row in parsed(site).statements:
        names = [name for name, _ in row.values]
        assert names == sorted(names), row


@pytest.mark.parametrize("site", SITES)
def test_every_added_row_is_marked(site: str) -> None:
    rows = [row for row in parsed(site).statements if row.verb == "add" and row.menu not in WITHOUT_COMMENT]
    assert rows
    for row in rows:
        assert (row.get("comment") or "").startswith(MARK), row


@pytest.mark.parametrize("site", SITES)
def test_no_row_appears_twice(site: str) -> None:
    rows = [(row.menu, row.verb, row.target, row.find, row.values) for row in parsed(site).statements]
    assert len(rows) == len(set(rows))


@pytest.mark.parametrize("site", SITES)
def test_entirely_managed_menus_are_marked(site: str) -> None:
    directives = [line for line in parsed(site).remarks() if line.startswith("atlantis:entire")]
    more = () if site == "scc" else ENTIRE_WITH_A_CHOICE
    assert sorted(directives) == sorted(f"atlantis:entire {menu}" for menu in (*ENTIRE, *more))


def test_runtime_changes_are_declared_as_no_drift() -> None:
    directives = [line for line in parsed("coastal").remarks() if line.startswith("atlantis:run-time")]
    assert directives == [
        "atlantis:run-time /interface ovpn-client auth=null auth=sha256",
        "atlantis:run-time /ip route distance=10 distance=110",
        "atlantis:run-time /ip route distance=11 distance=111",
        "atlantis:run-time /ip route disabled=yes disabled=no",
        "atlantis:run-time /ip route distance=20 distance=120",
        "atlantis:run-time /tool netwatch disabled=yes disabled=no",
    ]


@pytest.mark.parametrize("site", SITES)
def test_every_port_appears_once_with_its_use_and_poe(site: str) -> None:
    given = declaration()
    device = given.router(site).device
    assert isinstance(device, Router)
    rows = {str(dict(row.find or ())["default-name"]): row for row in parsed(site, given).statements if row.find}
    radio = {"wifi1"} if device.access_point is not None else set()
    assert [name for name in rows if name not in radio] == [port.name for port in device.ports]
    bridged = {row.get("interface") for row in parsed(site, given).statements if row.menu == "/interface/bridge/port"}
    assert bridged == {port.name for port in device.ports if port.use == "lan"} | radio
    for port in device.ports:
        assert rows[port.name].get("disabled") == ("yes" if port.use == "off" else "no")
        assert rows[port.name].get("poe-out") == (port.poe.out.value if port.poe else None)
        assert rows[port.name].get("poe-priority") == (str(port.poe.priority) if port.poe else None)


def test_management_address_is_as_adoption_left_it() -> None:
    rows = [row for row in parsed("coastal").statements if row.get("comment") == "atlantis: management"]
    assert [row.values for row in rows if row.menu == "/ip/address"] == [
        (("address", "10.64.101.1/24"), ("comment", "atlantis: management"), ("interface", "ether8"))
    ]


def test_text_does_not_depend_on_the_order_of_files() -> None:
    given = declaration()
    shuffled = replace(
        given, hosts=dict(reversed(list(given.hosts.items()))), sites=dict(reversed(list(given.sites.items())))
    )
    for site in SITES:
        assert router(shuffled, shuffled.router(site)) == router(given, given.router(site))


def test_quoted_values_keep_their_content() -> None:
    given = with_site(declaration(), "coastal", title='Quay "A"; $north & 5 €')
    note = next(row for row in parsed("coastal", given).statements if row.menu == "/system/note")
    assert 'Quay "A"; $north & 5 €' in str(note.get("note"))


def test_address_is_listed_once_for_all_its_targets() -> None:
    given = declaration()
    satellite = given.sites["te4sea"].bearers[1]
    vpn = derive_targets(given.pilot)[0]
    over_tcp = vpn.model_copy(update={"name": "VPN over TCP", "port": 443, "transport": Transport.TCP})
    more = satellite.model_copy(update={"allow": (over_tcp,)})
    given = with_site(given, "te4sea", bearers=(given.sites["te4sea"].bearers[0], more))
    listed = [row for row in parsed("te4sea", given).statements if row.get("list") == "sat-allow"]
    assert [row.get("address") for row in listed] == ["203.0.113.2", "192.0.2.123", "192.0.2.124"]
    assert listed[0].get("comment") == "atlantis: VPN server, far end of measurements, VPN over TCP, also by satellite"


def test_a_password_is_in_the_text_but_not_in_the_view() -> None:
    given = declaration()
    host = given.router("coastal")
    assert "password=EXAMPLE-vpn-coastal " in router(given, host)
    assert "EXAMPLE-vpn-coastal" not in repr(router_view(given, host))


def test_prerequisites_name_what_the_text_refers_to() -> None:
    given = declaration()
    found = prerequisites(given, given.router("coastal"))
    assert found[:2] == (
        Prerequisite("/certificate", "atlantis-api", "service api-ssl uses it"),
        Prerequisite("/certificate", "atlantis-vpn", "ovpn-scc authenticates with it"),
    )
    assert [row.name for row in found[2:-1]] == [f"ether{number}" for number in range(1, 9)]
    assert {row.menu for row in found[2:-1]} == {"/interface/ethernet"}
    assert found[-1] == Prerequisite("/interface/wifi", "wifi1", "the inventory has it as an access point for vehicles")
    assert [row.name for row in prerequisites(given, given.router("scc")) if row.menu == "/certificate"] == [
        "atlantis-api"
    ]


@pytest.mark.parametrize("site", SITES)
def test_certificates_in_the_text_are_prerequisites(site: str) -> None:
    given = declaration()
    known = {row.name for row in prerequisites(given, given.router(site))}
    used = {row.get("certificate") for row in parsed(site, given).statements} - {None}
    assert used
    assert used <= known


def test_misspelt_template_name_is_an_error(tmp_path: Path) -> None:
    given = declaration()
    (tmp_path / "typo.rsc.j2").write_text("set name={{ router.nmae }}\n")
    (tmp_path / "loop.rsc.j2").write_text("{% for port in router.prots %}{% endfor %}\n")
    made = environment(tmp_path)
    for name in ("typo.rsc.j2", "loop.rsc.j2"):
        with pytest.raises(UndefinedError):
            made.get_template(name).render(router=router_view(given, given.router("coastal")))


def test_templates_are_in_the_checkout_or_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert (template_folder() / "routeros" / "router.rsc.j2").is_file()
    monkeypatch.setattr(paths, "_SHARE", tmp_path)
    assert template_folder() == tmp_path / "templates"


def test_public_names_are_sorted_and_exist() -> None:
    assert render.__all__ == sorted(render.__all__, key=lambda name: (name[0].islower(), name))
    assert all(hasattr(render, name) for name in render.__all__)


def test_every_template_part_is_included() -> None:
    folder = template_folder() / "routeros"
    text = "".join(path.read_text("utf-8") for path in folder.rglob("*.j2"))
    for part in (folder / "parts").iterdir():
        assert f'{{% include "routeros/parts/{part.name}" %}}' in text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0, "0s"),
        (0.5, "500ms"),
        (59, "59s"),
        (60, "1m"),
        (5400, "1h30m"),
        (86400, "1d"),
        (7 * 86400, "1w"),
        (694861, "1w1d1h1m1s"),
    ],
)
def test_intervals_have_the_router_format(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_only_routers_have_a_routers_text() -> None:
    given = declaration()
    with pytest.raises(RenderError, match="coastal-cpe is a cpe"):
        router(given, given.hosts["coastal-cpe"])


def _ports_without(given: Declaration, site: str, **gone: str) -> Declaration:
    device = given.router(site).device
    assert isinstance(device, Router)
    kept = tuple(port for port in device.ports if any(getattr(port, name) != value for name, value in gone.items()))
    return with_router(given, site, ports=kept)


def test_missing_inventory_entries_are_reported() -> None:
    given = declaration()
    forward = TypeAdapter(Forward).validate_python({"transport": "tcp", "port": 443, "to": "nobody"})
    cases = {
        "coastal-router needs one port with `use: management`, but has 0": _ports_without(
            given, "coastal", use="management"
        ),
        "coastal-router needs one port with `use: link, link: 4g`, but has 0": _ports_without(
            given, "coastal", link="4g"
        ),
        "coastal-router forwards a port to nobody, which is not in the inventory": with_router(
            given, "coastal", forwards=(forward,)
        ),
        "pilot.vpn.server names host nobody, which is not in the inventory": replace(
            given, pilot=given.pilot.model_copy(update={"vpn": given.pilot.vpn.model_copy(update={"server": "nobody"})})
        ),
    }
    for message, wrong in cases.items():
        with pytest.raises(RenderError) as raised:
            router(wrong, wrong.router("coastal"))
        assert str(raised.value) == message
