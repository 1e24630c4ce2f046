"""Commands that look at a site or put it back, with words that cannot be right: golden/*.txt read like a console."""

import shlex
from pathlib import Path

import pytest

from atlantis_netcfg.checklist.probes.registry import TITLES
from atlantis_netcfg.checklist.report import Phase
from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.checklist import CHECK
from atlantis_netcfg.core.errors import ExitCode

GOLDEN = Path(__file__).with_name("golden")
TEXTS = [(GOLDEN / name).read_text(encoding="utf-8") for name in ("links.txt", "asbuilt.txt", "drift.txt", "check.txt")]
CASES = [block.partition("\n")[::2] for text in TEXTS for block in text.strip().split("\n\n")]


@pytest.mark.parametrize(("line", "said"), CASES, ids=[line for line, _ in CASES])
def test_mistakes_are_explained(
    line: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    code = main(shlex.split(line.removeprefix("$ provision ")))
    printed = capsys.readouterr()
    assert f"{printed.err.strip()}\nexit {code}" == said.strip()
    assert printed.out == ""
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_example_values_are_refused_before_contact(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    assert main(["report", "as-built", "site=coastal"]) == ExitCode.USAGE
    assert "it is for rehearsals only" in capsys.readouterr().err
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_choices_match_the_checklist() -> None:
    endpoint, phase = CHECK.word("endpoint"), CHECK.word("phase")
    assert endpoint is not None
    assert phase is not None
    assert endpoint.choices == tuple(map(str, TITLES))
    assert phase.choices == tuple(str(one).replace(" ", "-") for one in Phase)
