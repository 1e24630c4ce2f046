"""What programs and people rely on is still there: commands, exit codes, codes of findings, keys of `--json`."""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from atlantis_netcfg.cli.base.commands import COMMANDS, load
from atlantis_netcfg.core.errors import ExitCode

CHECKOUT = Path(__file__).parents[3]
BEFORE: dict[str, Any] = yaml.safe_load((CHECKOUT / "tests/data/surface.yml").read_text(encoding="utf-8"))
JUDGED = {"fail", "good", "warn", "unknown"}
"""Functions whose first argument is the code of a finding; of `Finding` it is the second."""


def trees() -> Iterator[ast.AST]:
    for file in (CHECKOUT / "atlantis_netcfg").rglob("*.py"):
        if "emulator" not in file.parts:
            yield from ast.walk(ast.parse(file.read_text(encoding="utf-8")))


def codes() -> set[str]:
    found = set()
    for call in (node for node in trees() if isinstance(node, ast.Call)):
        name = getattr(call.func, "id", getattr(call.func, "attr", ""))
        place = 0 if name in JUDGED else 1 if name.endswith("Finding") else None
        if place is not None and len(call.args) > place and isinstance(call.args[place], ast.Constant):
            found.add(call.args[place].value)  # type: ignore[attr-defined] # a constant, as the line above says
    return found


def keys() -> set[str]:
    functions = (node for node in trees() if isinstance(node, ast.FunctionDef))
    written = (each for each in functions if any(word in each.name for word in ("json", "dict", "document")))
    dicts = (node for function in written for node in ast.walk(function) if isinstance(node, ast.Dict))
    return {str(key.value) for each in dicts for key in each.keys if isinstance(key, ast.Constant)}


@pytest.mark.parametrize("name", BEFORE["commands"])
def test_command_accepts_all_earlier_arguments(name: str) -> None:
    command = load(name, COMMANDS).command
    taken = {f"{word.name}=" for word in command.words} | {f"--{flag.name}" for flag in command.flags}
    assert set(BEFORE["commands"][name].split()) <= taken


def test_exit_codes_are_unchanged() -> None:
    assert {code.name: int(code) for code in ExitCode if code.name in BEFORE["exit_codes"]} == BEFORE["exit_codes"]


def test_no_finding_code_is_removed() -> None:
    assert set(BEFORE["findings"].split()) - codes() == set()


def test_no_json_key_is_removed() -> None:
    assert set(BEFORE["json_keys"].split()) - keys() == set()
