"""What a person may type wrong, and the small words of the command."""

from pathlib import Path

import pytest
from survey_examples import point, sailing

from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.survey import _by_clicks, _line
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.links.qualify.session import EndReason
from atlantis_netcfg.records.survey.site import TypedPositions


@pytest.mark.parametrize(
    ("typed", "words"),
    [
        ("site=all", "takes one site at a time"),
        ("site=te4sea link=sat", "`link=sat` is not a 4G link of `te4sea`: its 4G links: 4g"),
        ("site=scc", "`scc` does not have exactly one 4G link: it has no 4G link"),
        ("site=te4sea every=fast", "`every=fast` is not a valid interval"),
        ("site=te4sea for=soon", "`for=soon` is not a duration"),
        ("site=te4sea --max-mb 5", "`--max-mb 5` is not a valid budget"),
        ("site=te4sea coast=nowhere.geojson", "`coast=nowhere.geojson` cannot be read"),
        ("site=te4sea --clicks --rehearse", "typed positions cannot be rehearsed"),
        ("site=te4sea", "the inventory still contains example values"),
    ],
)
def test_invalid_arguments_are_usage_errors(
    typed: str, words: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path))
    assert main(["measure", "coverage", *typed.split()]) == ExitCode.USAGE
    assert words in " ".join(capsys.readouterr().err.split())


def test_unknown_site_or_survey_is_reported(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path))
    assert main(["measure", "coverage", "site=te4see"]) == ExitCode.NOTHING
    assert "site `te4see` does not exist" in capsys.readouterr().err
    assert main(["measure", "coverage", "site=te4sea", "from=20261120T101500Z"]) == ExitCode.NOTHING
    assert "there is no saved survey `20261120T101500Z`" in capsys.readouterr().err


def test_places_are_typed_until_end_of_input(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    typed = ["", "pier: 41.6864, -8.8388", "nowhere", "", "41.69 -8.84", "pier"]

    def read(_question: str) -> str:
        if not typed:
            raise EOFError
        return typed.pop(0)

    monkeypatch.setattr("builtins.input", read)
    made = sailing()
    made.survey.positions = TypedPositions()
    assert _by_clicks(made.survey) == EndReason.DONE
    assert [point.position for point in made.points] == [
        (41.6864, -8.8388),
        (41.6864, -8.8388),
        (41.69, -8.84),
        (41.6864, -8.8388),
    ]
    assert [point.place for point in made.points] == ["pier", "pier", "", "pier"]
    assert capsys.readouterr().out.count("not a position") == 2


def test_survey_point_is_printed_on_one_line() -> None:
    here = {"latitude": 41.6864, "longitude": -8.8388, "rsrp_dbm": -95.0, "sinr_db": 6.0}
    assert _line(point(3, **here, sent=5, rtt_median_s=0.1073, goodput_up_bps=2.83e6)) == (
        "   3  41.68640, -8.83880  RSRP -95 SINR 6  107 ms, 2.83 Mbit/s up"
    )
    assert _line(point(4, no_position="no fix", no_radio="it is off", no_test="the hourly budget")) == (
        "   4  no fix  it is off  the hourly budget"
    )
