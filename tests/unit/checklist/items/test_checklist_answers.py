"""A file of answers is read whole or not at all, and every error of it is told with its line."""

from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from answers_cases import cases, told
from checklist_bench import DHCP, EVERY, FAILSAFE, NAME, PING, USBL, WIFI, Desk, checklist, found, open_items

from atlantis_netcfg.checklist import Answers, AnswersInvalid, ChecklistUsageError, Confirmation, Overriding
from atlantis_netcfg.core.errors import ExitCode, UsageError
from atlantis_netcfg.core.events import Verdict

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.report import Item

WHOLE = """
name: A. Technician
consents:
  sparus/usbl/ping: in the water, nobody dives near it
answers:
  stork/rc_rf/failsafe: {verdict: PASS, note: motors stopped after 2 s, files: [failsafe.jpg]}
  eca-rov/usbl: {verdict: WARN, by: B. Pilot, note: fixes jump by 2 m}
overrides:
  sparus/wifi: {reason: tested with the cable today}
  coastal/site/rogue-dhcp: {reason: a guest, by: B. Pilot}
sign: true
"""


@pytest.fixture
def desk(tmp_path: Path) -> Desk:
    return Desk(tmp_path / "state")


@pytest.mark.parametrize("case", cases(), ids=lambda path: path.stem)
def test_output_matches_expected_text(case: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert told(case, tmp_path) == case.with_suffix(".txt").read_text(encoding="utf-8")


def _read(folder: Path, text: str, names: tuple[str, ...] = EVERY, beyond: tuple[str, ...] = ()) -> Answers:
    (folder / "failsafe.jpg").write_bytes(b"a photo")
    (folder / "answers.yml").write_text(text)
    listed = checklist(names)
    object.__setattr__(listed, "beyond", beyond)
    return Answers.read(folder / "answers.yml", listed)


def test_a_whole_file(tmp_path: Path) -> None:
    answers = _read(tmp_path, WHOLE)
    photo = (tmp_path / "failsafe.jpg",)
    assert answers.confirmations.get(FAILSAFE) == Confirmation(Verdict.PASS, NAME, "motors stopped after 2 s", photo)
    assert answers.confirmations.get(USBL) == Confirmation(Verdict.WARN, "B. Pilot", "fixes jump by 2 m")
    assert answers.confirmations.get(WIFI) is None
    assert answers.consents(PING) == "A. Technician: in the water, nobody dives near it"
    assert answers.consents(USBL) is None
    assert answers.overrides == {
        WIFI: Overriding("tested with the cable today", NAME),
        DHCP: Overriding("a guest", "B. Pilot"),
    }
    assert (answers.leave, answers.sign_by) == ({}, NAME)


def test_answers_are_written_into_a_book(desk: Desk, tmp_path: Path) -> None:
    answers = _read(tmp_path, WHOLE)
    heard: list[Item] = []
    with desk.open() as book:
        book.settle(found(WIFI))
        book.settle(found(DHCP, Verdict.FAIL))
        spare = answers.write_down(book, heard.append)
        assert book.item(DHCP).counts is Verdict.WARN
        assert [item.id for item in open_items(book)] == [PING]
        assert len(book.files) == 1
    assert spare == ("`sparus/wifi` is PASS: the override is not needed",)
    assert [item.id for item in heard] == [FAILSAFE, USBL, DHCP]


def test_consent_to_all_covers_only_unanswered_items(tmp_path: Path) -> None:
    assert _read(tmp_path, "name: A\nconsents: {all: in the water}").consent_by_item == {PING: "A: in the water"}
    skipped = "name: A\nconsents: {all: in the water}\nanswers: {sparus/usbl/ping: {verdict: SKIP, note: a diver}}"
    assert _read(tmp_path, skipped).consent_by_item == {}
    assert _read(tmp_path, "name: A\nconsents: {all: wet}\nleave: {sparus/usbl/ping: a diver}").consent_by_item == {}


def test_answers_for_a_whole_site_also_fit_one_vehicle(tmp_path: Path) -> None:
    answers = _read(tmp_path, WHOLE, (WIFI, PING), beyond=(FAILSAFE, USBL, DHCP))
    assert (set(answers.confirmations), set(answers.overrides), set(answers.consent_by_item)) == (set(), {WIFI}, {PING})
    with pytest.raises(AnswersInvalid, match="this checklist has no item `eca-rov/usbl`"):
        _read(tmp_path, WHOLE, (WIFI, PING), beyond=(FAILSAFE, DHCP))


ALWAYS = ("coastal/site/vpn", "coastal/site/dds")


@pytest.mark.parametrize("item", ALWAYS)
def test_item_that_applies_at_every_site_cannot_be_skipped(tmp_path: Path, item: str) -> None:
    skipped = f"name: A\nanswers:\n  {item}: {{verdict: SKIP, note: no time}}\n"
    with pytest.raises(AnswersInvalid) as told:
        _read(tmp_path, skipped, ALWAYS)
    assert str(told.value).replace(str(tmp_path), "") == (
        f"/answers.yml:3:{len(item) + 15}: `{item}` applies at every site: it cannot be skipped\n  -> answer what "
        "was observed, or INCONCLUSIVE (`unclear`) and override it with a reason\n1 error in the answers; "
        "nothing was changed"
    )


def test_site_item_is_not_green_until_confirmed_or_overridden(desk: Desk, tmp_path: Path) -> None:
    answers = _read(
        tmp_path,
        "name: A\nanswers:\n  coastal/site/vpn: {verdict: PASS}\n"
        "  coastal/site/dds: {verdict: INCONCLUSIVE, note: nobody is there}\n"
        "overrides:\n  coastal/site/dds: {reason: no robot talks ROS today}\n",
        ALWAYS,
    )
    with desk.open(ALWAYS) as book:
        assert book.document().exit is ExitCode.CHECKS_FAILED
        for item in ALWAYS:
            with pytest.raises(ChecklistUsageError, match="applies at every site"):
                book.confirm(item, Confirmation(Verdict.SKIP, NAME, "no time"))
        answers.write_down(book)
        assert book.document().exit is ExitCode.DONE
        assert book.item(ALWAYS[1]).counts is Verdict.WARN


def test_missing_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"the answers file cannot be read: .*: No such file or directory") as error:
        Answers.read(tmp_path / "answers.yml", checklist())
    assert (error.value.exit, bool(error.value.hint)) == (ExitCode.USAGE, True)


def test_oversized_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "answers.yml").write_bytes(b"#" * 1_000_001)
    with pytest.raises(UsageError, match="is larger than 1 MB"):
        Answers.read(tmp_path / "answers.yml", checklist())
