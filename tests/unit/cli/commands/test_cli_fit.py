"""`provision measure fit`: what is typed, what is printed, and how it ends."""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import pytest
from hints_said import advised, said

from atlantis_netcfg.cli import main
from atlantis_netcfg.core.errors import ExitCode

SHIPPED = Path(__file__).parents[4] / "inventory"
_TOPICS = (
    "{topic: /pose, data: numbers, rate_hz: 2, size_bytes: 120}",
    "{topic: /status, data: numbers, rate_hz: 1, size_bytes: 40, reliable: true}",
    "{topic: /a/long/name/of/a/camera, data: images, rate_hz: 4, size_bytes: 20000}",
    "{topic: /sonar, data: point_clouds, rate_hz: 0.5, size_bytes: 200000}",
)


@pytest.fixture
def inventory(tmp_path: Path) -> Path:
    return publishing(tmp_path, *_TOPICS)


def publishing(folder: Path, *topics: str) -> Path:
    own = shutil.copytree(SHIPPED, folder / "inventory")
    vehicles = own / "group_vars" / "all" / "vehicles.yml"
    text = vehicles.read_text(encoding="utf-8")
    assert text.count("\n  sparus:\n") == 1
    added = f"\n  sparus:\n    telemetry: [{', '.join(topics)}]\n"
    vehicles.write_text(text.replace("\n  sparus:\n", added), encoding="utf-8")
    return own


def line(inventory: Path, *more: str) -> Sequence[str]:
    return ["measure", "fit", "site=coastal", "vehicle=sparus", f"inventory={inventory}", *more]


def test_lines_fit_a_narrow_terminal(inventory: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(line(inventory)) == ExitCode.CHECKS_FAILED
    shown = capsys.readouterr().out.splitlines()
    assert [words for words in shown if len(words) > 80 and "/a/long/name" not in words] == []
    assert [words for words in shown if words.endswith((": fits", ": fits at reduced rates"))] == [
        "wifi-ptp  INCONCLUSIVE: fits",
        "4g  INCONCLUSIVE: fits",
        "satellite  FAIL: fits at reduced rates",
    ]
    assert "  reduce /sonar: 0.5 Hz -> 0.1 Hz" in shown
    assert not any("-> 2 Hz" in words for words in shown)


def test_json_has_the_same_values(inventory: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(line(inventory, "link=satellite", "--json")) == ExitCode.CHECKS_FAILED
    told = json.loads(capsys.readouterr().out)
    assert (told["exit"], told["errors"], told["vehicle"], told["subscribers"]) == (6, [], "sparus", 1)
    (link,) = told["links"]
    assert (link["verdict"], link["word"]) == ("FAIL", "fits at reduced rates")
    assert link["capacity"]["source"] == "declared"
    pose, status, _camera, sonar = link["topics"]
    assert (pose["message_bytes_down"], pose["message_loss"]) == (0.0, None)
    assert status["message_bytes_down"] > 0
    assert (sonar["fragments"], sonar["fits_at_hz"]) == (182, 0.1)
    assert link["thinned"]["share_up"] <= 0.7 < link["declared"]["share_up"]
    assert float(link["thinned"]["hour"]["price"]) < float(link["declared"]["hour"]["price"])


@pytest.mark.parametrize(
    ("typed", "code", "words"),
    [
        ("vehicle=sparsu", ExitCode.NOTHING, "did you mean `sparus`?"),
        ("site=coastl", ExitCode.NOTHING, "did you mean `coastal`?"),
        ("site=all", ExitCode.USAGE, "one site at a time"),
        ("link=4gg", ExitCode.USAGE, "did you mean `link=4g`?"),
        ("run=unknown", ExitCode.NOTHING, "coastal has no measurement `unknown`"),
    ],
)
def test_unknown_names_are_refused(
    inventory: Path, capsys: pytest.CaptureFixture[str], typed: str, code: ExitCode, words: str
) -> None:
    named = typed.partition("=")[0]
    kept = [word for word in line(inventory) if not word.startswith(f"{named}=")]
    assert main([*kept, typed]) == code
    assert words in capsys.readouterr().err


def test_vehicle_without_topics_is_reported(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(line(SHIPPED)) == ExitCode.NOTHING
    assert "set its topics in group_vars/all/vehicles.yml (see docs/measuring.md)" in capsys.readouterr().err


def test_validate_warns_of_rates_that_fit_no_link(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Not of what fits when it is thinned, nor of what fits a better link."""
    own = publishing(tmp_path, "{topic: /video, data: images, rate_hz: 5, size_bytes: 1500000, least_hz: 4}")
    assert main(["inventory", "validate", f"inventory={own}"]) == ExitCode.DONE
    shown = capsys.readouterr().out
    assert "no DDS link of coastal carries what `sparus` publishes, even at the lowest useful rates" in shown
    hint = "`provision measure fit site={} vehicle={}` shows details, and what would fit"
    (words,) = advised(said(shown.partition("any link of te4sea")[0], hint))
    assert main([*words, f"inventory={own}"]) == ExitCode.CHECKS_FAILED
    told = capsys.readouterr().out
    assert told.count("FAIL: does not fit") == 3
    assert "/video alone would fit up to " in told


def test_validate_is_silent_about_rates_that_fit_one_link(inventory: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inventory", "validate", f"inventory={inventory}"]) == ExitCode.DONE
    assert "no DDS link of coastal carries" not in capsys.readouterr().out
