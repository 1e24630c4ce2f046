"""The hints of the source that name a command, and the register of the tests that type them."""

import ast
import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from atlantis_netcfg.cli.base.commands import COMMANDS, choose, load
from atlantis_netcfg.cli.base.syntax import parse
from atlantis_netcfg.core.errors import NetcfgError

CHECKOUT = Path(__file__).resolve().parents[4]
PACKAGE = CHECKOUT / "atlantis_netcfg"
REGISTER = CHECKOUT / "tests" / "data" / "hints.tsv"
_FIRST_WORDS = "|".join(sorted({re.escape(name.split()[0]) for name in COMMANDS} | {"site=", r"\{\}"}))
COMMAND = re.compile(rf"\bprovision (?:{_FIRST_WORDS})")
_HELP = {"CommandSpec", "Word", "Flag"}
"""What these are given is printed by `--help`: nobody is in a situation there."""
_OF_FILES = re.compile(r"^(#!|# )")
"""Text that is laid down on a computer."""


@dataclass(frozen=True, order=True)
class Hint:
    """A text of the source with a command in it; `{}` stands for what is filled in."""

    file: str
    text: str


@dataclass(frozen=True)
class Entry:
    """A line of the register: the test that types the hint, or why none does (`-`: yet), or why it is none (`no`)."""

    hint: Hint
    test: str
    reason: str


def hints() -> set[Hint]:
    found: set[Hint] = set()
    for path in sorted(PACKAGE.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        name = str(path.relative_to(PACKAGE))
        found |= {Hint(name, text) for text in _texts(tree) if COMMAND.search(text) and not _OF_FILES.match(text)}
    return found


def _texts(tree: ast.AST) -> Iterator[str]:
    """The texts that are said: no docstring, and nothing of a command's help."""
    if isinstance(tree, ast.Call) and ast.unparse(tree.func).rpartition(".")[2] in _HELP:
        return
    if isinstance(tree, ast.Expr) and isinstance(tree.value, ast.Constant):
        return
    if isinstance(tree, ast.Constant) and isinstance(tree.value, str):
        yield " ".join(tree.value.split())
    elif isinstance(tree, ast.JoinedStr):
        parts = (str(part.value) if isinstance(part, ast.Constant) else "{}" for part in tree.values)
        yield " ".join("".join(parts).split())
    else:
        for child in ast.iter_child_nodes(tree):
            yield from _texts(child)


def advised(printed: str) -> list[list[str]]:
    """The commands that a text advises, as the words that a person would type after `provision`."""
    printed = re.sub(r" \\\n +", " ", printed)  # as a shell reads a command of several lines
    found = re.findall(r"\bprovision ([a-z][^;`,()\n]*)", " ".join(printed.split()) if "`" in printed else printed)
    return [shlex.split(command) for command in dict.fromkeys(each.strip() for each in found)]


def said(printed: str, hint: str) -> str:
    """The hint as it was printed: `{}` of the source stands for anything, and so does how lines were broken.

    Asserts that it was printed, and that nothing in it is left to the reader (`site=…`).
    """
    words = re.sub(r"(?:site|device|host)=…", "{}", " ".join(hint.split()))
    # At its beginning it stands for one word: no other text comes in with it.
    words = words.replace("{}", "{first}", 1) if words.startswith("{}") else words
    # The last door adds to a command what else the typed one was told.
    pattern = re.sub("(`provision[^`]*)`", r"\1(?: (?:inventory|authority)=[^ `]+| --rehearse)*`", re.escape(words))
    pattern = re.sub(r"\\\{\w*\\\}", "[^`]+?", pattern)
    if hint.endswith("{}"):
        pattern += r"\S+"
    pattern = pattern.replace("[^`]+?", r"\S+", words.startswith("{first}"))
    found = re.search(pattern, " ".join(printed.split()))
    assert found is not None, f"not printed: {hint}\n{printed}"
    assert "…" not in found[0], found[0]
    return found[0]


def untypeable(hint: Hint) -> list[str]:
    """What of the commands in a hint no command line can take; FILE, NAME and DIR are for a person to fill in."""
    text = re.sub(r"(?<==)…|\{\w*\}", "x1", hint.text)
    wrong = ["…"] if re.search(r"provision [^;`,()\n]*…", text) else []
    for words in advised(text):
        if words[0] == "x1":
            continue
        try:
            name, rest = choose(words, COMMANDS)
            if "--help" not in rest:
                parse(load(name, COMMANDS).command, rest)
        except NetcfgError as error:
            wrong += [str(one) for one in getattr(error, "errors", (error,))]
    return wrong


def register() -> list[Entry]:
    """The reviewed lines: file, hint, the test that types it, and if there is none the reason."""
    lines = REGISTER.read_text(encoding="utf-8").splitlines()
    fields = [line.split("\t") for line in lines if line and not line.startswith("#")]
    return [Entry(Hint(file, text), test, reason) for file, text, test, reason in fields]


def typing_tests(path: Path) -> set[str]:
    """The tests of a file that type what was advised: they, or a helper of the same file, call `advised`."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    helpers = {node.name for node in functions if "advised" in _called(node) and not node.name.startswith("test_")}
    return {node.name for node in functions if _called(node) & {"advised", *helpers}}


def _called(node: ast.AST) -> set[str]:
    """What is called in it, by its last name."""
    return {ast.unparse(one.func).rpartition(".")[2] for one in ast.walk(node) if isinstance(one, ast.Call)}
