"""The vocabulary: RouterOS' own trees, what they lack, and our table of menus held against them."""

import hashlib
import re
from importlib import resources

import pytest
from row_subtests import for_each_row

from atlantis_netcfg.emulator.routeros.menus import EXPORT_ORDER, MODELLED_MENUS, Shape
from atlantis_netcfg.emulator.routeros.menus._references import reference
from atlantis_netcfg.emulator.routeros.schema import TREES, Schema, features_of, offered_values, version_key

EVERYTHING = frozenset({"poe", "routerboard"})
DATA = resources.files("atlantis_netcfg.emulator.routeros").joinpath("data")


def test_data_files_match_checksums_and_readme() -> None:
    sums = DATA.joinpath("SHA256SUMS").read_text(encoding="utf-8")
    listed = {name: digest for digest, name in (line.split() for line in sums.splitlines())}
    assert len(listed) == 5
    for name, digest in listed.items():
        assert hashlib.sha256(DATA.joinpath(name).read_bytes()).hexdigest() == digest
        assert name in DATA.joinpath("README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("version", "tree"),
    [
        ("6.49.18", "7.16"),
        ("7.9", "7.16"),
        ("7.16", "7.16"),
        ("7.17.1", "7.17"),
        ("7.18beta2", "7.17"),
        ("7.18", "7.18.2"),
        ("7.18.1", "7.18.2"),
        ("7.18.2", "7.18.2"),
        ("7.20", "7.20"),
        ("7.20.3", "7.20.1"),
        ("7.22", "7.22"),
        ("7.22.3", "7.22.2"),
        ("7.23rc4", "7.22.2"),
        ("7.23.3", "7.23.2"),
        ("7.24", "7.24"),
        ("7.25", "7.24"),
    ],
)
def test_newest_schema_not_newer_than_the_version_is_used(version: str, tree: str) -> None:
    assert Schema(version).tree == tree


def test_versions_are_ordered() -> None:
    versions = ["7.9", "7.16", "7.18beta2", "7.18rc1", "7.18", "7.18.2", "7.20"]
    assert sorted(versions, key=version_key) == versions
    with pytest.raises(ValueError, match="not a RouterOS version: latest"):
        version_key("latest")


@pytest.mark.parametrize(
    ("version", "menu", "command", "argument"),
    [
        ("7.16", "/safe-mode", "take", None),
        ("7.17.1", "/safe-mode", "take", None),
        ("6.49.18", "/safe-mode", "take", None),
        ("7.16", "/system/device-mode", "update", "routerboard"),
        ("6.49.18", "/system/device-mode", "update", None),
        ("7.18.2", "/routing/settings", "set", "check-gateway-ping-count"),
        ("7.18.2", "/ip/dhcp-client", "set", "check-gateway"),
        ("7.12", "/file", "read", None),
        ("7.11", "/routing/settings", "set", None),
        ("6.49.18", "/routing/table", "add", None),
        ("6.49.18", "/ip/route", "add", "routing-table"),
        ("6.49.18", "/interface/ovpn-client", "add", "protocol"),
        ("7.8", "/", "execute", "as-string"),
        ("7.19.6", "/user/active", "remove", None),
        ("7.20.8", "/ip/ssh", "set", "password-authentication"),
    ],
)
def test_commands_and_arguments_added_later(version: str, menu: str, command: str, argument: str | None) -> None:
    old, new = Schema(version), Schema("7.21.5")
    assert new.has_command(menu, command)
    if argument is None:
        assert not old.has_command(menu, command)
    else:
        assert argument in new.arguments(menu, command) - old.arguments(menu, command)


@pytest.mark.parametrize(
    ("last", "first", "menu", "command", "argument"),
    [
        ("7.16", "7.17", "/ip/ssh", "set", "allow-none-crypto"),
        ("7.19.6", "7.20", "/user/active", "request-logout", None),
        ("7.20.8", "7.21", "/ip/ssh", "set", "always-allow-password-login"),
        ("7.22", "7.23", "/", "ping", None),
    ],
)
def test_commands_and_arguments_that_were_removed(
    last: str, first: str, menu: str, command: str, argument: str | None
) -> None:
    old, new = Schema(last), Schema(first)
    assert old.has_command(menu, command)
    if argument is None:
        assert not new.has_command(menu, command)
    else:
        assert argument in old.arguments(menu, command) - new.arguments(menu, command)


@for_each_row(
    ("last_without", "first_with", "menu", "command", "argument"),
    [
        ("7.10.2", "7.11.3", "/tool/netwatch", "add", "src-address"),
        ("7.12.2", "7.13", "/interface/wifi", "print", None),
        ("7.12.2", "7.13", "/file", "read", None),
        ("7.12.2", "7.13", "/", "export", "where"),
        ("7.15.3", "7.16", "/", "import", "dry-run"),
        ("7.15.3", "7.16", "/ip/service", "set", "max-sessions"),
        ("7.16.2", "7.17", "/system/device-mode", "update", "routerboard"),
        ("7.16.2", "7.17", "/tool/netwatch", "add", "ignore-initial-up"),
        ("7.17.1", "7.18", "/safe-mode", "take", None),
        ("7.17.1", "7.18", "/ip/dhcp-client", "add", "default-route-tables"),
        ("7.17.1", "7.18", "/system/package", "apply-changes", None),
        ("7.18.2", "7.19", "/ip/dhcp-client", "add", "check-gateway"),
        ("7.18.2", "7.19", "/interface/lte/settings", "set", "link-recovery-timer"),
        ("7.19.6", "7.20", "/tool/netwatch", "add", "early-success-detection"),
        ("7.20.8", "7.21", "/ip/ssh", "set", "password-authentication"),
        ("7.20.8", "7.21", "/routing/settings", "set", "check-gateway-ping-timeout"),
        ("7.21.5", "7.22", "/ip/dhcp-client", "add", "name"),
        ("7.22", "7.23", "/", "export", "path"),
        ("7.21.5", "7.22", "/routing/rule", "add", "chain"),
        ("7.21.5", "7.22", "/routing/settings", "set", "policy-rules"),
        ("7.16.2", "7.17", "/interface/wifi", "set", "configuration.installation"),
        ("7.23.3", "7.24", "/system/scheduler", "add", "days"),
    ],
)
def test_version_boundaries(last_without: str, first_with: str, menu: str, command: str, argument: str | None) -> None:
    """The versions on which our code depends, by the first published tree that shows the name."""
    old, new = Schema(last_without), Schema(first_with)
    if argument is None:
        assert new.has_command(menu, command)
        assert not old.has_command(menu, command)
    else:
        assert argument in new.arguments(menu, command)
        assert argument not in old.arguments(menu, command)


def test_missing_menu_has_no_submenus_or_commands() -> None:
    old = Schema("6.49.18")
    assert not old.has_menu("/interface/wifi/security")
    assert "wifi" not in old.submenus("/interface")
    assert "settings" not in Schema("7.11").submenus("/routing")
    assert old.arguments("/routing/table", "add") == frozenset()
    assert old.commands("/routing/table") == frozenset()


def test_wireless_is_built_in_up_to_7_12() -> None:
    assert Schema("7.12").has_menu("/interface/wireless")
    assert not Schema("7.13").has_menu("/interface/wireless")


def test_menus_depend_on_board_and_packages() -> None:
    plain, board = Schema("7.18.2"), Schema("7.18.2", features=EVERYTHING)
    assert not plain.has_menu("/interface/ethernet/poe")
    assert board.has_menu("/interface/ethernet/poe")
    assert "poe" in board.submenus("/interface/ethernet")
    assert "hw-offload" in Schema("7.21.5", features=EVERYTHING).arguments("/ip/firewall/filter", "add")
    assert "poe-out" in board.arguments("/interface/ethernet", "set") - plain.arguments("/interface/ethernet", "set")
    assert not plain.has_menu("/interface/wireless")
    assert Schema("7.18.2", ("routeros", "wireless")).has_menu("/interface/wireless")
    assert "wireless" not in plain.submenus("/interface")
    assert features_of("CHR", poe=False) == frozenset()
    assert features_of("RB5009UPr+S+", poe=True) == EVERYTHING


@for_each_row("menu", MODELLED_MENUS.values(), ids=MODELLED_MENUS.keys())
def test_modelled_menus_and_arguments_exist_in_the_schema(menu: object) -> None:
    known: set[str] = {"name"} if menu.path == "/ip/service" else set()  # type: ignore[attr-defined]
    for version in TREES:
        schema = Schema(version, ("routeros", "wireless"), EVERYTHING)
        assert schema.has_menu(menu.path)  # type: ignore[attr-defined]
        known |= schema.arguments(menu.path, "add") | schema.arguments(menu.path, "set")  # type: ignore[attr-defined]
    shared = {"connection-", "layer7", "p2p", "realm", "reject-with", "routing-mark", "tcp-flags", "tls-host"}
    odd = {name for name in menu.by_name if name not in known}  # type: ignore[attr-defined]
    assert not {name for name in odd if not name.startswith(tuple(shared))}


@for_each_row("path", MODELLED_MENUS)
def test_menu_shapes_match_the_schema(path: str) -> None:
    schema = Schema("7.21.5", ("routeros", "wireless"), EVERYTHING)
    if "add" in schema.commands(path):
        expected = Shape.LIST
    else:
        expected = Shape.FIXED_ROWS if "numbers" in schema.arguments(path, "set") else Shape.SETTINGS
    assert MODELLED_MENUS[path].shape is expected


def test_export_order_covers_every_exported_menu() -> None:
    assert {path for path, menu in MODELLED_MENUS.items() if menu.is_exported} == set(EXPORT_ORDER)


def test_reference_arguments_are_derived_from_offered_values() -> None:
    named = {
        ("/queue/tree", "queue"): ("/queue/type",),
        ("/ip/hotspot", "profile"): ("/ip/hotspot/profile",),
        ("/ip/hotspot/user", "profile"): ("/ip/hotspot/user/profile",),
        ("/ip/ipsec/identity", "policy-template-group"): ("/ip/ipsec/policy/group",),
        ("/routing/bgp/connection", "templates"): ("/routing/bgp/template",),
        ("/interface/bridge/vlan", "tagged"): ("interface", "list"),
        ("/interface/vlan", "interface"): ("interface",),
        ("/interface/detect-internet", "wan-interface-list"): ("list",),
    }
    assert {argument: reference(*argument).spaces for argument in named} == named  # type: ignore[union-attr]
    words = ("system/logging/action target", "interface/vlan loop-protect", "ppp/profile use-encryption")
    free = ("routing/ospf/instance router-id", "ip/hotspot/profile html-directory", "interface/gre6 remote-address")
    assert [reference(f"/{menu}", name) for menu, name in map(str.split, (*words, *free))] == [None] * 6


def test_offered_values() -> None:
    assert "fasttrack-connection" in offered_values("/ip/firewall/filter", "action")
    assert not [value for value in offered_values("/ip/firewall/filter", "protocol") if re.search("[!,]", value)]
    assert offered_values("/ip/firewall/filter", "comment") == ()
