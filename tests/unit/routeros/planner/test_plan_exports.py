"""A device that is as an export says needs nothing to be so; and what of an export cannot be gone back to."""

import re
from pathlib import Path

import pytest
from plan_world import facts, lines

from atlantis_netcfg.routeros._types import Observation, Row
from atlantis_netcfg.routeros.desired import from_export
from atlantis_netcfg.routeros.menus import MENUS, Menu
from atlantis_netcfg.routeros.planner import plan
from atlantis_netcfg.routeros.rsc import Statement, parse

ROOT = Path(__file__).parents[4]
FOLDERS = (
    ROOT / "tests" / "unit" / "routeros" / "rsc" / "golden",
    ROOT / "tests" / "unit" / "emulator" / "routeros" / "golden",
    ROOT / "tests" / "data" / "exports",
    ROOT.parent / "shared" / "data" / "routeros-exports",
)
"""Ours, and where exports of other people's devices are put."""
_VERSION = re.compile(r"RouterOS (\d+\.\d+(?:\.\d+)?)")

ODD = """\
# jan/02/1970 00:00:10 by RouterOS 6.48.3
/interface wireless security-profiles
set [ find default=yes ] authentication-types=wpa2-psk mode=dynamic-keys supplicant-identity=MikroTik
add authentication-types=wpa2-psk mode=dynamic-keys name=ptp supplicant-identity=""
/interface wireless
set [ find default-name=wlan1 ] band=5ghz-a/n disabled=no mode=ap-bridge security-profile=ptp ssid=quay
add disabled=no mac-address=02:00:00:00:00:02 master-interface=wlan1 name=wlan2 security-profile=ptp ssid=guest
/interface list
add name=discover
/interface list member
add interface=ether2 list=discover
add list=discover
/ip dhcp-client
add comment=defconf disabled=no
add disabled=no interface=ether1
/ip dhcp-server network
add dns-server=10.0.0.1,10.0.0.2
add address=10.0.0.0/24 gateway=10.0.0.1
/system logging
set 0 disabled=yes
set 1 topics=error,!debug
add action=echo topics=system
"""
"""What exports of people's devices hold: a built-in row by its flag, a virtual access point, a member of an interface
that has gone, rows without what tells them apart, rows of the system by their number."""


def texts() -> dict[str, str]:
    files = [path for folder in FOLDERS for path in sorted(folder.glob("*.rsc"))]
    read = {
        path.name: path.read_bytes().decode("utf-8", "surrogateescape") for path in files if ".in." not in path.name
    }
    return {**read, "odd": ODD}


def _keys(menu: Menu, statement: Statement) -> dict[str, str]:
    """Return what the device prints of a row because it is that row; `default` marks rows of the system."""
    if statement.find == (("default", "yes"),):
        return {menu.keys[0]: menu.stock[0][0], "default": "true"}
    if statement.target is None:
        found = dict(statement.find or ())
        return found | ({"name": found["default-name"]} if "default-name" in found else {})
    if statement.target.isdecimal() and int(statement.target) < len(menu.stock):
        return {**dict(zip(menu.keys, menu.stock[int(statement.target)], strict=True)), "default": "true"}
    return {menu.keys[0]: statement.target}


def as_it_says(text: str) -> dict[str, tuple[Row, ...]]:
    """Return the rows of a device of which this is the export."""
    found: dict[str, list[Row]] = {path: [] for path in MENUS}
    for statement in parse(text).statements:
        if statement.menu in found:
            rows = found[statement.menu]
            said = {name: value for name, value in statement.values if value is not None}
            rows.append({".id": f"*{len(rows) + 1:X}", **_keys(MENUS[statement.menu], statement), **said})
    return {path: tuple(rows) for path, rows in found.items()}


def version_of(text: str) -> str:
    match = _VERSION.search("\n".join(parse(text).header))
    return match[1] if match else "7.18.2"


@pytest.mark.parametrize("name", texts())
def test_device_matching_its_export_needs_no_changes(name: str) -> None:
    text = texts()[name]
    menus = [menu for menu in parse(text).menus if menu in MENUS]
    desired = from_export(text, menus, name)
    planned = plan("router", desired, Observation(facts(version_of(text)), as_it_says(text)))
    assert lines(planned) == []
    assert menus


def test_restore_keeps_menus_with_indistinguishable_rows() -> None:
    menus = [menu for menu in parse(ODD).menus if menu in MENUS]
    desired = from_export(ODD, menus, "before.rsc")
    gaps = {
        "/interface/wireless",
        "/interface/list/member",
        "/ip/dhcp-client",
        "/ip/dhcp-server/network",
        "/system/logging",
    }
    assert set(menus) - desired.entire == gaps
    assert [note for note in desired.notes if note.endswith("rows that are not in the export are kept")] == [
        f"{MENUS[path].title}: for that reason, rows that are not in the export are kept"
        for path in menus
        if path in gaps
    ]


def test_default_profile_is_restored_and_not_reset() -> None:
    rows = as_it_says(ODD)
    changed = {**rows["/interface/wireless/security-profiles"][0], "mode": "none"}
    rows["/interface/wireless/security-profiles"] = (changed, *rows["/interface/wireless/security-profiles"][1:])
    desired = from_export(ODD, ["/interface/wireless/security-profiles"], "before.rsc")
    planned = plan("router", desired, Observation(facts("6.48.3"), rows))
    assert lines(planned) == ["/interface/wireless/security-profiles/set *1 mode=dynamic-keys"]
