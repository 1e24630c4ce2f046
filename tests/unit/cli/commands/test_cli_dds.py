"""`provision robot dds`: files written whole and once, printed, or told as JSON."""

import json
import re
import shutil
from pathlib import Path

import pytest

from atlantis_netcfg.cli import main
from atlantis_netcfg.core.errors import ExitCode

SHIPPED = Path(__file__).parents[4] / "inventory"
LINE = ["robot", "dds", "site=coastal", "device=coastal-gateway", f"inventory={SHIPPED}"]


def test_second_run_changes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    typed = [*LINE, f"to={tmp_path / 'profiles'}"]
    assert main(typed) == ExitCode.DONE
    first = {path: (path.read_bytes(), path.stat().st_ino) for path in (tmp_path / "profiles").rglob("*.*")}
    assert len(first) == 9
    assert capsys.readouterr().out.count("  written    ") == 9
    assert main(typed) == ExitCode.DONE
    assert capsys.readouterr().out.count("  unchanged ") == 9
    assert {path: (path.read_bytes(), path.stat().st_ino) for path in (tmp_path / "profiles").rglob("*.*")} == first


def test_changed_file_is_written_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    typed = [*LINE, f"to={tmp_path}", "--json"]
    assert main(typed) == ExitCode.DONE
    (tmp_path / "4g" / "fastdds.xml").write_text("mine")
    capsys.readouterr()
    assert main(typed) == ExitCode.DONE
    told = json.loads(capsys.readouterr().out)
    assert [file["name"] for file in told["files"] if file["changed"]] == ["4g/fastdds.xml"]
    assert "atlantis" in (tmp_path / "4g" / "fastdds.xml").read_text()


def test_show_prints_what_would_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*LINE, f"to={tmp_path}", "--show", "--json"]) == ExitCode.DONE
    told = json.loads(capsys.readouterr().out)
    assert {file["name"]: file["text"] for file in told["files"]} == {
        str(path.relative_to(tmp_path)): path.read_text() for path in tmp_path.rglob("*.*")
    }
    assert main([*LINE, "--show"]) == ExitCode.DONE
    shown = capsys.readouterr().out
    assert all(f"--- {file['name']}\n{file['text'].rstrip()}" in shown for file in told["files"])


def test_json_without_files(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*LINE, "distribution=jazzy", "--json"]) == ExitCode.DONE
    told = json.loads(capsys.readouterr().out)
    assert (told["exit"], told["errors"], told["distribution"]) == (0, [], "jazzy")
    assert told["peers"] == {"scc-control": "10.80.0.2", "coastal-gateway": "10.80.0.21"}
    assert [link["link"] for link in told["links"]] == ["wifi-ptp", "4g", "satellite"]
    assert {(file["text"], file["changed"]) for file in told["files"]} == {(None, None)}


def test_unusable_folder_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("in the way")
    assert main([*LINE, f"to={tmp_path / 'file'}"]) == ExitCode.USAGE
    assert "/wifi-ptp/cyclonedds.xml: Not a directory" in capsys.readouterr().err
    assert (tmp_path / "file").read_text() == "in the way"


def test_missing_dds_settings_are_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(SHIPPED, tmp_path / "inventory")
    pilot = tmp_path / "inventory" / "group_vars" / "all" / "pilot.yml"
    pilot.write_text(pilot.read_text().partition("  dds:")[0])
    vehicles = pilot.with_name("vehicles.yml")
    vehicles.write_text(re.sub(r"\n    telemetry:.*(\n      - .*)+", "", vehicles.read_text()))
    assert main([*LINE[:4], f"inventory={tmp_path / 'inventory'}"]) == ExitCode.USAGE
    assert capsys.readouterr().err == (
        "error: the pilot has no DDS settings\n       write `dds: {distribution: foxy}` below `pilot:`\n"
    )
