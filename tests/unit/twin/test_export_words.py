"""What real exports hold and a twin once refused, each beside what it has to refuse as before."""

import re
from functools import cache
from pathlib import Path

import pytest
from export_imports import Cause, Imported, figures, imported, lines_of, row, spec_of
from twin_bench import make

from atlantis_netcfg.emulator.routeros.boot import SYSTEM
from atlantis_netcfg.emulator.routeros.console.run import run_file
from atlantis_netcfg.emulator.routeros.device import Device
from atlantis_netcfg.emulator.routeros.spec import Radio

CHR = {"board": "CHR", "architecture": "x86_64", "poe_ports": ()}
CONNECTION = "/routing bgp connection add as=1 local.role=ebgp name=a remote.address"
LEASE = "/ip dhcp-server lease add mac-address=02:00:00:00:00:01"
NO_SUCH = "input does not match any value of {}"
CASES: list[tuple[str, str, str | None]] = [
    # kaihendry/mikrotik-configs, redagain.rsc (7.18.2): a dot alone goes on with the group before it.
    (
        "7.18.2",
        "/interface wifi add configuration.mode=ap .ssid=praze disabled=no name=w1 master-interface=wifi1",
        None,
    ),
    ("7.18.2", "/interface wifi add disabled=no .mode=ap name=w1", "expected end of command (line 1 column 33)"),
    # PE1.rsc of feichay10/Final-Degree-Project, 7.16: a group of arguments, and VRFs.
    (
        "7.16",
        "/routing bgp connection add as=65500 local.address=20.0.0.1 .role=ebgp name=a remote.address=20.0.0.2 .as=1",
        None,
    ),
    (
        "7.16",
        "/routing bgp connection add as=65500 local.address=20.0.0.1 .colour=red",
        "expected end of command (line 1 column 61)",
    ),
    ("7.16", "/ip vrf add interfaces=ether2 name=CE1; /ip route add gateway=10.0.0.1@CE1 routing-table=CE1", None),
    ("7.16", "/ip vrf add interfaces=ether2 name=CE1; /ip route add dst-address=10.0.0.0/30 gateway=CE1@CE1", None),
    ("7.16", "/ip route add gateway=10.0.0.1@CE2", "invalid value for argument gateway"),
    ("7.16", "/ip vrf add interfaces=ether99 name=CE1", NO_SUCH.format("interfaces")),
    # Andreansx/Networking-lab (7.19.4)
    ("7.19.4", "/ip vrf add interfaces=ether1 name=vrf-mgmt; /ip service set ssh vrf=vrf-mgmt", None),
    ("7.19.4", "/ip service set ssh vrf=vrf-mgmt", NO_SUCH.format("vrf")),
    # wimasy/spineleaf (7.16): the oldest exports that name `lo`
    ("7.16", "/ip address add address=10.0.0.11 interface=lo network=10.0.0.11", None),
    ("7.15.3", "/ip address add address=10.0.0.11 interface=lo network=10.0.0.11", NO_SUCH.format("interface")),
    # simsrw73/documents, crs328.rsc and rb5009.rsc (7.1.5); changelog of 7.12
    ("7.1.5", "/interface ethernet set ether1 advertise=10M-half,100M-full,10000M-full speed=1Gbps", None),
    ("7.1.5", "/interface ethernet set ether1 advertise=1G-baseT-full", NO_SUCH.format("advertise")),
    ("7.12", "/interface ethernet set ether1 advertise=10M-half", NO_SUCH.format("advertise")),
    ("7.16", "/interface ethernet set ether1 speed=1Gbps", NO_SUCH.format("speed")),
    ("7.16", "/interface ethernet set ether1 speed=1G-baseT-full", None),
    # LexxaPressF (7.5, 7.6) and konovalM (7.11.2), network programming
    ("7.6", "/interface ovpn-client add certificate=atlantis-api cipher=aes256 connect-to=198.51.100.1 user=a", None),
    ("7.11.2", "/interface ovpn-client add cipher=aes256 connect-to=198.51.100.1 user=a", NO_SUCH.format("cipher")),
    ("7.11.2", "/interface ovpn-client add cipher=aes256-cbc connect-to=198.51.100.1 user=a", None),
    # From tomashoryl/otlab-dev with 7.18 and Defm/mikrobackups with 7.21.
    ("7.18", "/ip firewall nat add action=src-nat chain=srcnat in-interface-list=all to-addresses=192.0.2.2", None),
    ("7.21", "/ip firewall nat add action=masquerade chain=srcnat in-interface=ether1", None),
    (
        "7.18",
        "/ip firewall nat add action=masquerade chain=srcnat in-interface=ether1",
        "failure: incoming interface matching not possible in output and postrouting chains",
    ),
    # simsrw73/documents, rb5009.rsc (7.1.5)
    ("7.2.3", "/ip firewall nat add action=src-nat chain=srcnat protocol=udp src-port=123 to-ports=12300", None),
    (
        "7.2.3",
        "/ip firewall nat add action=src-nat chain=srcnat protocol=udp",
        "missing value(s) of argument(s) to-addresses",
    ),
    # R1.term.rsc of carolinebento-networks/laboratorio-mikrotik, 7.16.
    ("7.16", "/ip firewall nat add action=masquerade chain=srcnat priority=110", None),
    (
        "7.16",
        "/ip firewall nat add action=masquerade chain=srcnat priority=256",
        "value of priority out of range (0..255)",
    ),
    # jmiguelcd/webinar, FirewallBorde.rsc (7.19.1); simsrw73/documents, wapac.rsc (7.1.5)
    ("7.19.1", '/ip route add blackhole disabled=no dst-address=198.51.100.8/32 gateway=""', None),
    ("7.19.1", '/ip route add dst-address=198.51.100.8/32 gateway=""', NO_SUCH.format("gateway")),
    ("7.1.5", '/ip route add dst-address="" gateway=10.64.101.9', None),
    # bkk50.rsc of rotkonetworks/networking, 7.22.
    ("7.22", f"{LEASE} address=10.0.0.1 disabled=yes; {LEASE} address=10.0.0.2", None),
    (
        "7.22",
        f"{LEASE} address=10.0.0.1; {LEASE} address=10.0.0.2",
        "failure: already have static lease with this MAC address",
    ),
    # Defm/mikrobackups (7.15.3, 7.21)
    ("7.21", "/ip dns static add address-list=a regexp=b type=FWD", None),
    ("7.21", "/ip dns static add regexp=b type=FWD", "missing value(s) of argument(s) forward-to"),
    ("7.15.3", "/ip dns static add name=a text=1 type=TXT; /ip dns static add name=a text=2 type=TXT", None),
    (
        "7.15.3",
        "/ip dns static add name=a text=1 type=TXT; /ip dns static add name=a text=1 type=TXT",
        "entry already exists",
    ),
    # Rows that a factory-new router has in menus outside the templates.
    ("7.16", "/port set 0 name=serial0; /port set 1 name=serial1", None),
    ("7.16", "/port set 2 name=serial2", "no such item"),
    ("7.10", "/ip firewall service-port set tftp disabled=yes; /ip ipsec policy set 0 disabled=yes", None),
    ("7.10", "/ip firewall service-port set gopher disabled=yes", "no such item"),
    ("7.16", "/routing bgp template set default as=65000", None),
    ("7.16", "/routing bgp template set other as=65000", "no such item"),
    ("7.20.5", "/ip ipsec profile set [ find default=yes ] dpd-interval=2m dpd-maximum-failures=5", None),
    ("7.20.5", "/ip ipsec profile set [ find default=no ] dpd-interval=2m", "expected item id"),
    ("7.18.2", "/ip smb shares set [ find default=yes ] directory=flash/pub", None),
    ("7.4", "/ip smb shares set [ find default=yes ] directory=/pub", "expected item id"),
    ("7.21", "/snmp community set [ find default=yes ] name=globus", None),
    ("7.19.4", "/ipv6 nd set [ find default=yes ] advertise-dns=no", None),
    ("7.16", "/ip ipsec proposal remove [ find default=yes ]", "failure: cannot remove builtin"),
    ("7.6", "/routing id add id=172.16.0.1 name=A; /routing id add id=172.16.0.1 name=A", None),
    ("7.23", "/ipv6 firewall raw add action=drop chain=bad_tcp protocol=tcp tcp-flags=fin,!ack", None),
    (
        "7.23",
        "/ipv6 firewall raw add action=drop chain=bad_tcp protocol=tcp tcp-flags=fun",
        NO_SUCH.format("tcp-flags"),
    ),
    ("7.19.4", f"{CONNECTION}=10.0.0.1; {CONNECTION}=10.0.0.2", None),
    ("7.1.5", "/system routerboard settings set cpu-frequency=auto", None),
    ("7.1.5", "/system routerboard settings set memory=auto", "expected end of command (line 1 column 34)"),
    # Menus of which no tree is known.
    ("7.2.3", "/zerotier set zt1 disabled=yes", "not rehearsed by the twin: /zerotier"),
    ("6.42.5", "/system lcd set contrast=0", "not rehearsed by the twin: /system/lcd"),
    ("7.9", "/system lcd set contrast=0", "bad command name lcd (line 1 column 9)"),
    # What comes with disks, switch chips and buttons.
    ("7.18", "/disk set slot1 slot=slot1", "not rehearsed by the twin: rows of /disk"),
    (
        "7.19.4",
        "/interface ethernet switch set 0 l3-hw-offloading=yes",
        "not rehearsed by the twin: /interface/ethernet/switch",
    ),
]
"""Version, lines, and the words of the refusal."""


@pytest.mark.parametrize(("version", "lines", "words"), CASES, ids=[f"{case[0]} {case[1][:70]}" for case in CASES])
def test_lines_of_exports(version: str, lines: str, words: str | None) -> None:
    router = make(version=version, packages=("routeros", "wifi-qcom"), radios=(Radio(name="wifi1"),))
    assert run_file(router.device.core, SYSTEM, lines).error == words


def test_a_cloud_hosted_router_has_no_switch_chip() -> None:
    router = make(version="7.19.4", **CHR)
    error = run_file(router.device.core, SYSTEM, "/interface ethernet switch set 0 l3-hw-offloading=yes").error
    assert error == "bad command name switch (line 1 column 21)"


def test_radios_of_before_take_what_exports_say() -> None:
    """Rus1999/Network and simsrw73/documents (7.1.5 to 7.4)."""
    router = make(version="7.2.1", radios=(Radio(name="wlan1"),))
    text = (
        "/interface wireless\nset [ find default-name=wlan1 ] band=2ghz-g/n disabled=no\n"
        "add master-interface=wlan1 name=wlan2 wds-cost-range=0 wds-default-cost=0\n"
    )
    assert run_file(router.device.core, SYSTEM, text).error is None
    assert "wds-default-cost=0" in router.text()


def test_a_vrf_is_exported_and_shows_as_an_interface() -> None:
    router = make(version="7.19.4", seed="/ip vrf add interfaces=ether2 name=blue\n/ip route add gateway=10.0.0.1@blue")
    lines = router.text().splitlines()
    assert "add interfaces=ether2 name=blue" in lines
    assert "add gateway=10.0.0.1@blue" in " ".join(lines)
    assert router.value("/interface", "type", "?name=blue") == "vrf"
    assert router.value("/interface", "type", "?name=lo") == "loopback"
    assert router.say("/interface/set", "=.id=lo", "=name=other") == [
        "!trap =message=failure: cannot change builtin",
        "!done",
    ]


# Exports of other people's devices, each imported into a twin of its device: what is refused is listed by line.


CHECKOUT = Path(__file__).parents[3]
FOLDERS = (CHECKOUT / "tests" / "data" / "exports", CHECKOUT.parent / "shared" / "data" / "routeros-exports")
"""Ours, and more of them beside the checkout where somebody has put them."""
FILES = sorted(path for folder in FOLDERS for path in folder.glob("*.rsc"))
LISTED = [
    line
    for folder in FOLDERS
    if (folder / "refused.tsv").exists()
    for line in (folder / "refused.tsv").read_text(encoding="utf-8").splitlines()
]
"""File, line, menu, cause (`export_imports.Cause`), words of the twin, and what the line says."""
_FIRST_NAME = re.compile(r"(?<= )(?=[a-z][a-z.-]*=)")
_UNKNOWN = ("expected end of command", "bad parameter", "bad command name", "not rehearsed", "syntax error")

named = pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)


def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


@cache
def result_of(path: Path) -> Imported:
    return imported(text_of(path))


@named
def test_what_is_refused_is_listed(path: Path) -> None:
    found = [row(path.name, refusal) for refusal in result_of(path).refusals]
    assert found == [line for line in LISTED if line.startswith(f"{path.name}\t")]


def test_of_a_hundred_lines_in_menus_of_the_templates_at_most_one_is_refused() -> None:
    total = figures(map(result_of, FILES))["all"]
    assert total["exports"] == len(FILES) > 1
    assert total["template_lines"] > 0
    assert total[f"template: {Cause.FALSE}"] <= total["template_lines"] / 100
    assert {line.partition("\t")[0] for line in LISTED} <= {path.name for path in FILES}


@named
def test_what_the_twin_exports_goes_in_again_and_comes_out_the_same(path: Path) -> None:
    first = result_of(path).device.export(show_sensitive=True)
    again = Device(spec_of(text_of(path)), lambda: 1000.0)
    for line in lines_of(first):
        if "atlantis: management" not in line.text:
            assert run_file(again.core, SYSTEM, f"{line.menu}\n{line.text}").error is None, line
    assert bare(again.export(show_sensitive=True)) == bare(first)


def bare(text: str) -> list[str]:
    """The lines without the header, which holds the time."""
    return [line for line in text.splitlines() if not line.startswith("#")]


@named
def test_a_misspelt_argument_is_refused_on_every_line(path: Path) -> None:
    device = Device(spec_of(text_of(path)), lambda: 1000.0)
    for line in lines_of(text_of(path)):
        misspelt, count = _FIRST_NAME.subn("x-", line.text.replace("[ find default", "[ find-default"), count=1)
        if count:
            error = run_file(device.core, SYSTEM, f"{line.menu}\n{misspelt}").error
            assert error is not None, misspelt
            assert error.startswith(_UNKNOWN), misspelt


@named
def test_its_source_and_licence_are_noted(path: Path) -> None:
    assert f"`{path.name}`" in path.with_name("README.md").read_text(encoding="utf-8")
