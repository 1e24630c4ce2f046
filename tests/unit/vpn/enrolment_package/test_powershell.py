"""The programs for PowerShell, by their grammar: there is no PowerShell for these tests.

A parser that we did not write reads them, and they use a short list of commands and types that Windows PowerShell 5.1
has. What they do on Windows, nobody has seen.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import tree_sitter_powershell
from handout_mint import identity
from test_handout_page import CONTACT, KINDS
from tree_sitter import Language, Node, Parser

from atlantis_netcfg.inventory import load
from atlantis_netcfg.vpn.enrolment_package import contents

FILES = ("self-test.ps1", "setup.ps1")
COMMANDS = {"ConvertFrom-Json", "ForEach-Object", "Get-Content", "Join-Path", "New-Object", "Test-Path", "Write-Host"}
TYPES = {
    "BitConverter",
    "DateTimeOffset",
    "IO.File",
    "Security.Cryptography.SHA256",
    "System.Net.NetworkInformation.NetworkInterface",
    "Text.Encoding",
    "int",
    "long",
    "string",
}
AUTOMATIC = {"args", "input", "matches", "profile", "host", "home", "error", "pid", "pwd"}
"""Variables of PowerShell's own, which a program must not take for its own."""
_PARSER = Parser(Language(tree_sitter_powershell.language()))


def text(name: str) -> str:
    declaration = load(Path(__file__).parents[4] / "inventory")
    return contents(declaration, identity(KINDS["laptop-windows"]), contact=CONTACT)[name]


def nodes(node: Node) -> Iterator[Node]:
    yield node
    for child in node.children:
        yield from nodes(child)


def found(program: str, kind: str) -> set[str]:
    tree = _PARSER.parse(program.encode())
    return {(node.text or b"").decode() for node in nodes(tree.root_node) if node.type == kind}


@pytest.mark.parametrize("name", FILES)
def test_script_has_valid_powershell_syntax(name: str) -> None:
    program = text(name)
    assert not _PARSER.parse(program.encode()).root_node.has_error
    assert program.isascii()  # PowerShell 5.1 reads a file without a mark in the code page of the computer
    assert max(map(len, program.splitlines())) <= 120


@pytest.mark.parametrize("spoil", ["}", "'", "(", "foreach ($x in"])
def test_parser_detects_a_syntax_error(spoil: str) -> None:
    assert _PARSER.parse(f"{text('self-test.ps1')}\n{spoil}\n".encode()).root_node.has_error


def test_script_uses_only_windows_powershell_features() -> None:
    program = text("self-test.ps1")
    own = found(program, "function_name")
    assert own == {"Write-Step", "Test-Echo", "Get-Time"}
    assert found(program, "command_name") - own == COMMANDS
    assert {name.strip("[]") for name in found(program, "type_literal")} == TYPES
    assigned = set(re.findall(r"^\s*\$(\w+) = ", program, re.MULTILINE)) | set(re.findall(r"\]\$(\w+)", program))
    assert {name.lower() for name in assigned} & AUTOMATIC == set()


def test_self_test_has_exactly_one_success_exit() -> None:
    """The only exit with 0 stands below the answer of the server and the absence of every fault."""
    program = text("self-test.ps1")
    assert re.findall(r"exit (\d)", program) == ["0", "6"]
    assert "if ($answered -and ($wrong -eq '')) {" in program.partition("exit 0")[0].splitlines()[-3]
    assert re.findall(r"\$answered = (.*)", program) == ["$false", "Test-Echo $facts.server 56"]


def test_facts_read_by_the_script_exist() -> None:
    program, facts = text("self-test.ps1"), text("self-test.json")
    read = set(re.findall(r"\$facts\.(\w+)", program))
    assert {name for name in read if f'"{name}":' not in facts} == set()
    assert len(read) == 10
