import gzip
import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from row_subtests import for_each_row

from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.emulator.routeros.menus import MODELLED_MENUS
from atlantis_netcfg.routeros._types import Layer
from atlantis_netcfg.routeros.menus import MENUS, PropertyKind, Shape, canonical
from atlantis_netcfg.routeros.observe import printing

TREES = Path(__file__).parents[4] / "atlantis_netcfg/emulator/routeros/data"

IN_USE = """
/interface/bridge /interface/bridge/port /interface/ethernet /interface/list /interface/list/member
/interface/ovpn-client /ip/address /ip/pool /ip/dhcp-server /ip/dhcp-server/network /ip/dhcp-server/lease
/ip/dhcp-client /ip/dns /ip/dns/static /ip/service /ip/ssh /ip/firewall/address-list /ip/firewall/filter
/ip/firewall/nat /ip/firewall/mangle /ip/route /ip/neighbor/discovery-settings /ip/cloud /ip/proxy /ip/socks
/ip/upnp /ipv6/settings /routing/table /routing/rule /routing/settings /system/identity /system/clock
/system/ntp/client /system/ntp/client/servers /system/scheduler /system/logging /system/logging/action /system/note
/tool/mac-server /tool/mac-server/mac-winbox /tool/mac-server/ping /tool/bandwidth-server /user /user/group
/certificate /interface/wireless /interface/wireless/security-profiles /interface/wireless/connect-list
/interface/wireless/access-list /interface/wifi /interface/wifi/configuration /interface/wifi/channel
/interface/lte /interface/lte/apn /interface/lte/settings /interface/wifi/security /interface/wifi/datapath
/queue/tree /tool/netwatch /ip/settings /snmp /tool/romon
"""

RADIOS = ("/interface/wireless", "/interface/wifi")
"""Lists to the command tree, because of virtual access points; to us the radios of the board."""
NO_MATTER_OF_A_BRIDGE = ("aaa.", "interworking.", "steering.")

# A CHR, from which the trees come, has no PoE; a fixed row's own key is no argument of `set`.
HOLES = {
    "/interface/ethernet": {
        "default-name",
        "poe-out",
        "poe-priority",
        "poe-voltage",
        "power-cycle-interval",
        "power-cycle-ping-address",
        "power-cycle-ping-enabled",
        "power-cycle-ping-timeout",
    },
    "/interface/lte": {"default-name"},
    "/interface/wifi": {"default-name"},
    "/interface/wireless": {"default-name"},
    "/ip/neighbor/discovery-settings": {"lldp-poe-power"},
    "/ip/service": {"name"},
}

# A CHR has no switch chip either; its tree knew these up to 7.20.
LEFT = {"/ip/firewall/filter": {"hw-offload"}, "/ip/route": {"suppress-hw-offload"}}


@cache
def tree(version: str) -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads(gzip.decompress((TREES / f"{version}.json.gz").read_bytes()))
    return loaded


def arguments(version: str, path: str, verb: str) -> set[str]:
    node = tree(version)
    for word in (*path.strip("/").split("/"), verb):
        node = node.get(word, {})
    return {name for name in node if name != "_type"}


def test_menu_table_lists_exactly_the_menus_in_use() -> None:
    assert set(MENUS) == set(IN_USE.split())


@for_each_row("version", ["7.16", "7.18.2", "7.21.5"])
@for_each_row("path", MENUS)
def test_arguments_match_the_command_tree(path: str, version: str) -> None:
    menu = MENUS[path]
    known = arguments(version, path, "add" if menu.shape is Shape.LIST else "set")
    ours = {field.name for field in menu.fields if field.exists(Version.parse(version))}
    assert ours - known == HOLES.get(path, set()) | (LEFT.get(path, set()) if version == "7.21.5" else set())


@for_each_row("path", MENUS)
def test_first_match_and_identified_menus_know_every_argument(path: str) -> None:
    menu = MENUS[path]
    known = arguments("7.21.5", path, "set") - {"numbers"}
    missing = {name for name in known if not name.startswith(NO_MATTER_OF_A_BRIDGE)}
    missing -= {field.name for field in menu.fields}
    expected = {
        "/ip/address": {"netmask"},
        "/interface/ethernet": {"orig-mac-address"},
        "/system/clock": {"date", "time"},
    }
    if not menu.readonly:
        assert missing - {"dynamic"} == expected.get(path, set())


@for_each_row("path", MENUS)
def test_emulator_defaults_agree_with_the_schema(path: str) -> None:
    """It takes names and defaults from the schema; where it says more of an argument, its default is the same."""
    twin = MODELLED_MENUS[path].by_name
    compared = {
        each.name: (each.absent, each.form(twin[each.name].default))
        for each in MENUS[path].fields
        if each.name in twin and not (each.keep and each.default is None) and each.name not in MENUS[path].keys
    }
    assert {name for name, (ours, theirs) in compared.items() if ours != theirs} == set()


@for_each_row("path", MENUS)
def test_shape_matches_the_command_tree(path: str) -> None:
    settable = arguments("7.18.2", path, "set")
    has_add = bool(arguments("7.18.2", path, "add")) and path not in RADIOS
    shape = Shape.LIST if has_add else Shape.FIXED if "numbers" in settable else Shape.SINGLETON
    assert MENUS[path].shape is shape


@for_each_row("path", MENUS)
def test_menu_entry_is_consistent(path: str) -> None:
    menu = MENUS[path]
    names = [field.name for field in menu.fields]
    assert len(set(names)) == len(names)
    assert {*menu.keys, *menu.unique, *dict(menu.late)} <= set(names)
    assert not set(menu.flags) & set(names)
    assert bool(menu.keys) == (menu.shape is not Shape.SINGLETON and not menu.is_ordered)
    assert menu.chain is None or menu.chain in names
    assert all(len(stock) == len(menu.keys) for stock in menu.stock)
    assert menu.layer is not Layer.CLEANUP or menu.shape is not Shape.LIST


@pytest.mark.parametrize(
    ("kind", "spellings"),
    [
        (PropertyKind.BOOLEAN, ("yes", "true")),
        (PropertyKind.BOOLEAN, ("no", "false")),
        (PropertyKind.FLAG, ("", "yes", "true")),
        (PropertyKind.NUMBER, ("32768", "0x8000")),
        (PropertyKind.TIME, ("10m", "600s", "600", "00:10:00")),
        (PropertyKind.TIME, ("9h", "9:00", "09:00:00")),
        (PropertyKind.TIME, ("2s200ms", "2.2", "00:00:02.200")),
        (PropertyKind.TIME, ("1d30m", "1d00:30:00", "24h30m", "88200")),
        (PropertyKind.TIME, ("1w", "7d", "1w00:00:00")),
        (PropertyKind.TIME, ("500ms", "00:00:00.5", "00:00:00.500")),
        (PropertyKind.SIZE, ("2048", "2048KiB", "2MiB", "2048.0KiB")),
        (PropertyKind.MAC, ("48:a9:8a:00:00:01", "48:A9:8A:00:00:01")),
        (PropertyKind.PREFIX, ("10.0.0.1", "10.0.0.1/32")),
        (PropertyKind.PREFIX, ("!10.0.0.1", "!10.0.0.1/32")),
        (PropertyKind.NETWORK, ("10.0.0.5/24", "10.0.0.0/24")),
        (PropertyKind.SET, ("!established,related", "!related,established")),
        (PropertyKind.PREFIXES, ("10.0.0.1,10.1.0.0/16", "10.1.0.0/16,10.0.0.1/32")),
        (PropertyKind.POLICY, ("read,write,!ftp", "write,read")),
        (PropertyKind.GATEWAY, ("10.0.0.1,ether1", "10.0.0.1, ether1")),
    ],
)
def test_spellings_of_one_value_are_equal(kind: PropertyKind, spellings: tuple[str, ...]) -> None:
    assert len({canonical(kind, spelling) for spelling in spellings}) == 1


@pytest.mark.parametrize(
    ("kind", "one", "other"),
    [
        (PropertyKind.TEXT, "yes", "true"),
        (PropertyKind.BOOLEAN, "yes", "auto"),
        (PropertyKind.TIME, "none", "0s"),
        (PropertyKind.PREFIX, "10.0.0.5/24", "10.0.0.0/24"),
        (PropertyKind.SET, "!established", "established"),
        (PropertyKind.SEQUENCE, "1.1.1.1,9.9.9.9", "9.9.9.9,1.1.1.1"),
        (PropertyKind.PREFIX, "10.0.0.1-10.0.0.9", "10.0.0.1"),
        (PropertyKind.NETWORK, "not-an-address", "10.0.0.0/24"),
        (PropertyKind.NUMBER, "auto", "0"),
        (PropertyKind.SIZE, "unlimited", "0"),
    ],
)
def test_different_values_differ(kind: PropertyKind, one: str, other: str) -> None:
    assert canonical(kind, one) != canonical(kind, other)


def test_lists_are_printed_with_a_proplist_and_settings_entirely() -> None:
    """What a version does not know is left out by the device; the names of settings cost more than their values."""
    (named,) = [value for name, value in printing("/user").arguments if name == ".proplist"]
    assert named.split(",")[:2] == [".id", "name"]
    assert "password" not in named.split(",")
    assert printing("/ip/ssh").words() == ("/ip/ssh/print",)


@pytest.mark.parametrize(
    ("path", "values", "name"),
    [
        ("/ip/address", {"address": "10.64.1.1/24", "interface": "bridge-lan"}, "10.64.1.1/24 on bridge-lan"),
        ("/ip/dns", {}, "/ip dns settings"),
        ("/ip/firewall/filter", {"chain": "input", "comment": "atlantis: established"}, "input accept established"),
        ("/ip/route", {"gateway": "10.0.0.1"}, "0.0.0.0/0 via 10.0.0.1"),
    ],
)
def test_row_name_is_human_readable(path: str, values: dict[str, str], name: str) -> None:
    assert MENUS[path].name_of(values) == name


def test_secrets_and_defaults_are_listed() -> None:
    assert MENUS["/interface/ovpn-client"].secrets == {"password"}
    assert MENUS["/ip/dhcp-server"].defaults["lease-time"] == "30m"
    assert MENUS["/ip/service"].default_of("disabled", {"name": "www-ssl"}) == "yes"
    assert MENUS["/ip/service"].default_of("disabled", {"name": "ssh"}) == "no"


@pytest.mark.parametrize(
    ("path", "row", "stock", "touchable"),
    [
        ("/interface/list", {"name": "all", "builtin": "true"}, True, False),
        ("/system/logging", {"topics": "info", "default": "true"}, True, True),
        ("/system/logging", {"topics": "info", "action": "remote"}, False, True),
        ("/ip/address", {"address": "10.0.0.1/24", "dynamic": "true"}, False, False),
    ],
)
def test_rows_of_the_system_are_recognised(path: str, row: dict[str, str], *, stock: bool, touchable: bool) -> None:
    assert MENUS[path].is_stock(row) is stock
    assert MENUS[path].is_touchable(row) is touchable
