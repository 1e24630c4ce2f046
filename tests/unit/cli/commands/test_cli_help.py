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
from atlantis_netcfg.cli.base.syntax import FRAME
from atlantis_netcfg.cli.help import MEANING, first_words
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


@pytest.mark.parametrize("code", ["en", "pt"])
def test_overview_fits_a_terminal(code: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = said_by(capsys, ["--help", "--lang", code]).splitlines()
    assert len(said) <= 24
    assert [line for line in said if len(line) > 80] == []


def test_overview_lists_the_first_word_of_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    said = said_by(capsys, ["--help"])
    rows = dict(re.findall(r"^  (\S+) {2,}(\S.*)$", said, re.MULTILINE))
    assert list(rows) == ["site=NAME", *(word for word, _ in first_words(COMMANDS) if word not in {DEFAULT, "help"})]
    assert rows == {
        "site=NAME" if word == DEFAULT else word: text for word, text in first_words(COMMANDS) if word != "help"
    }
    assert len(rows) == 12
    assert said_by(capsys, ["help"]) == said


def test_every_command_is_listed_by_its_first_word(capsys: pytest.CaptureFixture[str]) -> None:
    for name in COMMANDS:
        if " " in name:
            said = " ".join(said_by(capsys, [name.split()[0], "--help"]).split())
            assert f" {name} {load(name, COMMANDS).command.summary}" in said


def test_exit_codes_are_explained(capsys: pytest.CaptureFixture[str]) -> None:
    words = " ".join(said_by(capsys, ["help", "exit-codes"]).split())
    assert [code for code in ExitCode if f"{int(code)} {MEANING[code]}" not in words] == []


@pytest.mark.parametrize("code", ["en", "pt"])
@pytest.mark.parametrize("line", HELPS, ids=" ".join)
def test_help_fits_a_terminal_of_eighty_columns(line: list[str], code: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = said_by(capsys, [*line, "--lang", code]).splitlines()
    assert len(said) <= 40
    assert [each for each in said if len(each) > 80] == []
    assert [each for each in said if each != each.rstrip()] == []
    assert [each for each in said if each.count("`") % 2] == []


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
    assert " ".join(command.details.split()) in said


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


@pytest.mark.parametrize("name", ["links", "vpn", "vpn onboard"])
def test_help_command_equals_help_flag(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert said_by(capsys, ["help", *name.split()]) == said_by(capsys, [*name.split(), "--help"])


def test_help_for_a_misspelt_command_suggests_a_correction(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["help", "drfit"]) == ExitCode.USAGE
    assert "did you mean `provision report drift`?" in capsys.readouterr().err


HELP_OF_RUN = """\
provision run: change a site

Usage:
  provision run site=SITE [device=DEVICE,…] [bearer=ptp|lte|satellite] [--plan]
                [--keep DIR] [--json] [--verbose]

Arguments:
  site=SITE                 the site to change (required)
  device=DEVICE,…           these devices only
  bearer=ptp|lte|satellite  the link in use

Options:
  --plan         stop after planning
  --keep DIR     keep the run there
  --json         print one JSON object instead of text, also on errors
  -v, --verbose  show details of each step
  --lang en|pt   output language (default: from LANG)
  -h, --help     show this help

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


RETIRED = {"only", "host", "bearer", "runs", "limit", "rehearsed"}
"""Names that said what `device=`, `link=`, `run=` and `--rehearse` say."""


def test_one_thing_has_one_name_in_every_command() -> None:
    commands = [load(name, COMMANDS).command for name in COMMANDS]
    used = {word.name for command in commands for word in command.words}
    used |= {flag.name for command in commands for flag in command.flags}
    assert used & RETIRED == set()
    assert {"site", "device", "link", "run", "rehearse"} <= used


@pytest.mark.parametrize("old", ["adopt", "apply", "drift", "prove", "qualify", "asbuilt", "guest", "validate", "runs"])
def test_earlier_name_is_answered_with_the_new_line(old: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([old, "site=coastal"]) == ExitCode.USAGE
    name = re.findall(r"type `provision (\S+ \S+) site=coastal`", capsys.readouterr().err)
    assert len(name) == 1
    assert name[0] in COMMANDS
