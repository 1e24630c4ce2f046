"""A hint names only options that the command has which prints it; plain Ansible names a variable of its own."""

import re
from pathlib import Path

import pytest
from hints_said import advised
from row_subtests import for_each_row

from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.base.commands import COMMANDS, choose, load
from atlantis_netcfg.cli.base.output import as_typed
from atlantis_netcfg.cli.base.syntax import parse
from atlantis_netcfg.core.errors import ExitCode, UsageError
from atlantis_netcfg.inventory import load as load_declaration
from atlantis_netcfg.operations.common.request import Request, of_variables, refuse_examples

SHIPPED = Path(__file__).parents[4] / "inventory"
_SAMPLES = {
    "site": "coastal",
    "device": "coastal-router",
    "host": "coastal-gateway",
    "vehicle": "sparus",
    "link": "4g",
    "run": "20260101T000000Z",
    "runs": "a,b",
    "partner": "iqua",
    "name": "iqua-sparus2",
    "from": "example",
    "reason": "it was lost",
}
"""A value for each word that some command needs."""
ENDLESS = "robot mock"
"""It asks nobody, and ends by Ctrl-C."""
_COMMAND = re.compile(r"`[^`]*\bprovision [^`]*`|: provision .*")
_FLAG = re.compile(r"(?<![\w-])--([a-z][a-z-]*)")


def typed_words(name: str, folder: Path) -> list[str]:
    """A command line of this command that can be parsed."""
    words = [word for word in load(name, COMMANDS).command.words if word.is_required]
    samples = {**_SAMPLES, "to": str(folder / "to"), "file": str(folder / "file"), "folder": str(folder / "new")}
    first = [] if name == "run" else name.split()
    return [*first, *(f"{word.name}={samples.get(word.name, 'x')}" for word in words)]


def foreign_options(printed: str, name: str) -> list[str]:
    """Options in a text that are neither of this command nor part of a whole command."""
    command = load(name, COMMANDS).command
    return [flag for flag in _FLAG.findall(_COMMAND.sub("", printed)) if command.flag(flag) is None]


@for_each_row("name", list(COMMANDS), ids=str)
def test_example_values_hint_fits_the_command(name: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError) as refused:
        refuse_examples(load_declaration(SHIPPED), is_rehearsal=False)
    hint = as_typed(refused.value.hint or "", [*typed_words(name, tmp_path), "site=coastal"]).splitlines()[0]
    assert foreign_options(hint, name) == []
    has_flag = load(name, COMMANDS).command.flag("rehearse") is not None
    assert hint.endswith(
        "or add --rehearse" if has_flag else "or rehearse the site: `provision site=coastal --rehearse`"
    )
    for words in advised(hint):
        chosen, rest = choose(words, COMMANDS)
        assert parse(load(chosen, COMMANDS).command, rest).flag("rehearse")


@for_each_row(
    "name",
    [name for name in COMMANDS if load(name, COMMANDS).command.word("inventory") is not None and name != ENDLESS],
    ids=str,
)
def test_hints_use_only_options_of_the_command(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)
    ended = main(typed_words(name, tmp_path))
    told = capsys.readouterr().err
    assert ended is not ExitCode.OUR_FAULT, told
    assert foreign_options(told, name) == [], told


def test_hint_to_save_a_plan_can_be_typed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", "apply", f"file={tmp_path / 'absent'}"]) == ExitCode.USAGE
    (words,) = advised(capsys.readouterr().err)
    name, rest = choose([word.replace("NAME", "coastal") for word in words], COMMANDS)
    assert (name, parse(load(name, COMMANDS).command, rest).word("site")) == ("plan", "coastal")


@pytest.mark.parametrize(
    ("variables", "message", "hint"),
    [
        ({"atlantis_rehearse": "ture"}, "atlantis_rehearse is neither true nor false: ture", "atlantis_rehearse=true"),
        ({"atlantis_acept_cost": "true"}, "unknown extra variable `atlantis_acept_cost`", "`atlantis_accept_cost`"),
        ({"atlantis_request": {"mod": "plan"}}, "atlantis_request: unknown key `mod`", "did you mean `mode`?"),
        ({"atlantis_request": "plan"}, "atlantis_request is not a mapping: plan", "-e '{"),
        ({"atlantis_request": {"mode": "plann"}}, "atlantis_request: `plann` is not a valid value for `mode`", ""),
        ({"atlantis_request": {"rehearsed": "maybe"}}, "atlantis_request: `rehearsed` ", ""),
    ],
)
def test_invalid_extra_variable_is_one_plain_sentence(variables: dict[str, object], message: str, hint: str) -> None:
    with pytest.raises(UsageError) as refused:
        of_variables(variables)
    assert str(refused.value).startswith(message)
    assert "\n" not in str(refused.value)
    assert "pydantic" not in str(refused.value)
    assert hint in (refused.value.hint or "")


def test_extra_variables_become_a_request() -> None:
    fields = of_variables(
        {"atlantis_rehearse": "yes", "atlantis_accept_cost": True, "atlantis_request": {"mode": "plan"}}
    )
    request = Request.model_validate(fields)
    assert (request.rehearsed, request.accept_cost, request.mode.value) == (True, True, "plan")
