"""What the journal of this computer says of a device: who adopted it and when, the last run that it was right after."""

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

from atlantis_netcfg.inventory import load
from atlantis_netcfg.records.asbuilt.collect import JournalFacts
from atlantis_netcfg.records.asbuilt.record import DeviceRecord, Fact, Origin, ReadState
from atlantis_netcfg.runs import Outcome, Purpose, RunEnd, RunStart, Store

SHIPPED = load(Path(__file__).parents[4] / "inventory")
ROUTER, SERVER = "coastal-router", "coastal-gateway"


def ran(state: Path, day: int, purpose: Purpose, status: str, by: str = "") -> None:
    store = Store(state, now=lambda: datetime(2026, 11, day, tzinfo=UTC))
    started = RunStart(
        site="coastal", revision="", tool="0", hosts=(ROUTER,), rehearsed=False, command="", purpose=purpose, by=by
    )
    with store.start(started) as journal:
        for name in (ROUTER, SERVER):
            journal.write(Outcome(device=name, status=status, exit=0 if status == "changed" else 4, message=""))
        journal.write(RunEnd(exit=0))


def facts(state: Path, name: str = ROUTER) -> Mapping[str, Fact]:
    device = DeviceRecord(name=name, kind="router", state=ReadState.NOT_REACHED)
    return JournalFacts(SHIPPED, "coastal", Store(state)).extend_record(device).facts


def test_empty_state_gives_facts_marked_not_read(tmp_path: Path) -> None:
    found = facts(tmp_path)
    assert {name: fact.origin for name, fact in found.items()} == dict.fromkeys(
        ("adopted", "confirmed", "host_key"), Origin.NOT_READ
    )
    assert all(fact.note for fact in found.values())


def test_adoption_records_who_and_when(tmp_path: Path) -> None:
    ran(tmp_path, 1, Purpose.ADOPT, "changed", by="EXAMPLE-person on EXAMPLE-laptop")
    ran(tmp_path, 2, Purpose.CONFIGURE, "changed")
    adopted = facts(tmp_path)["adopted"]
    assert (adopted.value, adopted.origin) == ("EXAMPLE-person on EXAMPLE-laptop", Origin.STORED)
    assert adopted.at == datetime(2026, 11, 1, tzinfo=UTC)


def test_adoption_by_an_earlier_release_has_no_person(tmp_path: Path) -> None:
    ran(tmp_path, 1, Purpose.ADOPT, "changed")
    assert facts(tmp_path)["adopted"].value == "who did it was not recorded"


def test_failed_adoption_does_not_count(tmp_path: Path) -> None:
    ran(tmp_path, 1, Purpose.ADOPT, "half-adopted", by="EXAMPLE-person on EXAMPLE-laptop")
    assert facts(tmp_path)["adopted"].origin is Origin.NOT_READ


def test_last_confirmed_run_is_used_even_if_archived(tmp_path: Path) -> None:
    ran(tmp_path, 1, Purpose.CONFIGURE, "changed")
    for day in range(2, 16):
        ran(tmp_path, day, Purpose.CONFIGURE, "refused")
    for name in (ROUTER, SERVER):
        confirmed = facts(tmp_path, name)["confirmed"]
        assert (confirmed.value, confirmed.note) == ("20261101T000000Z", "changed")


def test_computer_has_only_the_confirmed_fact(tmp_path: Path) -> None:
    assert set(facts(tmp_path, SERVER)) == {"confirmed"}


def test_host_key_pin_is_reported(tmp_path: Path) -> None:
    Store(tmp_path).pins.change_host_key(ROUTER, "SHA256:" + "A" * 43)
    found = facts(tmp_path)["host_key"]
    assert (found.value, found.note) == ("SHA256:" + "A" * 43, "the pin on this computer")
