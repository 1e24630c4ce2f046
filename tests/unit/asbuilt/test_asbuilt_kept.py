"""Records are kept whole or not at all, and what cannot be read is said."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest
from asbuilt_examples import AT, LATER, record

from atlantis_netcfg.asbuilt.kept import FILE, keep, latest, new_folder, parsed
from atlantis_netcfg.journal import JournalFailed, StateDamaged

if TYPE_CHECKING:
    from pathlib import Path


def data(**more: str) -> bytes:
    return json.dumps(record(**more).as_json()).encode()


def test_the_newest_record_is_found_and_is_what_was_kept(tmp_path: Path) -> None:
    assert latest(tmp_path / "asbuilt") is None
    for at, name in ((AT, "20261125T100000Z"), (LATER, "20261126T100000Z")):
        folder = new_folder(tmp_path / "asbuilt", at)
        assert folder.name == name
        keep(folder, {FILE: data(id=name), "as-built.html": b"page"})
    found = latest(tmp_path / "asbuilt")
    assert found == record(id="20261126T100000Z")
    assert (tmp_path / "asbuilt" / "20261126T100000Z" / FILE).stat().st_mode & 0o777 == 0o600


def test_a_record_that_a_kill_has_left_without_its_json_counts_for_nothing(tmp_path: Path) -> None:
    keep(new_folder(tmp_path, AT), {FILE: data()})
    (new_folder(tmp_path, LATER) / "as-built.html").write_bytes(b"page")
    assert latest(tmp_path) == record()


def test_a_full_disk_leaves_no_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = new_folder(tmp_path, AT)

    def full(_descriptor: int, _data: bytes) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("atlantis_netcfg.journal.files.write_all", full)
    with pytest.raises(JournalFailed, match="the record cannot be written: No space left on device"):
        keep(folder, {FILE: data(), "as-built.html": b"page"})
    assert latest(tmp_path) is None


@pytest.mark.parametrize("text", [b"", b"[]", b"{}", b'{"format": 1'])
def test_a_damaged_record_is_said(tmp_path: Path, text: bytes) -> None:
    keep(new_folder(tmp_path, AT), {FILE: text})
    with pytest.raises(StateDamaged, match="the last record cannot be read") as caught:
        latest(tmp_path)
    assert caught.value.hint is not None
    assert "put its folder aside" in caught.value.hint


def test_json_says_how_it_ended_and_can_be_read_back() -> None:
    found = json.loads(data())
    assert (found["exit"], found["errors"], [table["number"] for table in found["tables"]]) == (0, [], [8, 9, 31, 32])
    assert parsed(data()) == record()


def test_programs_find_the_keys_that_they_know() -> None:
    found = json.loads(data())
    assert set(found) == {
        *("format", "id", "site", "title", "at", "tool", "inventory", "rehearsed", "time_zone", "mask", "checklist"),
        *("devices", "since", "changes", "notes", "not_rehearsed", "spent", "costs", "exit", "errors", "tables"),
    }
    assert set(found["devices"][0]) == {
        *("name", "kind", "state", "why", "hint", "read_at", "facts", "ports", "elsewhere", "packages", "notes")
    }
    assert set(found["devices"][0]["facts"]["serial"]) == {"value", "origin", "at", "note"}
