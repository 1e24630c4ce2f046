"""Help is made from the declarations, complete, and light."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from pilot_commands import Table, done

from atlantis_netcfg import cli
from atlantis_netcfg.cli import main
from atlantis_netcfg.cli._commands import COMMANDS, load
from atlantis_netcfg.cli.help import MEANING
from atlantis_netcfg.core.errors import ExitCode

HEAVY = ("ansible", "cryptography", "jinja2", "librouteros", "paramiko", "pydantic", "rich", "yaml", "asyncio")


def test_the_overview_names_every_command_and_exit_code(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == ExitCode.DONE
    said = capsys.readouterr().out
    for name in COMMANDS:
        assert re.search(rf"^  {name} +{re.escape(load(name, COMMANDS).command.summary)}$", said, re.MULTILINE)
    for code in ExitCode:
        assert f"  {int(code)}  {MEANING[code]}" in said
    assert main(["help"]) == ExitCode.DONE
    assert capsys.readouterr().out == said


def test_every_module_of_a_command_is_in_the_table() -> None:
    modules = {path.stem for path in Path(cli.__file__).parent.rglob("[a-z]*.py")}
    assert {row.partition(":")[0].rpartition(".")[2] for row in COMMANDS.values()} == modules
    for name in COMMANDS:
        assert load(name, COMMANDS).command.name == name


def test_the_help_of_a_command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    table = Table(monkeypatch, done)
    for line in (["run", "--help"], ["site=coastal", "--help"], ["-h", "run", "site=coastal", "--paln"]):
        assert main(line, table=table) == ExitCode.DONE
        assert capsys.readouterr().out == HELP_OF_RUN
    assert table.runs == []


HELP_OF_RUN = """\
provision run: change a site

Usage:
  provision run site=SITE [only=ONLY,…] [bearer=ptp|lte|satellite] [--plan] [--keep DIR] [--json]
                [--verbose]

Words:
  site=SITE                 the site to change (required)
  only=ONLY,…               these devices only
  bearer=ptp|lte|satellite  the link in use

Flags:
  --plan         stop after planning
  --keep DIR     keep the run there
  --json         print one JSON object instead of text, on errors as well
  -v, --verbose  say more about each step
  -h, --help     print this text

Nothing is changed with --plan.
"""


@pytest.mark.parametrize("line", [["--help"], *([*name.split(), "--help"] for name in COMMANDS)], ids=" ".join)
def test_help_imports_nothing_heavy(line: list[str]) -> None:
    source = (
        "import sys; from atlantis_netcfg.cli import main; main(sys.argv[1:]); print(*sys.modules, file=sys.stderr)"
    )
    process = subprocess.run([sys.executable, "-c", source, *line], capture_output=True, text=True, check=True)
    loaded = {module.partition(".")[0] for module in process.stderr.split()}
    assert loaded.isdisjoint(HEAVY)
    assert "Usage:" in process.stdout


def test_version_without_importing_what_it_names(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == ExitCode.DONE
    assert re.match(r"provision \S+\nPython 3\.\d+\.\d+\nansible-core 2\.\d+\.\d+\n$", capsys.readouterr().out)
