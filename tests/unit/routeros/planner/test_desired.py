from pathlib import Path

import pytest
from row_subtests import for_each_row

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.routeros.desired import Mistake, from_export, read

GOLDEN = Path(__file__).parents[2] / "routeros" / "render" / "golden"


def test_rows_keep_menu_order_text_order_and_line_numbers() -> None:
    desired = read("/ip pool\nadd name=b ranges=10.0.0.1\nadd name=a ranges=10.0.0.2\n/ip dns\nset servers=1.1.1.1\n")
    assert desired.menus == ("/ip/pool", "/ip/dns")
    assert [(item.values["name"], item.line) for item in desired.items["/ip/pool"]] == [("b", 2), ("a", 3)]
    assert desired.items["/ip/dns"][0].values == {"servers": "1.1.1.1"}
    assert desired.entire == frozenset()


@pytest.mark.parametrize(
    "directive", ["# atlantis:entire /ip firewall filter", "#atlantis:entire /ip/firewall/filter \r"]
)
def test_directive_claims_a_menu_even_without_rows(directive: str) -> None:
    desired = read(f"{directive}\n")
    assert desired.entire == {"/ip/firewall/filter"}
    assert desired.items == {"/ip/firewall/filter": ()}


def test_a_menu_may_be_opened_twice() -> None:
    text = "/ip address\nadd address=10.0.0.1/24 interface=a\n"
    assert len(read(text + "/ip pool\n" + text.replace("10.0.0.1", "10.0.0.2")).items["/ip/address"]) == 2


@pytest.mark.parametrize(
    ("text", "values", "exists"),
    [
        ("/ip service\nset telnet disabled=yes", {"name": "telnet", "disabled": "yes"}, True),
        ("/ip service\nset [ find name=ssh ] port=22", {"name": "ssh", "port": "22"}, True),
        (
            "/interface ethernet\nset [ find default-name=ether1 ] name=wan",
            {"default-name": "ether1", "name": "wan"},
            True,
        ),
        ("/user group\nset full skin=x", {"name": "full", "skin": "x"}, True),
        ("/routing table\nadd fib name=t", {"fib": "", "name": "t"}, False),
        (
            "/ip dhcp-server network\nadd address=10.0.0.0/24 !next-server",
            {"address": "10.0.0.0/24", "next-server": None},
            False,
        ),
    ],
)
def test_forms_of_identifying_a_row(text: str, values: dict[str, str | None], *, exists: bool) -> None:
    (item,) = next(iter(read(text).items.values()))
    assert (item.values, item.exists) == (values, exists)


MISTAKES = {
    "/ip adress\nadd address=1.1.1.1/24": (
        "x.rsc, line 2: /ip adress is no menu that can be declared; did you mean /ip address?"
    ),
    "/ip dns\nadd servers=1.1.1.1": "x.rsc, line 2: /ip dns holds settings and no rows: write `set` instead of `add`",
    "/ip dns\nset [ find ] servers=1.1.1.1": (
        "x.rsc, line 2: /ip dns holds settings and no rows: write `set name=value` without a row"
    ),
    "/ip service\nadd name=x": (
        "x.rsc, line 2: the rows of /ip service are there already: write `set [ find name=... ]`"
    ),
    "/ip pool\nadd ranges=10.0.0.1": "x.rsc, line 2: a row of /ip pool needs `name`, which tells it from the others",
    "/interface list member\nadd list=LAN": (
        "x.rsc, line 2: a row of /interface list member needs `interface`, which tells it from the others"
    ),
    "/ip pool\nadd name=x\n\nadd name=x": "x.rsc, line 4: x is defined a second time; the first is on line 2",
    "/ip address\nadd address=10.0.0.1 interface=a\nadd address=10.0.0.1/32 interface=b": (
        "x.rsc, line 3: 10.0.0.1/32 on b is defined a second time; the first is on line 2"
    ),
    "/system ntp client\nset enabled=yes\nset mode=unicast": (
        "x.rsc, line 3: /system ntp client settings is defined a second time; the first is on line 2"
    ),
    "/ip pool\nadd name=x rnages=1": "x.rsc, line 2: /ip pool has no argument `rnages`; did you mean ranges?",
    "/ip pool\nadd name=x name=y": "x.rsc, line 2: `name` is given twice",
    "/ip pool\nset 0 name=x": ("x.rsc, line 2: `0` is another row on another router: write `set [ find name=... ]`"),
    "/ip pool\nset *3 name=x": ("x.rsc, line 2: `*3` is another row on another router: write `set [ find name=... ]`"),
    "/ip pool\nset ranges=x": "x.rsc, line 2: a row of /ip pool is found by its name: write `[ find name=... ]`",
    "/ip pool\nset [ find comment=x ] ranges=x": (
        "x.rsc, line 2: a row of /ip pool is found by its name: write `[ find name=... ]`"
    ),
    "/ip pool\nset [ find name=x ] name=y": (
        "x.rsc, line 2: `name` tells the rows of /ip pool apart and cannot be changed: declare a new row"
    ),
    "/ip firewall filter\nset [ find ] action=drop": (
        "x.rsc, line 2: rows of /ip firewall filter have no name to find them by: declare them with `add`"
    ),
    "/ip firewall filter\nremove 0": ("x.rsc, line 2: `remove` is not allowed in a declaration: write `add` or `set`"),
    "/certificate\nadd name=x common-name=x": "x.rsc, line 2: /certificate can be looked at, but not declared",
    "# atlantis:entier /ip pool": "x.rsc, line 1: unknown directive `atlantis:entier`; did you mean entire?",
    "# atlantis:run-time /ip route distance=1": "x.rsc, line 1: write `atlantis:run-time /menu property=declared"
    " property=instead`",
    "# atlantis:run-time /ip route distance=1 disabled=no": "x.rsc, line 1: write `atlantis:run-time /menu"
    " property=declared property=instead`",
    "# atlantis:run-time /ip route distanse=1 distanse=2": "x.rsc, line 1: /ip route has no argument `distanse`; did"
    " you mean distance?",
    "# atlantis:run-time /ip rout distance=1 distance=2": "x.rsc, line 1: /ip rout is no menu that can be declared;"
    " did you mean /ip route?",
    "\n# atlantis:entire /ip pol": "x.rsc, line 2: /ip pol is no menu that can be declared; did you mean /ip pool?",
    "# atlantis:entire /ip dns": "x.rsc, line 1: /ip dns cannot be managed entirely, because nobody can add rows to it",
}


@for_each_row("text", MISTAKES)
def test_mistake_names_the_line_and_the_correction(text: str) -> None:
    with pytest.raises(Mistake) as caught:
        read(text, "x.rsc")
    assert str(caught.value) == MISTAKES[text]
    assert caught.value.exit is ExitCode.USAGE


def test_all_mistakes_of_a_text_are_reported_together() -> None:
    with pytest.raises(Mistake) as caught:
        read("# atlantis:entire /x\n/ip pool\nadd\n/ip dns\nadd servers=x\n")
    assert [line.split(":")[0] for line in str(caught.value).splitlines()] == [
        "text, line 1",
        "text, line 3",
        "text, line 5",
    ]


@pytest.mark.parametrize("path", sorted(GOLDEN.glob("*-router.rsc")), ids=lambda path: path.stem)
def test_the_texts_of_our_sites_can_be_read(path: Path) -> None:
    desired = read(path.read_text(encoding="utf-8"), path.name)
    assert "/ip/firewall/filter" in desired.entire
    assert len(desired.items["/ip/firewall/filter"]) > 10


EXPORT = """\
# 2026-01-01 12:00:00 by RouterOS 7.18.2
/interface ovpn-client
add connect-to=vpn.example.org name=vpn user=x
/system logging action
set 3 remote=10.0.0.1
/system logging
set 0 topics=info,!debug
/ip pool
add name=a ranges=10.0.0.1 colour=blue
"""


def test_export_defines_entire_menus_except_hidden_values() -> None:
    only = ["/interface/ovpn-client", "/ip/pool", "/system/logging/action", "/ip/dns", "/user"]
    desired = from_export(EXPORT, only, "before.rsc")
    assert desired.restores
    assert desired.entire == set(only) - {"/user"}
    assert desired.items["/interface/ovpn-client"][0].unknown == {"password"}
    assert desired.items["/system/logging/action"][0].defined_values == {"name": "remote", "remote": "10.0.0.1"}
    assert desired.items["/ip/dns"] == ()
    assert desired.items["/ip/pool"][0].defined_values == {"name": "a", "ranges": "10.0.0.1"}
    assert desired.notes == (
        "/user is not part of an export: left unchanged",
        "before.rsc, line 9: `colour` of /ip pool is left unchanged",
    )


def test_indistinguishable_export_rows_are_left_with_a_note() -> None:
    desired = from_export(EXPORT, ["/system/logging"])
    assert desired.items["/system/logging"] == ()
    assert desired.notes == (
        (
            "export, line 7: not restored: `0` is another row on another router: "
            "write `set [ find topics=... action=... prefix=... ]`"
        ),
    )
