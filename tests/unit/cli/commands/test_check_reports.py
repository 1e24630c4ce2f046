"""`provision report verify`, `list` and `show` on checklists that were signed, tampered with, or left open."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from check_desk import LAMP, RADIO, Sitting

from atlantis_netcfg.checklist.report import Document
from atlantis_netcfg.cli import main

WELL = "PASS hears the boat"


def pages(_document: Document) -> dict[str, bytes]:
    return {"report.html": b"<p>well</p>", "junit.xml": b"<testsuites/>"}


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)
    return tmp_path / "state"


def signed(state: Path, *, heard: str = WELL, real: bool = True) -> Path:
    folder = state / ("real" if real else "rehearsal") / "coastal"
    sitting = Sitting(folder, ["on"] if heard.startswith("FAIL") else [], (RADIO,), {"sparus/wifi": [heard]})
    with sitting.book() as book:
        sitting.turn(book).with_a_person(sitting.desk)
        book.sign("A. Technician", pages)
        return book.folder


def told(capsys: pytest.CaptureFixture[str], *typed: str, code: int) -> dict[str, Any]:
    assert main(["report", *typed, "--json"]) == code
    said: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert said["exit"] == code
    return said


def test_signed_checklists_verify(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    signed(state)
    signed(state, real=False)
    assert main(["report", "verify"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.partition(": ")[0] for line in lines] == [
        "coastal 20260504T120000Z",
        "coastal 20260504T120000Z, rehearsed",
    ]
    assert lines[0].partition(", key SHA256:")[0].endswith(": as signed by A. Technician at 2026-05-04 12:00 UTC")
    rows = told(capsys, "verify", "site=coastal", "run=20260504T120000Z", code=0)["verified"]
    assert [(row["site"], row["signed"]["by"], row["troubles"]) for row in rows] == [
        ("coastal", "A. Technician", [])
    ] * 2


def _change(path: Path) -> None:
    path.write_bytes(path.read_bytes().replace(b"boat", b"goat").replace(b"well", b"fine"))


@pytest.mark.parametrize(
    ("name", "tamper", "words"),
    [
        ("report.json", _change, "was changed after"),
        ("report.html", _change, "was changed after"),
        ("junit.xml", Path.unlink, "is missing"),
        ("manifest.json", Path.unlink, "is missing"),
        ("records.jsonl", _change, "was changed after"),
    ],
)
def test_tampering_is_detected(
    name: str, tamper: Callable[[Path], None], words: str, state: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tamper(signed(state) / name)
    assert main(["report", "verify"]) == 6
    said = capsys.readouterr().out
    assert "NOT VERIFIED" in said
    assert f"  {name}: {words}" in said
    (row,) = told(capsys, "verify", "site=coastal", code=6)["verified"]
    assert name in {one["file"] for one in row["troubles"]}
    assert all(one["hint"] for one in row["troubles"])


def test_single_report_file_is_verified(state: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report = tmp_path / "report.json"
    report.write_bytes((signed(state) / "report.json").read_bytes())
    assert main(["report", "verify", "file=report.json"]) == 0
    assert capsys.readouterr().out.startswith("report.json: as signed by A. Technician")
    key = json.loads(report.read_bytes())["signed"]["key"]
    (row,) = told(capsys, "verify", "file=report.json", "key=SHA256:other", code=6)["verified"]
    assert [one["what"] for one in row["troubles"]] == [f"it is signed with key {key}, but another key was requested"]
    (state / "checklist.key").unlink()
    (row,) = told(capsys, "verify", "file=report.json", code=6)["verified"]
    assert [one["what"] for one in row["troubles"]] == [
        f"it is signed with key {key}, which is unknown on this computer"
    ]
    told(capsys, "verify", "file=report.json", f"key=SHA256:other,{key}", code=0)
    _change(report)
    (row,) = told(capsys, "verify", "file=report.json", f"key={key}", code=6)["verified"]
    assert row["troubles"][0]["what"] == "was changed after it was signed"
    report.write_text("no report\n")
    (row,) = told(capsys, "verify", "file=report.json", code=6)["verified"]
    assert (row["signed"], row["troubles"][0]["what"]) == (None, "is not a checklist report, or is damaged")


def test_open_checklist_was_not_signed(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Sitting(state / "real" / "coastal", [], (RADIO, LAMP), {"sparus/wifi": [WELL]}).book().close()
    assert main(["report", "verify", "site=coastal"]) == 7
    assert capsys.readouterr().err.startswith("error: nothing was signed\n")
    rows = told(capsys, "checklists", "site=coastal", code=0)
    assert [(row["state"], row["exit"], row["open"]) for row in rows["checklists"]] == [("open", 6, 2)]


def test_history_shows_changes_since_green(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    signed(state)
    signed(state, heard="FAIL hears nobody")
    assert main(["report", "checklists", "site=coastal"]) == 0
    assert capsys.readouterr().out == HISTORY
    assert main(["report", "checklists", "site=coastal", "vehicle=sparus"]) == 0
    assert capsys.readouterr().out == HISTORY
    assert main(["report", "checklists", "site=coastal", "vehicle=stork"]) == 7
    assert "no checklist of `coastal` includes `stork`" in capsys.readouterr().err
    since = told(capsys, "checklists", "site=coastal", code=0)["since_green"]
    assert [(one["id"], one["before"], one["after"]) for one in since["changes"]] == [("sparus/wifi", "PASS", "FAIL")]


HISTORY = """\
20260504T120000Z  passed (PASS, 1 items)
  signed by A. Technician, 2026-05-04 12:00 UTC
20260504T120000Z-02  not passed (FAIL, 1 items)
  signed by A. Technician, 2026-05-04 12:00 UTC
since 20260504T120000Z, which passed:
  sparus/wifi: PASS -> FAIL: hears nobody
"""


def test_stored_checklist_is_shown(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = signed(state)
    signed(state, heard="FAIL hears nobody")
    assert main(["report", "show", "site=coastal", f"run={folder.name}"]) == 0
    said = capsys.readouterr().out
    assert "Signed by A. Technician" in said
    assert said.endswith(f"report: {folder}/report.html\n")
    newest = told(capsys, "show", "site=coastal", code=6)
    assert (newest["run"], newest["signed"]["by"]) == ("20260504T120000Z-02", "A. Technician")
    assert main(["report", "show", "site=coastal", "run=20260504T120000Z-2"]) == 7
    assert "did you mean `20260504T120000Z-02`?" in capsys.readouterr().err


def test_rehearsed_checklists_are_separate(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    signed(state, real=False)
    for command in ("checklists", "show"):
        assert main(["report", command, "site=coastal"]) == 7
        assert "add --rehearse to see rehearsed ones" in capsys.readouterr().err
        assert main(["report", command, "site=coastal", "--rehearse"]) == 0
        capsys.readouterr()
