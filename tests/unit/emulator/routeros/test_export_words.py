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
from atlantis_netcfg.emulator.routeros.schema import version_key
from atlantis_netcfg.emulator.routeros.spec import ModemSpec, Radio

CHR = {"board": "CHR", "architecture": "x86_64", "poe_ports": ()}
CONNECTION = "/routing bgp connection add as=1 local.role=ebgp name=a remote.address"
LEASE = "/ip dhcp-server lease add mac-address=02:00:00:00:00:01"
SIX = "not rehearsed by the twin: RouterOS 6: "
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
    # AP1.rsc to R1.rsc of maigonis-elleris/routeros-fundamentals-lab (7.20): queue types, CAPsMAN and its lists.
    ("7.20", "/queue type set 2 kind=fq-codel; /queue interface set ether1 queue=only-hardware-queue", None),
    ("7.20", "/queue type set 10 kind=fq-codel", "no such item"),
    ("7.18.2", "/queue type add kind=red name=own; /queue tree add name=a parent=global queue=own", None),
    ("7.18.2", "/queue type add kind=red name=own; /queue simple add queue=own/default target=192.0.2.0/24", None),
    ("7.18.2", "/queue tree add name=down parent=global queue=own", NO_SUCH.format("queue")),
    ("7.18.2", "/queue type add kind=red name=own; /queue interface set ether1 queue=own", None),
    ("7.18.2", "/queue interface set ether1 queue=own", NO_SUCH.format("queue")),
    ("7.18.2", "/queue interface set ether99 queue=no-queue", "no such item"),
    ("7.18.2", f"/queue type add kind=red name=own; {LEASE} address=10.0.0.1 queue-type=own", None),
    ("7.18.2", f"{LEASE} queue-type=own", NO_SUCH.format("queue-type")),
    ("7.18.2", "/ppp profile add name=own; /interface ovpn-client add connect-to=192.0.2.1 profile=own user=u", None),
    ("7.18.2", "/interface ovpn-client add connect-to=192.0.2.1 profile=own user=u", NO_SUCH.format("profile")),
    (
        "7.18.2",
        "/ppp profile add name=own; /interface l2tp-client add connect-to=192.0.2.1 name=l profile=own user=u",
        None,
    ),
    ("7.18.2", "/interface l2tp-client add connect-to=192.0.2.1 name=l profile=own user=u", NO_SUCH.format("profile")),
    ("7.18.2", "/ip dhcp-client option set clientid code=61", None),
    ("7.18.2", "/interface bonding add mode=802.3ad name=b slaves=ether2,ether3", None),
    ("7.18.2", "/interface bonding add mode=802.3ad name=b slaves=ether2,ether99", NO_SUCH.format("slaves")),
    ("7.20.8", "/interface wifi add disabled=no name=AP1-2G radio-mac=02:00:5E:00:00:03", None),
    ("7.20.8", "/interface wifi add disabled=no name=AP1-2G", "failure: master interface not specified"),
    ("7.20.8", "/interface list add name=WLAN; /interface wifi access-list add action=reject interface=WLAN", None),
    ("7.20.8", "/interface wifi access-list add action=accept interface=wifi1 signal-range=-80..0", None),
    ("7.20.8", "/interface wifi access-list add action=accept interface=any", None),
    ("7.20.8", "/interface wifi access-list add action=reject interface=WLAN", NO_SUCH.format("interface")),
    # Two leases of one MAC address for two client ids, and one of them twice.
    ("7.18.2", f"{LEASE} address=10.0.0.1 client-id=one; {LEASE} address=10.0.0.2", None),
    (
        "7.18.2",
        f"{LEASE} address=10.0.0.1 client-id=one; {LEASE} address=10.0.0.2 client-id=one",
        "failure: already have static lease with this MAC address",
    ),
    # Verbose exports of 6.48 and 7.17 name the profiles by id.
    ("7.17.2", "/ppp profile set *0 change-tcp-mss=yes; /ppp profile set *FFFFFFFE use-encryption=yes", None),
    ("7.17.2", "/ppp profile set *1 change-tcp-mss=yes", "no such item"),
    ("7.17.2", "/ip dhcp-server config set store-leases-disk=5m", None),
    ("7.17.2", "/ip hotspot user profile set [ find default=yes ] shared-users=1", None),
    ("7.17.2", "/tool romon port set [ find default=yes ] cost=100", None),
    # Values that no device takes.
    ("7.18.2", "/tool netwatch add host=192.0.2.1 src-address=256.1.1.1", "invalid value for argument src-address"),
    ("7.18.2", "/tool netwatch add host=192.0.2.1 src-address=192.0.2.9", None),
    ("7.18.2", "/tool netwatch add host=256.1.1.1", "invalid value for argument host"),
    ("7.18.2", "/tool netwatch add host=host.example.org", None),
    ("7.18.2", "/interface ethernet set ether1 cable-settings=bogus", NO_SUCH.format("cable-settings")),
    ("7.18.2", "/interface ethernet set ether1 cable-settings=short", None),
    ("7.18.2", "/ip ipsec peer add address=192.0.2.1/32 name=p port=70000", "invalid value for argument port"),
    ("7.18.2", "/ip ipsec peer add address=192.0.2.1/32 name=p port=65535", None),
    ("7.18.2", "/ip ipsec peer add address=192.0.2.256/32 name=p", "invalid value for argument address"),
    ("7.18.2", "/ip proxy set port=8080,70000", "invalid value for argument port"),
    ("7.18.2", "/interface wireguard add listen-port=70000 name=w", "invalid value for argument listen-port"),
    # Rows that are nowhere, and rows of which nobody knows whether a board has them.
    ("7.18.2", "/system script run nobody", "no such item"),
    (
        "7.18.2",
        "/system script add name=mine; /system script run mine",
        "not rehearsed by the twin: /system/script/run",
    ),
    ("7.18.2", "/system console set [ find vcno=1 ] term=linux", "not rehearsed by the twin: rows of /system/console"),
    ("7.18.2", "/system leds set 0 type=on", "not rehearsed by the twin: rows of /system/leds"),
    ("7.18.2", "/ip ipsec peer set nobody disabled=yes", "no such item"),
    # Below 7.9 no command tree was published; of RouterOS 6 only what adoption changes is known.
    ("6.49.2", "/routing bgp instance set default as=65530", "not rehearsed by the twin: /routing/bgp/instance"),
    ("6.49.2", "/system ntp client set primary-ntp=192.0.2.1", f"{SIX}expected end of command (line 1 column 24)"),
    ("6.49.2", "/interface ovpn-server server set cipher=aes128", f"{SIX}{NO_SUCH.format('cipher')}"),
    ("6.49.2", "/ip firewall filter add action=drop chain=input disabled=no", None),
    ("6.49.2", "/user add group=full name=admin password=x", "failure: user with the same name already exists"),
    ("6.49.2", "/ip service set nobody disabled=yes", "no such item"),
    ("7.1", "/interface wifiwave2 set wifi1 disabled=no", "not rehearsed by the twin: /interface/wifiwave2"),
    ("7.12", "/interface wifiwave2 set wifi1 disabled=no", "not rehearsed by the twin: /interface/wifiwave2"),
    ("7.13", "/interface wifiwave2 set wifi1 disabled=no", "bad command name wifiwave2 (line 1 column 12)"),
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
def test_export_lines_are_accepted_or_refused(version: str, lines: str, words: str | None) -> None:
    router = make(version=version, packages=("routeros", "wifi-qcom"), radios=(Radio(name="wifi1"),))
    assert run_file(router.device.core, SYSTEM, lines).error == words


def test_old_wireless_arguments_contain_a_slash() -> None:
    rates = "supported-rates-a/g=6Mbps,9Mbps"
    radios = {"version": "7.18.2", "packages": ("routeros", "wireless"), "radios": (Radio(name="wlan1"),)}
    seed = f"/interface wireless set wlan1 rate-set=configured {rates} basic-rates-a/g=6Mbps"
    router = make(**radios, seed=seed)
    assert rates in router.text().replace("\\\n    ", "")
    error = run_file(router.device.core, SYSTEM, "/interface wireless set wlan1 supported-rates-a/h=6Mbps").error
    assert error == "expected end of command (line 1 column 31)"


def test_interfaces_are_exported_after_those_they_depend_on() -> None:
    """As exports of 7.15 and 7.20 have it."""
    seed = (
        "/interface vlan add interface=ether1 name=v6 vlan-id=6\n"
        "/interface pppoe-client add interface=v6 name=wan user=u\n"
        "/interface bonding add mode=active-backup name=b slaves=ether2,ether3\n"
        "/interface vlan add interface=b name=v7 vlan-id=7\n"
        "/interface lte apn set [ find default=yes ] passthrough-interface=v7\n"
    )
    spec = {"version": "7.18.2", "modem": ModemSpec()}
    text = make(**spec, seed=seed).text()
    menus = [line for line in text.splitlines() if line.startswith("/interface")]
    assert menus == [f"/interface {name}" for name in ("bonding", "vlan", "lte apn", "pppoe-client")]
    lines = [line for line in lines_of(text) if "atlantis: management" not in line.text]
    again = make(**spec)
    assert [run_file(again.device.core, SYSTEM, f"{line.menu}\n{line.text}").error for line in lines] == [None] * len(
        lines
    )
    assert again.text() == text


def test_each_interface_has_a_queue() -> None:
    router = make(version="7.18.2")
    assert router.value("/queue/interface", "queue", "?interface=ether1") == "only-hardware-queue"
    assert (
        run_file(router.device.core, SYSTEM, "/interface bridge add name=b; /queue interface set b queue=default").error
        is None
    )
    assert "/queue interface\nset b queue=default\n" in router.text()


def test_a_cloud_hosted_router_has_no_switch_chip() -> None:
    router = make(version="7.19.4", **CHR)
    error = run_file(router.device.core, SYSTEM, "/interface ethernet switch set 0 l3-hw-offloading=yes").error
    assert error == "bad command name switch (line 1 column 21)"


def test_old_wireless_accepts_lines_of_public_exports() -> None:
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


CHECKOUT = Path(__file__).parents[4]
FOLDERS = (CHECKOUT / "tests" / "data" / "exports", CHECKOUT.parent / "shared" / "data" / "routeros-exports")
"""Ours, and more of them beside the checkout where somebody has put them."""
PUBLIC = CHECKOUT.parent / "shared" / "data" / "public-exports"
"""44 of other people's devices, where somebody has put them. Their text stays out of the repository."""
PUBLIC_FILES = sorted(PUBLIC.glob("*.rsc"))
PUBLIC_REFUSED = FOLDERS[0] / "public-refused.tsv"
"""File, line, cause, words of the twin."""
OWN_FILES = sorted(path for folder in FOLDERS for path in folder.glob("*.rsc"))
FILES = [*OWN_FILES, *PUBLIC_FILES]
public = pytest.mark.skipif(not PUBLIC_FILES, reason="no exports in ../shared/data/public-exports")
LISTED = [
    line
    for folder in FOLDERS
    if (folder / "refused.tsv").exists()
    for line in (folder / "refused.tsv").read_text(encoding="utf-8").splitlines()
]
"""File, line, menu, cause (`export_imports.Cause`), words of the twin, and what the line says."""
_SELECTED = re.compile(r"(set \[[^]]*\])?(.*)", re.DOTALL)
_FIRST_NAME = re.compile(r"(?<= )(?=[a-z][a-z.-]*=)")
_UNKNOWN = ("expected end of command", "bad parameter", "bad command name", "not rehearsed", "syntax error")

named = pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)


def text_of(path: Path) -> str:
    return path.read_bytes().decode("utf-8", "surrogateescape")


@cache
def result_of(path: Path) -> Imported:
    return imported(text_of(path))


@pytest.mark.parametrize("path", OWN_FILES, ids=lambda path: path.stem)
def test_refused_lines_are_listed(path: Path) -> None:
    found = [row(path.name, refusal) for refusal in result_of(path).refusals]
    assert found == [line for line in LISTED if line.startswith(f"{path.name}\t")]


def test_at_most_one_percent_of_template_menu_lines_is_refused() -> None:
    total = figures(map(result_of, OWN_FILES))["all"]
    assert total["exports"] == len(OWN_FILES) > 1
    assert total["template_lines"] > 0
    assert total[f"template: {Cause.FALSE}"] <= total["template_lines"] / 100
    assert {line.partition("\t")[0] for line in LISTED} <= {path.name for path in OWN_FILES}


@public
def test_refused_lines_of_public_exports_are_listed() -> None:
    refused = [
        "\t".join((path.name, str(refusal.line.number), refusal.cause, refusal.words))
        for path in PUBLIC_FILES
        for refusal in result_of(path).refusals
    ]
    assert refused == PUBLIC_REFUSED.read_text(encoding="utf-8").splitlines()


@public
def test_at_most_half_a_percent_of_public_lines_since_7_10_is_refused() -> None:
    results = [result_of(path) for path in PUBLIC_FILES]
    total = figures(result for result in results if version_key(result.version) >= version_key("7.10"))["all"]
    assert total["template_lines"] > 900
    assert total[f"template: {Cause.FALSE}"] <= total["template_lines"] * 0.005


@named
def test_emulator_export_survives_import_and_export(path: Path) -> None:
    first = result_of(path).device.export(show_sensitive=True)
    again = Device(spec_of(text_of(path)), lambda: 1000.0)
    # What an adopted router holds beside the defaults, which an export leaves out.
    assert run_file(again.core, SYSTEM, DEFAULTS).error is None
    for line in lines_of(first):
        if "atlantis: management" not in line.text:
            assert run_file(again.core, SYSTEM, f"{line.menu}\n{line.text}").error is None, line
    assert bare(again.export(show_sensitive=True)) == bare(first)


DEFAULTS = "/system note set show-at-login=yes\n/ip service set api-ssl certificate=none\n"


def bare(text: str) -> list[str]:
    """The lines without the header, which holds the time."""
    return [line for line in text.splitlines() if not line.startswith("#")]


@named
def test_a_misspelt_argument_is_refused_on_every_line(path: Path) -> None:
    device = Device(spec_of(text_of(path)), lambda: 1000.0)
    for line in lines_of(text_of(path)):
        selected, row_of = _SELECTED.fullmatch(line.text).groups()  # type: ignore[union-attr]
        misspelt, count = _FIRST_NAME.subn("x-", row_of, count=1)
        misspelt = f"{selected or ''}{misspelt}"
        if count:
            error = run_file(device.core, SYSTEM, f"{line.menu}\n{misspelt}").error
            assert error is not None, misspelt
            assert error.startswith(_UNKNOWN), misspelt


@named
def test_export_file_is_listed_in_the_readme(path: Path) -> None:
    assert f"`{path.name}`" in path.with_name("README.md").read_text(encoding="utf-8")
