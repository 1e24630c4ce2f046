"""Everything found and answered is on disk before anything follows; an interrupted checklist goes on."""

import hashlib
import io
import json
import os
import stat
from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import pytest
from checklist_bench import (
    DHCP,
    EVERY,
    FAILSAFE,
    HEAD,
    NAME,
    PING,
    SKIPPED,
    USBL,
    WIFI,
    Desk,
    answer,
    found,
    open_items,
    pages,
)
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from atlantis_netcfg.checklist import (
    ChecklistUsageError,
    Confirmation,
    Scope,
    SigningError,
    VehicleState,
    books,
    verify,
)
from atlantis_netcfg.checklist.report import EvidenceType, Phase
from atlantis_netcfg.core.errors import ExitCode, UsageError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.runs import JournalError, SiteBusy


@pytest.fixture
def desk(tmp_path: Path) -> Desk:
    return Desk(tmp_path / "state")


def test_new_book_has_everything_open_that_applies(desk: Desk) -> None:
    with desk.open() as book:
        assert [item.id for item in open_items(book)] == [name for name in EVERY if name != SKIPPED]
        assert [item.id for item in open_items(book, Phase.WATER)] == [PING, USBL]
        assert book.words == ""
        document = book.document()
    assert document.exit is ExitCode.CHECKS_FAILED
    assert (document.site, document.started < desk.now.at, document.ended) == ("coastal", True, None)


def test_interrupted_checklist_is_resumed(desk: Desk) -> None:
    with desk.open() as book:
        book.settle(found(WIFI))
        book.confirm(FAILSAFE, Confirmation(Verdict.PASS, NAME, "motors stopped"))
        first, items = book.run, book.items
    with desk.open() as book:
        assert (book.run, book.items) == (first, items)
        assert book.words == f"the checklist {first} is continued"
        assert [item.id for item in open_items(book)] == [PING, USBL, DHCP]


@pytest.mark.parametrize(("hours", "ago"), [(17, ""), (20, "a day"), (49, "2 days")])
def test_age_of_earlier_results_is_shown_on_resuming(desk: Desk, hours: int, ago: str) -> None:
    with desk.open() as book:
        book.settle(found(WIFI))
    desk.now.at += timedelta(hours=hours)
    told = f"; it was started {ago} ago, and its results stand: `--anew` checks everything again"
    with desk.open() as book:
        assert book.words == f"the checklist {book.run} is continued{told if ago else ''}"


def test_a_scope_has_its_own_book(desk: Desk) -> None:
    with desk.open() as whole:
        whole.settle(found(WIFI))
    with desk.open([WIFI], scope=Scope(vehicles=("sparus",))) as narrow:
        assert narrow.run != whole.run
        assert [item.id for item in open_items(narrow)] == [WIFI]
    with desk.open() as again:
        assert again.run == whole.run


@pytest.mark.parametrize(
    ("head", "why"),
    [
        (replace(HEAD, inventory="cd" * 32), "the inventory has changed since then"),
        (replace(HEAD, tool="1.1"), "it was started with version 1.0 of this toolkit, this is 1.1"),
        (replace(HEAD, broken=("rogue-dhcp",)), "the deliberate faults are different now"),
    ],
    ids=["inventory", "tool", "broken"],
)
def test_outdated_book_stays_unfinished_with_a_reason(desk: Desk, head: object, why: str) -> None:
    with desk.open() as old:
        old.settle(found(WIFI))
    with desk.open(head=head) as new:  # type: ignore[arg-type]
        assert new.words == f"the checklist {old.run} stays unfinished, and a new one is started: {why}"
        assert len(open_items(new)) == len(EVERY) - 1
    kept = books(desk.folder)
    assert [(one.run, one.state, one.why) for one in kept] == [
        (old.run, VehicleState.UNFINISHED, why),
        (new.run, VehicleState.OPEN, ""),
    ]
    assert kept[0].document is not None
    assert kept[0].document.items[0].verdict is Verdict.PASS


def test_anew_starts_a_new_book(desk: Desk) -> None:
    with desk.open() as old:
        pass
    with desk.open(anew=True) as new:
        assert (new.run != old.run, "a new start was requested" in new.words) == (True, True)


def test_added_and_removed_steps_are_handled_on_resuming(desk: Desk) -> None:
    with desk.open([WIFI, DHCP]) as book:
        answer(book)
    with desk.open([WIFI, USBL]) as book:
        assert [(one.id, one.open) for one in book.items] == [(WIFI, False), (USBL, True)]


def test_second_process_is_told_who_holds_the_book(desk: Desk) -> None:
    with desk.open(), pytest.raises(SiteBusy, match=f"the checklist of coastal is locked by .*{os.getpid()}"):
        desk.open()
    desk.open().close()


def test_repeated_probe_replaces_result_and_history_keeps_both(desk: Desk) -> None:
    with desk.open() as book:
        book.settle(found(WIFI, Verdict.FAIL, "no association"))
        book.override(WIFI, "the vehicle stays on the bench", NAME)
        assert book.item(WIFI).counts is Verdict.WARN
        settled = book.settle(found(WIFI))
        assert settled.override is None
        assert ("earlier override, replaced", "FAIL: the vehicle stays on the bench", NAME) in [
            (evidence.what, evidence.value, evidence.by) for evidence in settled.evidence
        ]
        log = (book.folder / "records.jsonl").read_text()
    assert book.item(WIFI).verdict is Verdict.PASS
    assert [json.loads(line)["record"] for line in log.splitlines()] == ["begun", "settled", "overridden", "settled"]
    assert "no association" in log


@pytest.mark.parametrize(
    ("verdict", "note", "message", "hint"),
    [
        (Verdict.PASS, "", "A. Technician has seen that it is in order", None),
        (
            Verdict.WARN,
            "slow",
            "A. Technician has seen that it works, but: slow",
            "decide whether the test can continue in spite of it",
        ),
        (
            Verdict.FAIL,
            "motors ran on",
            "A. Technician has seen that it is not in order: motors ran on",
            "fix it and answer again, or override it with a reason",
        ),
        (
            Verdict.INCONCLUSIVE,
            "too dark",
            "A. Technician could not tell: too dark",
            "check again when it can be seen, or override it with a reason",
        ),
        (Verdict.SKIP, "no flight today", "A. Technician says that it does not apply: no flight today", None),
    ],
)
def test_confirmation_is_recorded(desk: Desk, verdict: Verdict, note: str, message: str, hint: str | None) -> None:
    with desk.open() as book:
        item = book.confirm(FAILSAFE, Confirmation(verdict, NAME, note))
    assert (item.verdict, item.message, item.hint, item.open) == (verdict, message, hint, False)
    assert [(one.verdict, one.message, one.hint) for one in item.findings] == [(verdict, message, hint)]
    assert [(one.type, one.by, one.value) for one in item.evidence] == [
        (EvidenceType.CONFIRMED, NAME, note or str(verdict))
    ]


@pytest.mark.parametrize(
    ("name", "said", "message"),
    [
        (WIFI, Confirmation(Verdict.PASS, NAME), "`sparus/wifi` is checked by the toolkit: a person cannot answer it"),
        (
            "stork/rc_rf/failsaf",
            Confirmation(Verdict.PASS, NAME),
            "this checklist has no item `stork/rc_rf/failsaf`",
        ),
        (FAILSAFE, Confirmation(Verdict.PASS, " "), "a name is missing"),
        (FAILSAFE, Confirmation(Verdict.PASS, "x" * 101), "a name is too long"),
        (FAILSAFE, Confirmation(Verdict.FAIL, NAME, " "), "the reason for FAIL is missing"),
        (FAILSAFE, Confirmation(Verdict.PASS, NAME, "\x1b[2J"), "the reason for PASS is too long, or contains control"),
        (FAILSAFE, Confirmation(Verdict.ERROR, NAME, "x"), "a person cannot give the verdict ERROR"),
    ],
)
def test_invalid_confirmation_is_refused_and_not_written(
    desk: Desk, name: str, said: Confirmation, message: str
) -> None:
    with desk.open() as book:
        before = (book.folder / "records.jsonl").read_bytes()
        with pytest.raises(ChecklistUsageError, match="^" + message.replace("(", r"\(")) as told:
            book.confirm(name, said)
        assert told.value.hint
        assert isinstance(told.value, UsageError)
        assert (book.folder / "records.jsonl").read_bytes() == before


def test_person_may_answer_an_active_step(desk: Desk) -> None:
    with desk.open() as book:
        item = book.confirm(PING, Confirmation(Verdict.SKIP, NAME, "a diver is near"))
    assert (item.verdict, item.open) == (Verdict.SKIP, False)


@pytest.mark.parametrize("verdict", [Verdict.FAIL, Verdict.INCONCLUSIVE, Verdict.ERROR])
def test_an_override_needs_a_reason_and_a_name(desk: Desk, verdict: Verdict) -> None:
    with desk.open() as book:
        book.settle(found(WIFI, verdict))
        for reason, by in (("", NAME), ("known", " ")):
            with pytest.raises(ChecklistUsageError, match="is missing"):
                book.override(WIFI, reason, by)
        item = book.override(WIFI, "known  and\n accepted", NAME)
    assert item.override is not None
    assert (item.override.reason, item.override.by) == ("known and accepted", NAME)
    assert (item.verdict, item.counts) == (verdict, Verdict.WARN)


@pytest.mark.parametrize("verdict", [Verdict.PASS, Verdict.WARN, Verdict.SKIP])
def test_green_item_cannot_be_overridden(desk: Desk, verdict: Verdict) -> None:
    with desk.open() as book:
        book.settle(found(WIFI, verdict))
        with pytest.raises(ChecklistUsageError, match=f"`sparus/wifi` is {verdict}: there is nothing to override"):
            book.override(WIFI, "why not", NAME)


def test_evidence_is_copied_and_private(desk: Desk, tmp_path: Path) -> None:
    photo = tmp_path / "fäil safe (1).jpg"
    photo.write_bytes(b"\xff\xd8 a photo")
    with desk.open() as book:
        item = book.confirm(FAILSAFE, Confirmation(Verdict.PASS, NAME, files=(photo, photo)))
        photo.unlink()
        files = book.files
    one = item.evidence[1]
    assert one.file is not None
    assert (one.type, one.what, one.value, one.by) == (EvidenceType.FILE, "f_il_safe_1_.jpg", "10 bytes", NAME)
    assert one.file == f"files/{(one.sha256 or '')[:12]}-f_il_safe_1_.jpg"
    assert files == {one.file: b"\xff\xd8 a photo"}
    assert stat.S_IMODE((book.folder / one.file).stat().st_mode) == 0o600
    assert stat.S_IMODE((book.folder / "files").stat().st_mode) == 0o700


POSITION = "41 deg 11' N"


def photo_of(kind: str, size: tuple[int, int] = (40, 30)) -> bytes:
    """As a telephone makes it: turned, with position, camera and text, and something behind its end."""
    exif = Image.Exif()
    exif[0x0112] = 6
    exif[0x010F] = f"Camera at {POSITION}"
    exif.get_ifd(0x8825)[0x001D] = POSITION
    more: dict[str, object] = {"exif": exif}
    if kind == "PNG":
        text = PngInfo()
        text.add_text("Location", POSITION)
        more["pnginfo"] = text
    if kind in {"JPEG", "GIF"}:
        more["comment"] = POSITION.encode()
    if kind == "GIF":
        del more["exif"]
    made = io.BytesIO()
    Image.linear_gradient("L").resize(size).convert("RGB").save(made, kind, **more)
    return made.getvalue() + POSITION.encode()


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "WEBP", "GIF"])
def test_photo_metadata_is_removed(desk: Desk, tmp_path: Path, kind: str) -> None:
    photo = tmp_path / f"robot.{kind.lower()}"
    photo.write_bytes(photo_of(kind))
    assert POSITION.encode() in photo.read_bytes()
    with desk.open() as book:
        (one,) = book.confirm(FAILSAFE, Confirmation(Verdict.PASS, NAME, files=(photo,))).evidence[1:]
        assert one.file is not None
        data = book.files[one.file]
    assert one.sha256 == hashlib.sha256(data).hexdigest()
    assert POSITION.encode() not in data
    with Image.open(io.BytesIO(data)) as image:
        assert image.format == kind
        assert not image.getexif()
        assert image.size == ((40, 30) if kind == "GIF" else (30, 40)), "it is set upright"
        shades = image.convert("L").histogram()
    assert sum(shades[:12]) > 0 < sum(shades[-12:]), "the gradient is there"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda _: None, "file `.*photo.jpg` does not exist"),
        (lambda path: path.mkdir(), "is not a file"),
        (os.mkfifo, "is not a file"),
        (lambda path: path.symlink_to("good.jpg"), "is a symbolic link, which is not followed"),
        (lambda path: path.write_bytes(b"\xff\xd8\xff\xe1 half"), "is a damaged picture of type JPEG"),
        (lambda path: path.write_bytes(b"\0\0\0\x18ftypheic\0\0"), "is a picture of type HEIC, whose position"),
        (lambda path: path.write_bytes(b"II*\0 tiff"), "is a picture of type TIFF"),
        (lambda path: path.touch(), "is empty"),
        (lambda path: path.write_bytes(bytes(25_000_001)), "has 25 MB; the maximum is 25 MB"),
    ],
    ids=["missing", "folder", "pipe", "link", "damaged", "heic", "tiff", "empty", "large"],
)
def test_unsuitable_evidence_files_are_refused(desk: Desk, tmp_path: Path, make: object, message: str) -> None:
    make(tmp_path / "photo.jpg")  # type: ignore[operator]
    good = tmp_path / "good.jpg"
    good.write_bytes(b"good")
    with desk.open() as book:
        with pytest.raises(ChecklistUsageError, match=message) as told:
            book.confirm(FAILSAFE, Confirmation(Verdict.PASS, NAME, files=(good, tmp_path / "photo.jpg")))
        assert told.value.hint
        assert book.item(FAILSAFE).open
        assert not (book.folder / "files").exists()


def test_book_with_open_items_cannot_be_signed(desk: Desk) -> None:
    with desk.open() as book:
        answer(book)
        book.settle(found(WIFI))
    with desk.open([*EVERY, "mares/gps"]) as book:
        with pytest.raises(SigningError, match="1 of 7 items are open: mares/gps") as told:
            book.sign(NAME, pages)
        assert told.value.exit is ExitCode.CHECKS_FAILED
        assert [path.name for path in book.folder.iterdir()] == ["records.jsonl"]
        book.override("mares/gps", "Mares is not here", NAME)
        document = book.sign(NAME, pages)
    assert document.exit is ExitCode.DONE


def test_item_left_open_on_purpose_is_reported_and_not_green(desk: Desk) -> None:
    with desk.open([WIFI, PING]) as book:
        book.settle(found(WIFI))
        for leave, error in (
            ({PING: " "}, "the reason for leaving it open is missing"),
            ({"x": "y"}, "this checklist has no item `x`"),
        ):
            with pytest.raises(ChecklistUsageError, match=error):
                book.sign(NAME, pages, leave=leave)
        document = book.sign(NAME, pages, leave={PING: "the sea is too rough", WIFI: "was not reached before"})
    assert [(one.what, one.why) for one in document.left_out] == [
        ("sparus/usbl/ping: sparus/usbl/ping is well", "the sea is too rough")
    ]
    assert document.exit is ExitCode.CHECKS_FAILED
    assert verify(book.folder) == ()


def test_a_failure_can_be_signed_as_a_failure(desk: Desk) -> None:
    with desk.open() as book:
        answer(book, {WIFI: Verdict.FAIL})
        document = book.sign(NAME, pages)
    assert (document.exit, document.verdict) == (ExitCode.CHECKS_FAILED, Verdict.FAIL)


def test_a_signed_book_is_closed(desk: Desk) -> None:
    with desk.open() as book:
        answer(book)
        document = book.sign(NAME, pages)
        assert document.ended is not None
        assert book.document().signed == document.signed
        for change in (
            lambda: book.settle(found(WIFI)),
            lambda: book.sign(NAME, pages),
            lambda: book.confirm(FAILSAFE, Confirmation(Verdict.PASS, NAME)),
        ):
            with pytest.raises(ChecklistUsageError, match="this checklist is signed"):
                change()
    assert sorted(path.name for path in book.folder.iterdir()) == [
        "junit.xml",
        "manifest.json",
        "records.jsonl",
        "report.html",
        "report.json",
    ]
    with desk.open() as new:
        assert (new.run != book.run, new.words) == (True, "")


def test_unknown_file_in_folder_blocks_signing_and_is_kept(desk: Desk) -> None:
    with desk.open() as book:
        answer(book)
        (book.folder / "holiday.jpg").write_bytes(b"sun")
        with pytest.raises(SigningError, match=r"`holiday.jpg` in the folder of the checklist does not belong to it"):
            book.sign(NAME, pages)
        (book.folder / "holiday.jpg").unlink()
        book.sign(NAME, pages)


@pytest.mark.parametrize("name", ["report.json", "manifest.json", "../x.html", "records.jsonl", ".x"])
def test_page_cannot_use_a_reserved_name(desk: Desk, name: str) -> None:
    with desk.open([WIFI]) as book:
        answer(book)
        with pytest.raises(ValueError, match="invalid page names:"):
            book.sign(NAME, lambda _: {name: b""})


def test_full_disk_is_reported_and_leaves_no_partial_record(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    with desk.open() as book:
        book.settle(found(WIFI))
        size = (book.folder / "records.jsonl").stat().st_size
        real = os.write

        def full(descriptor: int, data: bytes) -> int:
            if len(data) > 50:
                return real(descriptor, data[:50])
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(os, "write", full)
        with pytest.raises(JournalError, match="the checklist cannot be written: No space left on device"):
            book.settle(found(DHCP))
        monkeypatch.undo()
        assert (book.folder / "records.jsonl").stat().st_size == size
        assert book.item(DHCP).open
        with pytest.raises(JournalError):
            book.settle(found(DHCP))


def test_interrupted_write_is_undone(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(_: int) -> None:
        raise KeyboardInterrupt

    with desk.open() as book:
        book.settle(found(WIFI))
        with monkeypatch.context() as patch:
            patch.setattr(os, "fsync", interrupted)
            with pytest.raises(KeyboardInterrupt):
                book.settle(found(DHCP))
        assert book.item(DHCP).open
        book.settle(found(DHCP, Verdict.WARN))
    with desk.open() as book:
        assert (book.item(WIFI).verdict, book.item(DHCP).verdict) == (Verdict.PASS, Verdict.WARN)


def _log(desk: Desk) -> Path:
    (path,) = desk.folder.glob("*/records.jsonl")
    return path


def test_item_of_a_torn_last_line_is_open_again(desk: Desk) -> None:
    with desk.open() as book:
        book.settle(found(WIFI))
        before = (book.folder / "records.jsonl").stat().st_size
        book.settle(found(DHCP))
    whole = _log(desk).read_bytes()
    for cut in {before + 1, before + 40, len(whole) - 2, len(whole) - 1}:
        _log(desk).write_bytes(whole[:cut])
        with desk.open() as book:
            assert (book.item(WIFI).open, book.item(DHCP).open) == (False, True)
            assert (
                "is incomplete: the program was killed while writing it, and its content is asked again" in book.words
            )
            book.settle(found(DHCP))
        assert books(desk.folder)[0].state is VehicleState.OPEN


def test_a_last_line_of_zeros_is_cut_off(desk: Desk) -> None:
    with desk.open() as book:
        book.settle(found(WIFI))
    whole = _log(desk).read_bytes()
    _log(desk).write_bytes(whole + b"\0" * 100 + b"\n")
    with desk.open() as book:
        assert not book.item(WIFI).open
        assert book.words.endswith("line 3 cannot be read, and its content is asked again")


def test_changed_line_is_damage_and_a_new_book_begins(desk: Desk) -> None:
    with desk.open() as book:
        book.settle(found(WIFI))
        book.settle(found(DHCP))
    _log(desk).write_bytes(_log(desk).read_bytes().replace(b'"as it should be"', b'"as it should not"', 1))
    with desk.open() as new:
        assert "is damaged (line 3 does not follow from the line above): a new one is started" in new.words
    assert [one.state for one in books(desk.folder)] == [VehicleState.DAMAGED, VehicleState.OPEN]
