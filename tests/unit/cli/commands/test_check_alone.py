"""A checklist without a person: everything that needs none is looked at together, and a file speaks for the people."""

from collections.abc import Callable
from pathlib import Path

import pytest
from check_desk import LAMP, PING, RADIO, Sitting, checklist

from atlantis_netcfg.checklist import Answers, PlanEntry
from atlantis_netcfg.checklist.report import Item
from atlantis_netcfg.cli.checklist.workflow import Price
from atlantis_netcfg.links.cost import CostRefusal

WELL = "PASS hears the boat"
ANSWERS = """\
name: A. Technician
consents: {sparus/usbl/ping: nobody dives}
answers: {sparus/gps: {verdict: PASS}}
overrides: {sparus/wifi: {reason: it is spare}}
"""


def answers(folder: Path) -> Answers:
    file = folder / "answers.yml"
    file.write_text(ANSWERS)
    return Answers.read(file, checklist(RADIO, LAMP, PING))


def test_all_probes_run_together_then_answers_are_used(tmp_path: Path) -> None:
    sitting = Sitting(tmp_path, [], words={"sparus/wifi": ["FAIL silent"], "sparus/usbl/ping": ["PASS answers"]})
    with sitting.book() as book:
        assert sitting.turn(book).alone(answers(tmp_path)) == ()
        radio, lamp, ping = book.items
    assert len(sitting.ears.asked) == 1
    assert [(str(one.verdict), str(one.counts)) for one in (radio, lamp, ping)] == [
        ("FAIL", "WARN"),
        ("PASS", "PASS"),
        ("PASS", "PASS"),
    ]
    (word,) = ping.evidence
    assert (word.what, word.value, word.by) == (
        "consent",
        "Sparus is in the water, and nobody dives near it (nobody dives)",
        "A. Technician",
    )
    assert word.at is not None


def test_unneeded_override_is_reported(tmp_path: Path) -> None:
    sitting = Sitting(tmp_path, [], words={"sparus/wifi": [WELL], "sparus/usbl/ping": ["PASS answers"]})
    with sitting.book() as book:
        assert sitting.turn(book).alone(answers(tmp_path)) == ("`sparus/wifi` is PASS: the override is not needed",)


def test_green_item_is_checked_again(tmp_path: Path) -> None:
    sitting = Sitting(tmp_path, [], words={"sparus/wifi": [WELL, "FAIL silent"]})
    for verdict in ("PASS", "FAIL"):
        with sitting.book() as book:
            sitting.turn(book).alone(None)
            radio, lamp, ping = book.items
        assert (str(radio.verdict), lamp.open, ping.open) == (verdict, True, True)


def test_overridden_item_is_kept(tmp_path: Path) -> None:
    sitting = Sitting(tmp_path, [], words={"sparus/wifi": ["FAIL silent"]})
    with sitting.book() as book:
        sitting.turn(book).alone(None)
        book.override("sparus/wifi", "it is spare", "N")
        sitting.turn(book).alone(None)
        assert book.item("sparus/wifi").override is not None


def _due(_entry: PlanEntry) -> Price:
    return Price("over satellite: 20 kB, about 0.16 EUR", due=True)


def _capped(_entry: PlanEntry) -> Price:
    raise CostRefusal("more than the cap")


@pytest.mark.parametrize("price", [_due, _capped])
def test_answers_file_accepts_no_cost(price: Callable[[PlanEntry], Price], tmp_path: Path) -> None:
    sitting = Sitting(tmp_path, [], words={"sparus/wifi": [WELL]}, price=price)
    with sitting.book() as book:
        sitting.turn(book).alone(answers(tmp_path))
        assert book.item("sparus/usbl/ping").open
    assert sitting.ears.asked == [["sparus/wifi"]]


def test_result_is_stored_before_the_next_is_shown(tmp_path: Path) -> None:
    sitting = Sitting(tmp_path, [], words={"sparus/wifi": [WELL]})
    seen: list[tuple[str, bool]] = []

    with sitting.book() as book:
        turn = sitting.turn(book)

        def told(item: Item) -> None:
            records = (book.folder / "records.jsonl").read_text()
            seen.append((item.id, "hears the boat" in records))

        turn.show = told
        turn.alone(None)
    assert seen == [("sparus/wifi", True)]
