"""What was checked before, and what is otherwise since all was green."""

from pathlib import Path

import pytest
from checklist_bench import DHCP, EVERY, FAILSAFE, NAME, PING, USBL, WIFI, Desk, answer, found, pages

from atlantis_netcfg.checklist import Scope, VehicleState, books, changes, last_green, verify
from atlantis_netcfg.checklist.report import Item, ItemChange, ItemFinding
from atlantis_netcfg.core.events import Verdict

SPARUS = Scope(vehicles=("sparus",))


@pytest.fixture
def desk(tmp_path: Path) -> Desk:
    return Desk(tmp_path / "state")


def _told(some: tuple[ItemChange, ...]) -> list[tuple[str, str | None, str | None, str]]:
    return [(one.id, one.before, one.after, one.message) for one in some]


def test_empty_history_has_no_last_green(desk: Desk) -> None:
    assert (books(desk.folder), last_green(desk.folder)) == ((), None)
    desk.signed({WIFI: Verdict.FAIL})
    assert last_green(desk.folder) is None
    with desk.open() as book:
        assert book.document().since_green is None


def test_books_are_listed_newest_last(desk: Desk) -> None:
    first = desk.signed()
    second = desk.signed({WIFI: Verdict.FAIL})
    with desk.open() as book:
        assert [(one.run, one.state) for one in books(desk.folder)] == [
            (first.name, VehicleState.SIGNED),
            (second.name, VehicleState.SIGNED),
            (book.run, VehicleState.OPEN),
        ]
    (desk.folder / "20300101T000000Z").mkdir()
    assert len(books(desk.folder)) == 3


def test_changes_since_last_green_are_listed(desk: Desk) -> None:
    green = desk.signed()
    desk.signed({WIFI: Verdict.FAIL})
    names = [name for name in EVERY if name != USBL]
    with desk.open([*names, "mares/gps"]) as book:
        book.settle(found(WIFI, Verdict.FAIL, "no association"))
        book.override(WIFI, "on the bench", NAME)
        answer(book, {FAILSAFE: Verdict.WARN})
        book.settle(found(DHCP, Verdict.FAIL, "192.168.1.7 offers addresses"))
        document = book.sign(NAME, pages)
    since = document.since_green
    assert since is not None
    assert since.run == green.name
    assert _told(since.changes) == [
        (WIFI, "PASS", "FAIL", "no association; overridden by A. Technician: on the bench"),
        (FAILSAFE, "PASS", "WARN", "A. Technician has seen that it works, but: seen so"),
        (DHCP, "PASS", "FAIL", "192.168.1.7 offers addresses"),
        ("mares/gps", None, "PASS", "new: A. Technician has seen that it is in order"),
        (USBL, "PASS", None, "no longer checked: eca-rov/usbl is well"),
    ]


def test_removed_override_is_a_change(desk: Desk) -> None:
    with desk.open([WIFI]) as book:
        book.settle(found(WIFI, Verdict.FAIL))
        book.override(WIFI, "on the bench", NAME)
        green = book.sign(NAME, pages)
    with desk.open([WIFI]) as book:
        book.settle(found(WIFI, Verdict.FAIL, "no association"))
        assert _told(changes(green, book.document())) == [(WIFI, "FAIL", "FAIL", "no association")]
    assert changes(green, green) == ()


def test_a_warning_for_another_reason_is_a_change(desk: Desk) -> None:
    def warned(code: str, message: str) -> Item:
        finding = ItemFinding(verdict=Verdict.WARN, code=code, message=message)
        return found(WIFI, Verdict.WARN, message).model_copy(update={"findings": (finding,)})

    with desk.open([WIFI]) as book:
        book.settle(warned("weak", "-78 dBm"))
        green = book.sign(NAME, pages)
    with desk.open([WIFI]) as book:
        book.settle(warned("weak", "-79 dBm"))
        assert changes(green, book.document()) == ()
        book.settle(warned("loss", "3 % are lost"))
        assert _told(changes(green, book.document())) == [(WIFI, "WARN", "WARN", "3 % are lost")]


def test_vehicle_can_be_green_where_another_failed(desk: Desk) -> None:
    folder = desk.signed({USBL: Verdict.FAIL})
    assert last_green(desk.folder) is None
    green = last_green(desk.folder, {"vehicle": ("sparus",)})
    assert green is not None
    assert (green.run, [item.id for item in green.items]) == (folder.name, [WIFI, PING])
    assert last_green(desk.folder, {"vehicle": ("eca-rov",)}) is None
    with desk.open([WIFI, PING], scope=SPARUS) as book:
        since = book.document().since_green
        assert since is not None
        assert _told(since.changes) == [
            (WIFI, "PASS", "INCONCLUSIVE", "waits"),
            (PING, "PASS", "INCONCLUSIVE", "waits"),
        ]


def test_green_of_a_narrow_scope_does_not_count_for_the_whole(desk: Desk) -> None:
    desk.signed(names=[WIFI, PING], scope=SPARUS)
    assert last_green(desk.folder) is None
    assert last_green(desk.folder, {"vehicle": ("sparus", "mares")}) is None
    assert last_green(desk.folder, {"vehicle": ("sparus",), "endpoint": ("wifi",)}) is not None


def test_green_book_that_was_changed_does_not_count(desk: Desk) -> None:
    older = desk.signed()
    newer = desk.signed()
    report = newer / "report.json"
    report.write_bytes(report.read_bytes().replace(b'"PASS"', b'"WARN"', 1))
    green = last_green(desk.folder)
    assert green is not None
    assert green.run == older.name
    assert [(one.state, one.why) for one in books(desk.folder)] == [
        (VehicleState.SIGNED, ""),
        (VehicleState.DAMAGED, "was changed after it was signed"),
    ]
    report.write_bytes(b"{}")
    assert books(desk.folder)[1].state is VehicleState.DAMAGED


def test_incomplete_book_is_listed_as_damaged(desk: Desk) -> None:
    signed = desk.signed()
    for gone, why in (
        ("records.jsonl", ""),
        ("report.json", "its report.json cannot be read"),
        ("manifest.json", "records.jsonl cannot be read: No such file or directory"),
    ):
        (signed / gone).unlink()
        (kept,) = books(desk.folder)
        assert (kept.state, kept.why) == (VehicleState.DAMAGED if why else VehicleState.SIGNED, why)
        assert verify(kept.folder)
    (signed / "records.jsonl").touch()
    assert [(one.state, one.why) for one in books(desk.folder)] == [(VehicleState.DAMAGED, "records.jsonl is empty")]
    with desk.open() as book:
        assert (book.words, len(books(desk.folder))) == ("", 2)


def test_book_killed_before_its_first_record_is_ignored(desk: Desk) -> None:
    for name in ("20260101T000000Z", "20260102T000000Z"):
        (desk.folder / name).mkdir(parents=True)
    (desk.folder / "20260102T000000Z" / "records.jsonl").touch()
    assert books(desk.folder) == ()
    desk.open().close()
    assert len(books(desk.folder)) == 1
