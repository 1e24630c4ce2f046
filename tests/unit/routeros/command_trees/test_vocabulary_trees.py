"""The data itself, and the holes that are known in it."""

import hashlib
from itertools import pairwise

import pytest
from holes import HOLES, SINCE_ABSENT, Hole
from row_subtests import for_each_row
from spoken import lines, sentence, tokens
from trees import PUBLISHED, ROOT, SHIPPED, TREES, VERSIONS, WHOLE, Tree, apply, grown, offered, steps

from atlantis_netcfg.core.versions import NEWEST_KNOWN, Version
from atlantis_netcfg.emulator.routeros.schema import ADDITIONS
from atlantis_netcfg.emulator.routeros.schema import TREES as SHIPPED_BY_TWIN

BESIDE = ROOT.parent / "shared" / "data" / "routeros-inspect"


def test_shipped_trees_match_their_checksums() -> None:
    listed = [line.split() for line in (SHIPPED / "SHA256SUMS").read_text("utf-8").splitlines()]
    sums = {name: digest for digest, name in listed}
    beside = {path.name: path.read_bytes() for path in BESIDE.glob("*.json.gz")}
    for name, digest in sums.items():
        assert hashlib.sha256(beside.get(name, (SHIPPED / name).read_bytes())).hexdigest() == digest
    assert set(sums) == {*(f"{version}.json.gz" for version in WHOLE), "7.21.5.values.json.gz", "changes.json.gz"}


def test_every_change_continues_from_the_previous_tree() -> None:
    """The chain has no gap, and no version twice; a patch that has been applied changes nothing more."""
    assert PUBLISHED[0] in WHOLE
    for before, version in pairwise(PUBLISHED):
        if version not in WHOLE:
            step = steps()[version]
            assert step["after"] == before
            assert grown(version) != grown(before)
            assert apply(grown(version), step["change"]) == grown(version)


def test_patch_adds_and_removes_nodes() -> None:
    tree = {"_type": "dir", "add": {"_type": "cmd", "a": {"_type": "arg"}}, "old": {"_type": "cmd"}}
    patch = {"add": {"b": {"_type": "arg"}}, "old": None}
    assert apply(tree, patch) == {"_type": "dir", "add": {"_type": "cmd", "a": {"_type": "arg"}, "b": {"_type": "arg"}}}
    assert "old" in tree


def test_newest_tree_is_the_newest_known_version() -> None:
    assert str(NEWEST_KNOWN) == PUBLISHED[-1] == SHIPPED_BY_TWIN[-1]
    assert PUBLISHED == SHIPPED_BY_TWIN


@pytest.mark.parametrize(
    ("version", "menus"),
    [("7.16", 522), ("7.18.2", 532), ("7.21.5", 548), ("7.22.2", 552), ("7.23.2", 550), ("7.24", 554)],
)
def test_reader_finds_every_menu(version: str, menus: int) -> None:
    assert len(list(Tree(version).menus())) == menus


def test_the_values_belong_to_commands_of_the_newest_tree() -> None:
    newest = Tree("7.21.5")
    strays = []
    for key in offered():
        path, _, argument = key.rpartition(" ")
        menu, _, command = path.rpartition("/")
        if argument not in newest.arguments(menu or "/", command):
            strays.append(key)
    assert len(offered()) > 5000
    assert len(strays) < len(offered()) // 100


@for_each_row("hole", HOLES, ids=lambda hole: f"{hole.menu} {hole.command} {hole.argument}".strip())
@for_each_row("tree", TREES, ids=VERSIONS)
def test_known_holes_are_absent_from_the_tree(hole: Hole, tree: Tree) -> None:
    if hole.argument:
        assert tree.has_command(hole.menu, hole.command)
        assert hole.argument not in tree.arguments(hole.menu, hole.command)
    elif hole.command:
        assert not tree.has_command(hole.menu, hole.command)
    else:
        assert not tree.has_menu(hole.menu)
    assert hole.why


@pytest.mark.parametrize(("menu", "argument"), SINCE_ABSENT)
def test_arguments_removed_from_the_chr_tree_are_dated_correctly(menu: str, argument: str) -> None:
    gone = Version.parse(SINCE_ABSENT[menu, argument])
    assert [argument in tree.settable(menu) for tree in TREES] == [Version.parse(name) < gone for name in VERSIONS]


def test_every_addition_of_the_emulator_is_a_known_hole() -> None:
    """Its own table of hardware may not name anything that we have not looked at."""
    for row in ADDITIONS:
        absent = [tree for tree in TREES if not tree.has_command(row.menu, row.command)]
        if absent:
            assert any(row.menu == hole.menu or row.menu.startswith(hole.menu + "/") for hole in HOLES), row
            continue
        for name in row.arguments:
            known = any((hole.menu, hole.argument) == (row.menu, name) for hole in HOLES)
            assert known or (row.menu, name) in SINCE_ABSENT, (row.menu, name)


def test_tokens_are_split_as_on_the_console() -> None:
    assert tokens('add comment="a \\" b" [ find x="] y" ] c={ d e }') == [
        "add",
        'comment="a \\" b"',
        '[ find x="] y" ]',
        "c={ d e }",
    ]
    said = list(lines('/ip address\nadd address=1.2.3.4/8 \\\n    comment="x=y"\n:put "a=b"\n', TREES[0]))
    assert [(one.menu, one.command, one.names) for one in said] == [
        ("/ip/address", "add", frozenset({"address", "comment"})),
        ("/", "put", frozenset()),
    ]
    assert sentence(["/ip/address/set", "=.id=*1", "=disabled=yes"]).names == {"numbers", "disabled"}


@pytest.mark.parametrize(
    ("text", "unknown"),
    [
        ("/ip addres\nadd address=1.2.3.4/8", 2),
        ("/ip address\nad address=1.2.3.4/8", 1),
        ("/ip address\nadd adress=1.2.3.4/8", 1),
        ("/ip/route/set [ find commend=x ] gateway=1", 0),
        ("/ip route\nadd blackhole dst-address=1.2.3.4/32", 0),
    ],
)
def test_misspellings_are_detected(text: str, unknown: int) -> None:
    assert sum(bool(said.unknown(TREES[0])) for said in lines(text, TREES[0])) == unknown


def test_blocks_and_several_commands_on_a_line_are_read() -> None:
    text = ':do {\n/ip address/add address=1.2.3.4/8; :put "a;b"\n} on-error={\n}\n'
    text += ":do { /ip route/remvoe [find] } on-error={}\n"
    said = [(one.menu, one.command) for one in lines(text, TREES[0])]
    assert said == [("/ip/address", "add"), ("/", "put"), ("/ip/route", "find"), ("/ip/route", ""), ("/", "do")]
