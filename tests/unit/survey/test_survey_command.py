"""What a person may type wrong, and the small words of the command."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from atlantis_netcfg.cli import main
from atlantis_netcfg.core.errors import ExitCode

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(
    ("typed", "words"),
    [
        ("site=all", "about one site at a time"),
        ("site=te4sea link=sat", "`link=sat` is no 4G link of `te4sea`: its 4G links: 4g"),
        ("site=scc", "`scc` has no single 4G link to survey: it declares no 4G link"),
        ("site=te4sea every=fast", "`every=fast` is no step"),
        ("site=te4sea for=soon", "`for=soon` is no time"),
        ("site=te4sea --max-mb 5", "`--max-mb 5` is no budget of a survey"),
        ("site=te4sea coast=nowhere.geojson", "`coast=nowhere.geojson` cannot be read"),
        ("site=te4sea --clicks --rehearse", "typed positions cannot be rehearsed"),
        ("site=te4sea", "the inventory still holds example values"),
    ],
)
def test_what_is_typed_wrong(
    typed: str, words: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path))
    assert main(["survey", *typed.split()]) == ExitCode.USAGE
    assert words in " ".join(capsys.readouterr().err.split())


def test_a_survey_that_is_not_there(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path))
    assert main(["survey", "site=te4see"]) == ExitCode.NOTHING
    assert "there is no site `te4see`" in capsys.readouterr().err
    assert main(["survey", "site=te4sea", "from=20261120T101500Z"]) == ExitCode.NOTHING
    assert "no survey `20261120T101500Z` is kept" in capsys.readouterr().err
