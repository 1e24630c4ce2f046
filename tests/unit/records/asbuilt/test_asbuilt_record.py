"""A record says what is different, keeps what it could not read as last known, and is green only for what was read."""

import json
from pathlib import Path

import pytest
from asbuilt_examples import AT, GATEWAY, LATER, away, port, read, record, router, terminal

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.stored_messages import marked_texts
from atlantis_netcfg.inventory.model import NumberMask
from atlantis_netcfg.records.asbuilt.archive import FILE, keep, latest, new_folder, parse_record, record_json
from atlantis_netcfg.records.asbuilt.record import (
    AsBuiltRecord,
    CableState,
    DeviceRecord,
    Fact,
    Origin,
    ReadState,
    compare,
    mask_number,
    report_tables,
)
from atlantis_netcfg.runs import DamagedStateError, JournalError

NUMBER = "001017000001234"


@pytest.mark.parametrize(
    ("mask", "number", "shown"),
    [
        (NumberMask.LAST4, NUMBER, "***********1234"),
        (NumberMask.FULL, NUMBER, "***************"),
        (NumberMask.NONE, NUMBER, NUMBER),
        (NumberMask.LAST4, "1234", "****"),
    ],
)
def test_a_number_is_masked_as_declared(mask: NumberMask, number: str, shown: str) -> None:
    assert mask_number(number, mask) == shown


def later(*devices: DeviceRecord) -> AsBuiltRecord:
    return record(*devices, id="20261126T100000Z", at=LATER)


def words(now: AsBuiltRecord, before: AsBuiltRecord) -> list[str]:
    return [change.words for change in compare(now, before).changes]


def test_first_record_has_no_changes() -> None:
    found = compare(record(), None)
    assert (found.since, found.changes) == (None, ())


def test_identical_record_has_no_changes() -> None:
    found = compare(later(router(read_at=LATER), terminal()), record())
    assert (found.since, found.changes) == ("20261125T100000Z", ())


def test_changed_serial_number_is_reported() -> None:
    told = words(later(router("EXAMPLE2", read_at=LATER)), record())
    assert told == ["coastal-router: serial number changed from EXAMPLE1 to EXAMPLE2"]


def test_plugged_and_unplugged_neighbours_are_reported() -> None:
    plugged, empty = router("EXAMPLE1", port(neighbours=(GATEWAY,))), router("EXAMPLE1", port())
    shown = "02:00:5E:00:00:07 10.64.1.7 (coastal-gateway)"
    assert words(later(plugged), record(empty)) == [f"coastal-router: port ether3 now has {shown}"]
    assert words(later(empty), record(plugged)) == [f"coastal-router: port ether3 no longer has {shown}"]


def test_link_speed_and_mac_of_a_port_are_compared() -> None:
    other = port(mac="02:00:5E:00:01:99", link=CableState.UP, speed="100Mbps")
    assert words(later(router("EXAMPLE1", other)), record()) == [
        "coastal-router: MAC of port ether3 changed from 02:00:5E:00:01:03 to 02:00:5E:00:01:99",
        "coastal-router: speed of port ether3 changed from 1Gbps to 100Mbps",
    ]
    down = port(link=CableState.DOWN, speed=None)
    assert words(later(router("EXAMPLE1", down)), record()) == [
        "coastal-router: link of port ether3 changed from up to down"
    ]


def test_changed_package_version_is_reported() -> None:
    before = record(router(packages={"chrony": "4.3-2", "gpsd": "3.22-4"}))
    now = later(router(packages={"chrony": "4.3-3", "gpsd": "3.22-4"}))
    assert words(now, before) == ["coastal-router: package chrony changed from 4.3-2 to 4.3-3"]


def test_journal_runs_are_not_device_changes() -> None:
    ran = {"confirmed": Fact(value="run-2", origin=Origin.STORED, at=LATER)}
    assert words(later(router(facts={**router().facts, **ran})), record()) == []


@pytest.mark.parametrize("rehearsed", [True, False])
def test_changed_certificate_counts_except_on_emulated_devices(*, rehearsed: bool) -> None:
    before, now = (router(facts={**router().facts, "certificate": read(text * 64)}) for text in "ab")
    found = compare(record(now, rehearsed=rehearsed), record(before, rehearsed=rehearsed)).changes
    assert [change.what for change in found] == ([] if rehearsed else ["TLS certificate"])


@pytest.mark.parametrize("rehearsed", [True, False])
def test_changed_mac_counts_except_on_emulated_computers(*, rehearsed: bool) -> None:
    before, now = (router("EXAMPLE1", port(mac=f"02:00:5E:00:01:0{n}"), kind="gateway") for n in "12")
    found = compare(record(now, rehearsed=rehearsed), record(before, rehearsed=rehearsed)).changes
    assert [change.what for change in found] == ([] if rehearsed else ["MAC of port ether3"])


def test_unreachable_device_keeps_last_known_values_marked_as_stored() -> None:
    found = compare(later(away()), record()).device("coastal-router")
    assert found is not None
    assert found.state is ReadState.NOT_REACHED
    assert found.facts["serial"] == Fact(value="EXAMPLE1", origin=Origin.STORED, at=AT)
    assert (found.read_at, [each.name for each in found.ports]) == (AT, ["ether3"])


def test_stored_values_keep_their_time_and_are_compared_on_next_reading() -> None:
    second = compare(later(away()), record())
    third = compare(record(away(), id="20261127T100000Z"), second)
    found = third.device("coastal-router")
    assert found is not None
    assert found.facts["serial"].at == AT
    assert third.changes == ()
    fourth = compare(record(router("EXAMPLE2"), id="20261128T100000Z"), third)
    assert [change.after for change in fourth.changes] == ["EXAMPLE2"]


@pytest.mark.parametrize(
    ("devices", "code"),
    [
        ((router(), terminal()), ExitCode.DONE),
        ((router(), away(name="coastal-cpe")), ExitCode.CHECKS_FAILED),
        ((router(state=ReadState.IN_PART),), ExitCode.CHECKS_FAILED),
        ((terminal(),), ExitCode.NOTHING),
        ((away(),), ExitCode.CHECKS_FAILED),
    ],
)
def test_exit_code_is_success_only_if_everything_was_read(devices: tuple[DeviceRecord, ...], code: ExitCode) -> None:
    assert record(*devices).exit is code


def test_report_tables_contain_only_read_values() -> None:
    stored = compare(later(away(), terminal()), record())
    assert [(table.number, table.rows) for table in report_tables(stored)] == [(8, ()), (9, ()), (31, ()), (32, ())]
    gateway = router(name="coastal-gateway", kind="gateway", packages={"chrony": "4.3-2"}, facts={"os": read("Debian")})
    found = {table.number: table.rows for table in report_tables(record(router(), gateway, terminal()))}
    hardware = ("coastal-router", "router", "EXAMPLE-BOARD", "EXAMPLE1", "7.18.2 (stable)")
    assert found[8] == (hardware, ("coastal-gateway", "gateway", None, None, "Debian"))
    assert (found[9], found[31]) == ((), ())
    assert found[32] == (("coastal-gateway", "chrony", "4.3-2"),)


def test_signed_checklist_marks_devices_as_tested_and_centre_has_a_table() -> None:
    signed = Fact(value="20261124T100000Z", origin=Origin.STORED, at=AT)
    found = {table.number: table.rows for table in report_tables(record(checklist=signed))}
    assert [row[-1] for row in found[31]] == ["20261124T100000Z"]
    server = router(name="scc-vpn", kind="vpn_server")
    found = {table.number: table.rows for table in report_tables(record(router(), server))}
    assert (found[8], len(found[9])) == ((), 2)


# Records are kept whole or not at all, and what cannot be read is said.


def data(**more: str) -> bytes:
    return record_json(record(**more))


def test_latest_record_is_returned_as_stored(tmp_path: Path) -> None:
    assert latest(tmp_path / "asbuilt") is None
    for at, name in ((AT, "20261125T100000Z"), (LATER, "20261126T100000Z")):
        folder = new_folder(tmp_path / "asbuilt", at)
        assert folder.name == name
        keep(folder, {FILE: data(id=name), "as-built.html": b"page"})
    assert latest(tmp_path / "asbuilt") == record(id="20261126T100000Z")
    assert (tmp_path / "asbuilt" / "20261126T100000Z" / FILE).stat().st_mode & 0o777 == 0o600


def test_stored_record_keeps_the_values_of_its_messages(tmp_path: Path) -> None:
    why = msg(f"no response from {arg('10.64.1.1')} within {arg(20)} s")
    keep(new_folder(tmp_path, AT), {FILE: record_json(record(away(why=why)))})
    stored = latest(tmp_path)
    assert stored == record(away(why=why))
    assert marked_texts(stored) == marked_texts([why])


def test_record_without_json_after_a_kill_is_ignored(tmp_path: Path) -> None:
    keep(new_folder(tmp_path, AT), {FILE: data()})
    (new_folder(tmp_path, LATER) / "as-built.html").write_bytes(b"page")
    assert latest(tmp_path) == record()


def test_a_full_disk_leaves_no_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = new_folder(tmp_path, AT)

    def full(_descriptor: int, _data: bytes) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("atlantis_netcfg.core.atomic_files.write_all", full)
    with pytest.raises(JournalError, match="the record cannot be written: No space left on device"):
        keep(folder, {FILE: data(), "as-built.html": b"page"})
    assert latest(tmp_path) is None


@pytest.mark.parametrize("text", [b"", b"[]", b"{}", b'{"format": 1'])
def test_damaged_record_is_reported(tmp_path: Path, text: bytes) -> None:
    keep(new_folder(tmp_path, AT), {FILE: text})
    with pytest.raises(DamagedStateError, match="the last record cannot be read") as caught:
        latest(tmp_path)
    assert caught.value.hint is not None
    assert "move its folder away" in caught.value.hint


def test_json_contains_exit_code_and_can_be_parsed_back() -> None:
    found = json.loads(data())
    assert (found["exit"], found["errors"], [table["number"] for table in found["tables"]]) == (0, [], [8, 9, 31, 32])
    assert parse_record(data()) == record()


def test_json_has_the_documented_keys() -> None:
    found = json.loads(data())
    assert set(found) == {
        *("format", "id", "site", "title", "at", "tool", "inventory", "rehearsed", "time_zone", "mask", "checklist"),
        *("devices", "since", "changes", "notes", "not_rehearsed", "spent", "costs", "exit", "errors", "tables"),
    }
    assert set(found["devices"][0]) == {
        *("name", "kind", "state", "why", "hint", "read_at", "facts", "ports", "elsewhere", "packages", "notes")
    }
    assert set(found["devices"][0]["facts"]["serial"]) == {"value", "origin", "at", "note"}
