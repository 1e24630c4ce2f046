"""Every text in the engine and its neighbours that looks like a command is one, in each version that may hear it."""

import re

import pytest
from holes import known
from literals import Literal, literals, sentences
from spoken import Said, lines, sentence
from trees import TREES, VERSIONS, Tree, parts

from atlantis_netcfg.links.wifi import Family

SINCE = {"/safe-mode": ("7.18.2", "asked for on every version, because that is how we learn whether it is there")}
"""Menus that not all of our versions have."""
NO_COMMANDS = {
    "/atlantis/configuration": "a topic of ROS",
    "/add": "a suffix that is taken off",
    "/interface/wi": "a prefix by which the menus of radios are told",
    "/dev/[\\w./-]+": "the pattern of a serial port's path in a Linux host",
    "/interface/X/print": "the menu of either family of radios, which `test_radio_menus_can_be_printed` looks up",
    "/dev/disk/by-id/usb-…": "the path of a card in a technician's computer",
    "/var/tmp": "a folder of that computer",  # noqa: S108 - nothing is made in it here
    "/system/identity/set atlantis=no": "what every parser has to refuse, to show that it looks at names",
    "/atlantis": "the same of menus",
    "/ip/address/add atlantis=x": "what is compared with a name that is cut short",
    "/ip/address/add co=x": "a name that is cut short, for which the parser is asked",
    "/nonexistent": "the home of users who have none",
    "/quit": "a word of the console's own, which the trees show at the root only as a script's word",
}
_MENU_TO_A_PERSON = re.compile(r"(/[a-z0-9 -]+): \S")
_PUT_IN = re.compile(r"(?:/ )?X\b")
_OF_A_COMPUTER = re.compile(r"/(dev|etc|home|media|opt|srv|sys|usr|var)/|/data$")
"""Paths of gateways and laptops; RouterOS has no menu of these names."""
_OPEN_END = re.compile(r"/X$")


def words_of(literal: Literal) -> str:
    """Return the text with something in place of what is only known at run time."""
    text = re.sub(r"(?<=[a-z])X\b", "", literal.text)
    return text.replace("[X ", "[/ip/address ")


def unknown(literal: Literal, tree: Tree) -> set[str]:
    """Return what the version does not have of a text."""
    text = words_of(literal)
    if literal.text in NO_COMMANDS or _OF_A_COMPUTER.match(text) or known(text) or known("/", text.removeprefix("/")):
        return set()
    if any(text.startswith(menu) and tree.version < first for menu, (first, _) in SINCE.items()):
        return set()
    for pattern in (_MENU_TO_A_PERSON, _OPEN_END):
        if match := pattern.search(text):
            menu = match[1] if pattern is _MENU_TO_A_PERSON else text[: match.start()]
            return set() if tree.has_menu(menu.replace(" ", "/")) else {menu}
    # A statement that begins with what is put in at run time is read where it is said (see `heard.py`).
    return {name for said in lines(text, tree) if not _PUT_IN.match(said.text) for name in said.unknown(tree)}


@pytest.mark.smoke("7.18.2")
@pytest.mark.parametrize("tree", TREES, ids=VERSIONS)
def test_every_literal_is_a_known_command_or_menu(tree: Tree) -> None:
    odd = {}
    for literal in literals():
        if not literal.text.startswith("X/") and (found := unknown(literal, tree)):
            odd[f"{literal.file}:{literal.line}"] = found
    assert odd == {}
    assert len(literals()) > 150


@pytest.mark.smoke("7.18.2")
@pytest.mark.parametrize("tree", TREES, ids=VERSIONS)
def test_no_menu_resembles_a_file_system_path(tree: Tree) -> None:
    assert not any(tree.has_menu(name) for name in ("/etc", "/media", "/opt", "/srv", "/usr", "/var"))


@pytest.mark.smoke("7.18.2")
@pytest.mark.parametrize("tree", TREES, ids=VERSIONS)
def test_radio_menus_can_be_printed(tree: Tree) -> None:
    assert all("print" in tree.commands(f"/interface/{family}") for family in Family)


def test_every_menu_suffix_is_known_in_every_version() -> None:
    """`X/print`: which menu it is, is known at run time; the word has to be in some menu of every version."""
    ends = {literal.text.removeprefix("X/") for literal in literals() if literal.text.startswith("X/")}
    for tree in TREES:
        there = {word for menu in tree.menus() for word in (*tree.commands(menu), *parts(menu))}
        assert ends <= there
    assert ends


@pytest.mark.smoke("7.18.2")
@pytest.mark.parametrize("tree", TREES, ids=VERSIONS)
def test_sentences_that_are_written_out_have_known_arguments(tree: Tree) -> None:
    odd, count = {}, 0
    for place, names in sentences():
        menu, _, command = place.text.rpartition("/")
        if "X" in place.text or known(menu or "/", command) or (menu in SINCE and tree.version < SINCE[menu][0]):
            continue
        count += 1
        said = sentence([place.text, *(f"={name}=" for name in names if not name.startswith("?"))])
        if found := said.unknown(tree):
            odd[f"{place.file}:{place.line}"] = found
    assert odd == {}
    assert count >= 8


def test_misspelt_command_in_the_source_would_be_detected() -> None:
    for text in (
        "/system/resourse/print",
        ":putt x",
        "/ip adress: it would go",
        "/ip/routes",
        ":put [/ip/address prnt]",
    ):
        assert unknown(Literal(text, "x.py", 1), TREES[1])
    assert Said("/ip/address", "print", frozenset({"prop"}), "x").unknown(TREES[1]) == {"prop"}


def test_menus_listed_as_newer_are_newer() -> None:
    for menu, (first, why) in SINCE.items():
        assert [tree.has_menu(menu) for tree in TREES] == [tree.version >= first for tree in TREES]
        assert why
