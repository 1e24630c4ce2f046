"""Every row refers only to what stands further up: the text can be pasted from top to bottom."""

import pytest
from render_declared import SITES
from test_render_text import parsed

from atlantis_netcfg.routeros.planner._firstmatch import Rule, insertion
from atlantis_netcfg.routeros.rsc import Statement

BUILT_IN = {
    "interface": {*(f"ether{number}" for number in range(1, 9)), "wifi1"},
    "list": {"all", "none", "dynamic", "static"},
    "table": {"main"},
    "log action": {"memory", "disk", "echo", "remote"},
    "chain": {"input", "forward", "output"},
}
DEFINES = {
    "/interface/bridge": ("interface", "name"),
    "/interface/ovpn-client": ("interface", "name"),
    "/interface/list": ("list", "name"),
    "/ip/pool": ("pool", "name"),
    "/ip/dhcp-server": ("dhcp server", "name"),
    "/ip/firewall/address-list": ("addresses", "list"),
    "/routing/table": ("table", "name"),
}
REFERS = {
    "address-pool": "pool",
    "allowed-interface-list": "list",
    "bridge": "interface",
    "discover-interface-list": "list",
    "dst-address-list": "addresses",
    "in-interface": "interface",
    "in-interface-list": "list",
    "interface": "interface",
    "out-interface": "interface",
    "out-interface-list": "list",
    "routing-table": "table",
    "server": "dhcp server",
    "src-address-list": "addresses",
    "table": "table",
}


def references(row: Statement) -> dict[str, str]:
    found = {name: kind for name, kind in REFERS.items() if row.get(name) is not None}
    if row.menu == "/interface/list/member":
        found["list"] = "list"
    if row.menu == "/system/logging":
        found["action"] = "log action"
    if (row.get("gateway") or "0")[0].isalpha():
        found["gateway"] = "interface"
    return found


@pytest.mark.parametrize("site", SITES)
def test_rows_refer_only_to_earlier_rows(site: str) -> None:
    known = {kind: set(names) for kind, names in BUILT_IN.items()}
    count = 0
    for row in parsed(site).statements:
        for name, kind in references(row).items():
            value = str(row.get(name)).removeprefix("!")
            assert value in known.get(kind, ()), f"{row.menu}: {name}={value} is not there yet"
            count += 1
        if row.menu in DEFINES:
            kind, column = DEFINES[row.menu]
            known.setdefault(kind, set()).add(str(row.get(column)))
    assert count > 50


@pytest.mark.parametrize("site", SITES)
def test_every_defined_name_is_used(site: str) -> None:
    rows = parsed(site).statements
    used = {(kind, str(row.get(name)).removeprefix("!")) for row in rows for name, kind in references(row).items()}
    named = {(DEFINES[row.menu][0], str(row.get(DEFINES[row.menu][1]))) for row in rows if row.menu in DEFINES}
    assert named <= used


@pytest.mark.parametrize("site", SITES)
def test_every_chain_is_called_and_ends_in_a_drop(site: str) -> None:
    rows = [row for row in parsed(site).statements if row.menu == "/ip/firewall/filter"]
    chains = {str(row.get("chain")) for row in rows}
    entered = {str(row.get("jump-target")) for row in rows if row.get("action") == "jump"}
    assert chains - BUILT_IN["chain"] == entered
    for chain in chains - {"output"}:
        last = [row for row in rows if row.get("chain") == chain][-2:]
        assert [row.get("action") for row in last] == ["log", "drop"]
        assert last[0].get("limit") == "10/1m,5:packet"
        assert all(name in ("action", "chain", "comment") for name, _ in last[1].values)


@pytest.mark.parametrize("site", SITES)
def test_rules_are_in_insertion_order(site: str) -> None:
    """A chain stands whole where it is jumped to, so that the router holds its rules in the order of the text."""
    rows = [row for row in parsed(site).statements if row.menu == "/ip/firewall/filter"]
    jumps = [row.get("jump-target") if row.get("action") == "jump" else None for row in rows]
    rules = [Rule(row.get("chain") or "", target, stays=False) for row, target in zip(rows, jumps, strict=True)]
    assert rules
    assert insertion(rules) == list(range(len(rules)))
