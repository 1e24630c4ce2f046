"""Export text: what it shows, what it hides, and that it goes back in."""

from pathlib import Path

import pytest
from twin_bench import make

from atlantis_netcfg.emulator.routeros import ManagementSpec
from atlantis_netcfg.emulator.routeros.boot import SeedError
from atlantis_netcfg.emulator.routeros.spec import Radio
from atlantis_netcfg.routeros.rsc import parse, print_export

GOLDEN = Path(__file__).parent / "golden"
SITES = sorted((Path(__file__).parents[2] / "routeros" / "render" / "golden").glob("*-router.rsc"))
BOARD = {
    "packages": ("routeros", "wifi-qcom"),
    "radios": (Radio(name="wifi1"),),
    "certificates": ("atlantis-api", "atlantis-vpn"),
    "management": ManagementSpec(address="192.0.2.1/24", technician="192.0.2.2"),
}
NEWER = " configuration.installation=outdoor"
"""Of a radio, from 7.17 on; a plan for 7.16 is refused."""
SEED = """\
/interface bridge
add name=lan vlan-filtering=no
/interface ethernet
set [ find default-name=ether1 ] comment="to the \\"terminal\\"" poe-out=off
/interface list
add name=WAN
/interface list member
add interface=ether1 list=WAN
/ip firewall filter
add chain=input connection-state=established,related
add action=drop chain=input in-interface-list=!WAN disabled=yes
/interface ovpn-client
add connect-to=vpn.example.org name=vpn password=hush user=coastal disabled=no
/ip service
set telnet disabled=yes
/ip route
add dst-address=10.9.0.0/16 gateway=10.64.101.9 distance=1
add blackhole dst-address=10.8.0.0/16
/system identity
set name="Quay 7"
/system logging
set 0 topics=info,!dhcp
add topics=error action=disk
/routing table
add fib name=via-sat
"""


def test_host_address_is_exported_without_prefix_length() -> None:
    router = make(seed="/ip address add address=10.255.255.1/32 interface=ether1")
    lines = router.text().splitlines()
    assert "add address=10.255.255.1 interface=ether1 network=10.255.255.1" in lines
    assert any(line.startswith("add address=10.64.101.1/24 ") for line in lines)
    assert router.value("/ip/address", "address", "?interface=ether1") == "10.255.255.1/32"


def test_golden_export() -> None:
    assert make(seed=SEED).device.export() == (GOLDEN / "seed.rsc").read_text(encoding="utf-8")


def test_terse_has_the_path_on_every_line() -> None:
    lines = make(seed=SEED).device.export(terse=True, header=False).splitlines()
    assert "/ip route add blackhole dst-address=10.8.0.0/16" in lines
    assert all(line.startswith("/") for line in lines)


def test_verbose_shows_defaults() -> None:
    text = make().device.export(verbose=True, menu="/ip/socks", header=False)
    assert text == (
        "/ip socks\nset auth-method=none connection-idle-timeout=2m enabled=no max-connections=\\\n"
        "    200 port=1080 version=4 vrf=main\n"
    )


def test_secrets_are_exported_only_on_request() -> None:
    router = make(seed=SEED)
    assert "hush" not in router.device.export()
    assert "password=hush" in router.device.export(show_sensitive=True)
    router.say("/interface/ovpn-client/set", "=.id=vpn", "=password=other")
    assert not [line for line in router.say("/system/history/print") if "hush" in line or "other" in line]


def test_users_and_certificates_are_not_exported() -> None:
    router = make()
    assert "provision" not in router.text()
    assert "/certificate" not in router.text()


def test_blocked_scheduler_is_marked_in_the_export() -> None:
    router = make(device_mode={"mode": "home"})
    router.say("/system/scheduler/add", "=name=x", "=interval=1m")
    assert "# inactivated, not allowed by device-mode\nadd interval=1m name=x" in router.text()


def test_old_version_has_the_old_export_header() -> None:
    assert make(version="7.9").device.export().startswith("# jan/01/2026 08:00:00 by RouterOS 7.9\n")


@pytest.mark.parametrize("version", ["7.16", "7.18.2", "7.21.5"])
@pytest.mark.parametrize("site", SITES, ids=lambda path: path.stem)
def test_rendered_templates_survive_import_and_export(site: Path, version: str) -> None:
    first = make(version=version, **BOARD)
    declared = site.read_text(encoding="utf-8")
    if version == "7.16" and NEWER in declared:
        column = next(line for line in declared.splitlines() if NEWER in line).index(NEWER) + 2
        with pytest.raises(SeedError, match=rf"expected end of command \(line \d+ column {column}\)"):
            make(version=version, **BOARD, seed=declared)
        declared = declared.replace(NEWER, "")
    second = make(version=version, **BOARD, seed=declared)
    assert first.text() != second.text()
    adopted = 'add address=192.0.2.1/24 comment="atlantis: management" interface=ether8 \\\n    network=192.0.2.0\n'
    exported = second.text()
    assert adopted in exported
    # A factory-new router holds show-at-login=no although the default is yes, and an export leaves out defaults.
    text = "/system note set show-at-login=yes\n" + exported.replace(adopted, "")
    assert make(version=version, **BOARD, seed=text).text() == exported
    assert print_export(parse(exported)) == exported


def test_a_seed_that_the_router_refuses_is_an_error() -> None:
    with pytest.raises(ValueError, match=r"router: the seed was refused: bad command name adress \(line 1 column 5\)"):
        make(seed="/ip adress\n")
