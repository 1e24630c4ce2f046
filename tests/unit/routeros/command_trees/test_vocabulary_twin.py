"""The twin has every word of its version's tree and refuses all others in the router's words: whole, not samples."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from trees import TREES, VERSIONS, Tree

from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.emulator.routeros import Device, RouterSpec
from atlantis_netcfg.emulator.routeros.schema import PACKAGE_MENUS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.emulator.routeros.answers import Caller

PACKAGES = ("routeros", *dict.fromkeys(package for package, _ in PACKAGE_MENUS))
STRANGE = "zz-nonsense"
FORBIDDEN = "failure: not allowed by device-mode"
"""What the twin may say of a command that it has, before it comes to the argument that is none."""
SESSION = ("/quit",)
"""Ends the session, whatever is said with it (manual, API)."""


class Bare:
    """A twin of a version with every package and without hardware of its own: what the trees were taken from."""

    def __init__(self, version: str) -> None:
        spec = RouterSpec(name="chr", version=version, packages=PACKAGES, board="CHR", poe_ports=())
        self.device = Device(spec, lambda: 0.0)
        self.caller: Caller = self.device.login("provision", "", via="api-ssl", address=str(spec.management.technician))

    def says(self, *words: str) -> str:
        """Return the message of the refusal, empty if there was none."""
        answers = self.device.run(self.caller, words)
        messages = [
            word.removeprefix("=message=") for answer in answers for word in answer.words if "=message=" in word
        ]
        return messages[0] if messages else ""


BARE = {version: Bare(version) for version in VERSIONS}


def commands(tree: Tree) -> Iterator[tuple[str, str, str]]:
    """Yield menu, command and path of everything."""
    for menu in ("/", *tree.menus()):
        for command in sorted(tree.commands(menu)):
            yield menu, command, f"{menu.rstrip('/')}/{command}"


@pytest.mark.smoke("7.18.2")
@pytest.mark.parametrize("tree", TREES, ids=VERSIONS)
def test_every_command_is_known_and_refuses_an_invalid_argument(tree: Tree) -> None:
    bare, odd, count = BARE[tree.version], {}, 0
    for _, _, path in commands(tree):
        if path in SESSION:
            continue
        count += 1
        said = bare.says(path, f"={STRANGE}=1")
        if said != f"unknown parameter {STRANGE}" and not said.startswith(FORBIDDEN):
            odd[path] = said
    assert odd == {}
    assert count > 4500


@pytest.mark.smoke("7.18.2")
@pytest.mark.parametrize("tree", TREES, ids=VERSIONS)
def test_every_argument_is_known(tree: Tree) -> None:
    bare, odd, count = BARE[tree.version], {}, 0
    for menu, command, path in commands(tree):
        if path in SESSION:
            continue
        for name in sorted(tree.arguments(menu, command)):
            count += 1
            said = bare.says(path, f"={name}=", f"={STRANGE}=1")
            if said in ("", "no such command", "no such command prefix", f"unknown parameter {name}"):
                odd[f"{path} {name}"] = said
    assert odd == {}
    assert count > 29_000


@pytest.mark.smoke("7.18.2")
@pytest.mark.parametrize("tree", TREES, ids=VERSIONS)
def test_commands_of_other_versions_only_are_refused(tree: Tree) -> None:
    """The nearest thing to a misspelling: a name that is right, but not in this version."""
    bare, taken, count = BARE[tree.version], [], 0
    for other in TREES:
        for menu, command, path in commands(other):
            if not tree.has_menu(menu):
                expected = "no such command prefix"
            elif not tree.has_command(menu, command):
                expected = "no such command"
            else:
                for name in other.arguments(menu, command) - tree.arguments(menu, command):
                    count += 1
                    said = bare.says(path, f"={name}=")
                    if said != f"unknown parameter {name}":
                        taken.append((path, name, said))
                continue
            count += 1
            said = bare.says(path)
            if said != expected:
                taken.append((path, "", said))
    assert taken == []
    assert count > 300


WORDS = sorted({word for _, command, path in commands(TREES[1]) for word in (command, *path.split("/")[1:])})
"""Every word of a middle tree: in the wrong place each is as good as a misspelling."""
_LETTERS = "abcdefghijklmnopqrstuvwxyz-"


@st.composite
def misspelt(draw: st.DrawFn) -> str:
    """Draw a word with one letter more, less or other."""
    word: str = draw(st.sampled_from(WORDS))
    place = draw(st.integers(0, len(word)))
    letter: str = draw(st.sampled_from(["", *_LETTERS]))
    return word[:place] + letter + word[place + draw(st.integers(0, 1)) :]


@settings(max_examples=3 * settings().max_examples)
@given(
    version=st.sampled_from(VERSIONS),
    path=st.lists(st.one_of(st.sampled_from(WORDS), misspelt()), min_size=1, max_size=3),
    command=st.one_of(st.sampled_from(WORDS), misspelt()),
)
def test_invalid_paths_are_refused(version: str, path: list[str], command: str) -> None:
    tree, menu = Tree(version), "/" + "/".join(word for word in path if word)
    if not all(path) or not command or f"{menu}/{command}" in SESSION:
        return
    said = BARE[version].says(f"{menu}/{command}", f"={STRANGE}=1")
    if not tree.has_menu(menu):
        assert said == "no such command prefix"
    elif not tree.has_command(menu, command) and command not in ("getall", "listen"):
        assert said == "no such command"
    else:
        assert said not in ("no such command", "no such command prefix")


@settings(max_examples=3 * settings().max_examples)
@given(data=st.data(), version=st.sampled_from(VERSIONS))
def test_arguments_of_other_commands_are_refused(data: st.DataObject, version: str) -> None:
    tree = Tree(version)
    menu = data.draw(st.sampled_from([menu for menu in tree.menus() if tree.settable(menu)]))
    command = "add" if "add" in tree.commands(menu) else "set"
    name = data.draw(st.one_of(misspelt(), st.sampled_from(WORDS)))
    if not name or name in tree.arguments(menu, command):
        return
    assert BARE[version].says(f"{menu}/{command}", f"={name}=1") == f"unknown parameter {name}"


@pytest.mark.smoke("7.18.2")
@pytest.mark.parametrize("tree", TREES, ids=VERSIONS)
def test_console_refusals_have_the_exact_text(tree: Tree) -> None:
    """Every seventh command of the tree, misspelt in three ways; the column is that of the wrong word."""
    odd: dict[str, str] = {}
    bare, count = BARE[tree.version], 0
    for place, (menu, command, path) in enumerate(commands(tree)):
        # The root's commands are words of the scripting language, with a grammar of their own.
        if place % 7 or menu == "/":
            continue
        count += 1
        wrong_menu = menu.rpartition("/")[2] + "zz"
        expected = {
            f"{path}zz": f"bad command name {command}zz (line 1 column {len(menu) + 2})",
            f"{menu}zz/{command}": f"bad command name {wrong_menu} (line 1 column {len(menu) - len(wrong_menu) + 3})",
        }
        if command != "find":  # which takes names of properties, too
            column, words = len(path) + 2, "expected end of command"
            if Version.parse(tree.version) >= Version(7, 23):
                column, words = column + len(STRANGE), f"bad parameter {STRANGE}"
            expected[f"{path} {STRANGE}=1"] = f"{words} (line 1 column {column})"
        said = {line: bare.device.type(bare.caller, line).text.strip() for line in expected}
        odd |= {line: words for line, words in said.items() if words != expected[line]}
    assert odd == {}
    assert count > 500
