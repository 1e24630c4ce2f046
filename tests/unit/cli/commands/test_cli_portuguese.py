"""Commands in Portuguese show no English word outside names and commands."""

import re
import shutil
from pathlib import Path

import pytest
from english_words import english_parts, without_names

from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.base.commands import COMMANDS

SHIPPED = Path(__file__).parents[4] / "inventory"
COMMAND_LINES = (
    "--help",
    "help exit-codes",
    "help version",
    "inventory validate inventory=inventory",
    "inventory doctor inventory=inventory",
    "robot validate inventory=inventory",
    "report runs",
    "report checklists",
    "report verify",
    "measure history site=coastal inventory=inventory",
    "recover site=coastal inventory=inventory",
    "vpn list inventory=inventory",
    "plan site=nowhere inventory=inventory",
    "nothing",
)
PORTUGUESE = re.compile(r"\b(se|não|qual) for\b|\bfor (a|de|válido)\b", re.IGNORECASE)
"""The Portuguese verb that is an English word as well."""


def english(text: str) -> list[str]:
    return english_parts(PORTUGUESE.sub("…", " ".join(without_names(text).split())))


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(SHIPPED, tmp_path / "inventory")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.usefixtures("place")
@pytest.mark.parametrize("line", COMMAND_LINES)
def test_a_command_in_portuguese_shows_no_english(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    main([*line.split(), "--lang", "pt"])
    output = capsys.readouterr()
    assert output.out + output.err
    assert english(output.out + output.err) == []


@pytest.mark.parametrize("name", COMMANDS)
def test_help_in_portuguese_shows_no_english(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    main([*name.split(), "--help", "--lang", "pt"])
    assert english(capsys.readouterr().out) == []


def test_english_words_are_noticed(capsys: pytest.CaptureFixture[str]) -> None:
    main(["--help", "--lang", "en"])
    assert english(capsys.readouterr().out) != []
