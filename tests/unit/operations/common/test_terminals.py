"""Terminals in a run: judged, recorded by a run that may change devices, and never spoken to."""

import hashlib
import json
import os
import shutil
from datetime import date
from pathlib import Path

import pytest

from atlantis_netcfg.core.errors import ExitCode, UsageError
from atlantis_netcfg.inventory import load
from atlantis_netcfg.operations.common.request import Mode, Request
from atlantis_netcfg.operations.common.terminals import is_terminal, judge_terminal, perform
from atlantis_netcfg.runs import DamagedStateError, Store

SHIPPED = Path(__file__).parents[4] / "inventory"
BACKUP = b"settings of a terminal"
TODAY = date(2026, 11, 21)


@pytest.fixture
def inventory(tmp_path: Path) -> Path:
    root = tmp_path / "inventory"
    shutil.copytree(SHIPPED, root)
    return root


def declare(inventory: Path, firmware: str = "1.2.3", more: str = "") -> None:
    """Write evidence with the backup's true hash."""
    path = inventory / "host_vars" / "coastal-sat.yml"
    shutil.copy(SHIPPED / "host_vars" / "coastal-sat.yml", path)
    digest = hashlib.sha256(BACKUP).hexdigest()
    words = f"firmware: {firmware}, allow_list: true, by: INESC, seen_on: 2026-11-20"
    text = f'  evidence: {{{words}, backup_file: sat.bin, backup_sha256: "{digest}"{more}}}\n'
    path.write_text(path.read_text("utf-8") + text, "utf-8")


def keep(inventory: Path, data: bytes) -> None:
    (inventory / "evidence").mkdir(exist_ok=True)
    (inventory / "evidence" / "sat.bin").write_bytes(data)


def codes(inventory: Path, state: Path, backup: Path | None = None) -> list[str]:
    declaration = load(inventory)
    found = judge_terminal(declaration, declaration.hosts["coastal-sat"], Store(state), today=TODAY, backup=backup)
    return [finding.code for finding in found.findings]


def run(inventory: Path, state: Path, mode: Mode = Mode.APPLY) -> dict[str, object]:
    request = Request(state=state, mode=mode).model_dump(mode="json")
    outcome = perform(inventory, ["coastal-sat"], request, plan_only=False)
    told: dict[str, object] = outcome["per_host"]["coastal-sat"]
    assert outcome["warnings"] == [f"coastal-sat: {note}" for note in told["notes"]]  # type: ignore[attr-defined]  # a list
    return told


def test_shipped_terminals_are_not_inspected_yet(tmp_path: Path) -> None:
    declaration = load(SHIPPED)
    terminals = [host for host in declaration.hosts.values() if is_terminal(host)]
    assert [host.name for host in terminals] == ["coastal-sat", "te4sea-sat"]
    for host in terminals:
        found = judge_terminal(declaration, host, Store(tmp_path), today=TODAY)
        assert [finding.code for finding in found.findings] == ["terminal-not-looked-at"]
        assert (found.exit, found.as_dict()["planned"]) == (ExitCode.DONE, 0)


def test_backup_in_the_inventory_is_compared(inventory: Path, tmp_path: Path) -> None:
    declare(inventory)
    assert codes(inventory, tmp_path) == ["terminal-backup-not-here"]
    keep(inventory, BACKUP)
    assert codes(inventory, tmp_path) == []
    keep(inventory, BACKUP + b", changed")
    assert codes(inventory, tmp_path) == ["terminal-backup-differs"]
    told = run(inventory, tmp_path)
    assert (told["ok"], told["changed"], told["exit"]) == (False, False, 6)
    assert "is not the one in the inventory" in str(told["message"])


def test_named_backup_file_is_compared(inventory: Path, tmp_path: Path) -> None:
    declare(inventory)
    named = tmp_path / "download.bin"
    named.write_bytes(BACKUP)
    assert codes(inventory, tmp_path, named) == []
    named.write_bytes(b"something else")
    assert codes(inventory, tmp_path, named) == ["terminal-backup-differs"]
    with pytest.raises(UsageError, match=r"cannot read the backup .*missing\.bin: "):
        codes(inventory, tmp_path, tmp_path / "missing.bin")


def test_changed_firmware_is_reported_until_a_run_records_it(inventory: Path, tmp_path: Path) -> None:
    keep(inventory, BACKUP)
    declare(inventory)
    assert run(inventory, tmp_path)["notes"] == []
    declare(inventory, firmware="1.3.0")
    for mode in (Mode.PLAN, Mode.APPLY):
        note = str(run(inventory, tmp_path, mode)["notes"])
        assert "had firmware 1.2.3 when a run last recorded it, and now has 1.3.0" in note
    assert run(inventory, tmp_path)["notes"] == []


def test_terminal_behind_nat_is_reported(inventory: Path, tmp_path: Path) -> None:
    keep(inventory, BACKUP)
    declare(inventory, more=", sim_address: 172.31.4.5")
    assert codes(inventory, tmp_path) == ["carrier-nat"]


def test_damaged_record_is_reported(inventory: Path, tmp_path: Path) -> None:
    declare(inventory)
    run(inventory, tmp_path)
    record = Store(tmp_path).root / "terminals.json"
    assert record.stat().st_mode & 0o077 == 0
    record.write_text("[]")
    with pytest.raises(DamagedStateError, match="cannot read the record of the terminals:"):
        codes(inventory, tmp_path)


def test_damaged_record_is_reported_to_the_listener(inventory: Path, tmp_path: Path) -> None:
    declare(inventory)
    run(inventory, tmp_path)
    (Store(tmp_path).root / "terminals.json").write_text("[]")
    reader, writer = os.pipe()
    request = Request(state=tmp_path, events_fd=writer).model_dump(mode="json")
    with pytest.raises(DamagedStateError):
        perform(inventory, ["coastal-sat"], request, plan_only=False)
    os.close(writer)
    with os.fdopen(reader, encoding="utf-8") as told:
        assert "the record of the terminals" in json.loads(told.readline())["error"]["message"]
