"""Command lines with mistakes, and every word that is said about them: golden/lines.txt reads like a console."""

import shlex
from pathlib import Path

import pytest
from pilot_commands import Table, done

from atlantis_netcfg.cli import main

GOLDEN = Path(__file__).with_name("golden") / "lines.txt"
CASES = {
    line.removeprefix("$ provision "): said.strip()
    for line, _, said in (block.partition("\n") for block in GOLDEN.read_text().strip().split("\n\n"))
}


@pytest.mark.parametrize("line", CASES)
def test_mistakes_are_explained(line: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    table = Table(monkeypatch, done)
    code = main(shlex.split(line), table=table)
    said = capsys.readouterr()
    assert said.err.strip() == CASES[line]
    assert (code, said.out, table.runs) == (3, "", [])


@pytest.mark.parametrize(
    ("line", "words", "flags"),
    [
        ("site=coastal", {"site": ("coastal",)}, {}),
        ("run site=coastal --plan --plan", {"site": ("coastal",)}, {"plan": None}),
        ("--plan site=coastal -v", {"site": ("coastal",)}, {"plan": None, "verbose": None}),
        ("site=a=b device=x,y device=z", {"site": ("a=b",), "device": ("x", "y", "z")}, {}),
        ("site=coastal --keep dir --json", {"site": ("coastal",)}, {"keep": "dir", "json": None}),
        ("site=coastal --keep=a=b", {"site": ("coastal",)}, {"keep": "a=b"}),
        ("--json show", {}, {"json": None}),
        ("vpn onboard partner=iqua", {"partner": ("iqua",)}, {}),
        ("vpn --json partner=iqua onboard", None, None),
    ],
)
def test_command_lines_are_parsed(
    line: str,
    words: dict[str, tuple[str, ...]] | None,
    flags: dict[str, str | None] | None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    table = Table(monkeypatch, done)
    code = main(shlex.split(line), table=table)
    assert [(dict(run.words), dict(run.flags)) for run in table.runs] == ([] if words is None else [(words, flags)])
    assert code == (3 if words is None else 0)


def test_command_reads_its_arguments_and_flags(monkeypatch: pytest.MonkeyPatch) -> None:
    table = Table(monkeypatch, done)
    main(["site=coastal", "device=a,b", "--keep", "dir"], table=table)
    (arguments,) = table.runs
    assert arguments.word("site") == "coastal"
    assert arguments.optional("bearer") is None
    assert arguments.many("device") == ("a", "b")
    assert arguments.flag("plan") is False
    assert arguments.value("keep") == "dir"
    for asked in (arguments.optional, arguments.flag):
        with pytest.raises(KeyError):
            asked("vehicle")
