"""Help is made from the declarations, complete, and light."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from pilot_commands import Table, done

from atlantis_netcfg import cli
from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.base.commands import COMMANDS, DEFAULT, load
from atlantis_netcfg.cli.base.syntax import FRAME, Group
from atlantis_netcfg.cli.help import MEANING
from atlantis_netcfg.core.errors import ExitCode

HEAVY = ("ansible", "cryptography", "jinja2", "librouteros", "paramiko", "pydantic", "rich", "yaml", "asyncio")


HELPS = [
    ["--help"],
    *([word, "--help"] for word in dict.fromkeys(name.split()[0] for name in COMMANDS if " " in name)),
    *([*name.split(), "--help"] for name in COMMANDS),
]


def said_by(capsys: pytest.CaptureFixture[str], line: list[str]) -> str:
    assert main(line) == ExitCode.DONE
    return capsys.readouterr().out


def test_the_overview_names_every_command_and_exit_code(capsys: pytest.CaptureFixture[str]) -> None:
    said = said_by(capsys, ["--help"])
    words = " ".join(said.split())
    for name in COMMANDS:
        assert re.search(rf"^  {'site=NAME' if name == DEFAULT else name} ", said, re.MULTILINE)
        assert load(name, COMMANDS).command.summary in words
    for code in ExitCode:
        assert f" {int(code)} {MEANING[code]}" in words
    assert said_by(capsys, ["help"]) == said


def test_every_command_has_a_group_and_five_come_first(capsys: pytest.CaptureFixture[str]) -> None:
    groups = {name: load(name, COMMANDS).command.group for name in COMMANDS}
    assert [name for name, group in groups.items() if group is None] == []
    assert [name for name, group in groups.items() if group is Group.FIRST] == ["run", *FIRST[1:]]
    said = said_by(capsys, ["--help"])
    assert [title for title in re.findall(r"^(\S.*):$", said, re.MULTILINE) if title in TITLES] == TITLES
    assert re.findall(r"^  ([a-z]\S+(?: [a-z]+)?)  ", said, re.MULTILINE)[: len(FIRST)] == FIRST


FIRST = ["site=NAME", "links", "check", "drift", "runs"]
TITLES = [group.value for group in Group]


def test_command_without_a_group_is_still_listed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--help"], table=Table(monkeypatch, done)) == ExitCode.DONE
    assert "Other commands:\n  site=NAME    change a site\n  show         show a site\n" in capsys.readouterr().out


@pytest.mark.parametrize("line", HELPS, ids=" ".join)
def test_help_fits_a_terminal_of_eighty_columns(line: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    said = said_by(capsys, line)
    assert [each for each in said.splitlines() if len(each) > 80] == []
    assert [each for each in said.splitlines() if each != each.rstrip()] == []
    assert [each for each in said.splitlines() if each.count("`") % 2] == []


@pytest.mark.parametrize("name", COMMANDS)
def test_help_is_complete_and_breaks_no_word(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = " ".join(said_by(capsys, [*name.split(), "--help"]).split())
    command = load(name, COMMANDS).command
    assert f"provision {name}: {command.summary} Usage:" in said
    for word in command.words:
        assert f" {word.usage} {word.help}" in said
        assert f"{word.usage}]" in said or word.is_required
        assert all(choice in said for choice in word.choices)
    for flag in (*command.flags, *FRAME):
        assert f" {flag.usage} {flag.help}" in said
    assert said.endswith(" ".join(command.details.split()))


def test_the_help_of_a_group(capsys: pytest.CaptureFixture[str]) -> None:
    said = said_by(capsys, ["vpn", "--help"])
    names = [name for name in COMMANDS if name.startswith("vpn ")]
    assert re.findall(r"^  (vpn [a-z]+) ", said, re.MULTILINE) == names
    assert "provision vpn COMMAND" in said


def test_every_module_of_a_command_is_in_the_table() -> None:
    files = Path(cli.__file__).parent.rglob("[a-z]*.py")
    modules = {path.stem for path in files if path.parent.name not in {"base", "checklist"}} | {"checklist"}
    assert {row.partition(":")[0].rpartition(".")[2] for row in COMMANDS.values()} == modules
    for name in COMMANDS:
        assert load(name, COMMANDS).command.name == name


def test_the_help_of_a_command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    table = Table(monkeypatch, done)
    for line in (["run", "--help"], ["site=coastal", "--help"], ["-h", "run", "site=coastal", "--paln"]):
        assert main(line, table=table) == ExitCode.DONE
        assert capsys.readouterr().out == HELP_OF_RUN
    assert table.runs == []


@pytest.mark.parametrize("name", ["drift", "vpn", "vpn onboard"])
def test_help_command_equals_help_flag(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert said_by(capsys, ["help", *name.split()]) == said_by(capsys, [*name.split(), "--help"])


def test_help_for_a_misspelt_command_suggests_a_correction(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["help", "drfit"]) == ExitCode.USAGE
    assert "did you mean `provision drift`?" in capsys.readouterr().err


HELP_OF_RUN = """\
provision run: change a site

Usage:
  provision run site=SITE [only=ONLY,…] [bearer=ptp|lte|satellite] [--plan]
                [--keep DIR] [--json] [--verbose]

Words:
  site=SITE                 the site to change (required)
  only=ONLY,…               these devices only
  bearer=ptp|lte|satellite  the link in use

Flags:
  --plan         stop after planning
  --keep DIR     keep the run there
  --json         print one JSON object instead of text, on errors as well
  -v, --verbose  say more about each step
  --lang en|pt   the language of what is printed; else that of LANG
  -h, --help     print this text

Nothing is changed with --plan.
"""


@pytest.mark.parametrize("line", [["--help"], *([*name.split(), "--help"] for name in COMMANDS)], ids=" ".join)
def test_help_imports_nothing_heavy(line: list[str]) -> None:
    source = (
        "import sys; from atlantis_netcfg.cli import main; main(sys.argv[1:]); print(*sys.modules, file=sys.stderr)"
    )
    process = subprocess.run([sys.executable, "-c", source, *line], capture_output=True, text=True, check=True)
    assert {module.partition(".")[0] for module in process.stderr.split()}.isdisjoint(HEAVY)
    assert "Usage:" in process.stdout


def test_the_overview_loads_neither_openssl_nor_archivers() -> None:
    """Each takes a twentieth of the time until the overview stands there."""
    source = "import sys; from atlantis_netcfg.cli import main; main(['--help']); print(*sys.modules, file=sys.stderr)"
    process = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True, check=True)
    assert {"hmac", "_hashlib", "shutil", "tempfile"}.isdisjoint(process.stderr.split())


def test_version_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == ExitCode.DONE
    assert re.match(r"provision \S+\nPython 3\.\d+\.\d+\nansible-core 2\.\d+\.\d+\n$", capsys.readouterr().out)
