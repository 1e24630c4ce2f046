"""Items that the pilot declares, at a terminal: what is shown, what is asked for, and who may answer."""

from dataclasses import replace
from pathlib import Path

import pytest
from check_desk import LAMP, Sitting, entry, pilot

from atlantis_netcfg.checklist import PlanEntry, Scope, plan
from atlantis_netcfg.checklist.probes.base import EvidenceRequest
from atlantis_netcfg.checklist.report import ItemKind, Phase
from atlantis_netcfg.cli.checklist.workflow import PromptAbort
from atlantis_netcfg.core import language
from atlantis_netcfg.inventory.model import EvidenceKind

NUMBER = EvidenceRequest(EvidenceKind.NUMBER, "V", 14.8, 16.8)


def item(evidence: EvidenceRequest = NUMBER, by: tuple[str, ...] = (), name: str = "mares/items/battery") -> PlanEntry:
    made = entry(name, ItemKind.PERSON, Phase.BENCH)
    step = replace(made.step, do="", evidence=evidence, by=by)
    return replace(made, step=step)


def test_number_out_of_range_is_requested_again(tmp_path: Path) -> None:
    sitting = Sitting(
        tmp_path, ["yes", "13", "", "A. Technician", "", "yes", "sixteen", "16,1 V", "16,1", "", ""], (item(),)
    )
    (found,) = sitting.sit()
    assert (found.verdict, found.evidence[0].value, found.evidence[0].by) == ("PASS", "16.1 V", "A. Technician")
    assert "mares/items/battery: title of mares/items/battery\n  look for  it is green\n" in sitting.text
    assert "  give      a number in V, 14.8 to 16.8\n" in sitting.text
    assert "  do " not in sitting.text
    assert sitting.text.count("(item 1 of 1) The number, in V:") == 4
    assert "`mares/items/battery`: 13 V does not pass: required is a number in V, 14.8 to 16.8" in sitting.words_said
    assert "`16,1 V` is not a number: write it without its unit, like 16.1" in sitting.words_said


def test_failed_item_needs_no_number(tmp_path: Path) -> None:
    sitting = Sitting(tmp_path, ["no", "yes", "the display is dark", "A. Technician", "", "on"], (item(),))
    (found,) = sitting.sit()
    assert (found.verdict, found.evidence[0].value) == ("FAIL", "the display is dark")
    assert "The number" not in sitting.text


def test_required_text_and_photo_are_requested_until_given(tmp_path: Path) -> None:
    photo = tmp_path / "ring.png"
    photo.write_bytes(b"\x89PNG\r\n\x1a\nno more")
    serial, ring = item(EvidenceRequest(EvidenceKind.TEXT)), item(EvidenceRequest(EvidenceKind.PHOTO), name="a/items/b")
    typed = ["yes", "", "no 12", "A. Technician", "", "yes", "", "", "later"]
    sitting = Sitting(tmp_path, typed, (serial, ring))
    with pytest.raises(PromptAbort):
        sitting.sit()
    with sitting.book() as book:
        assert [(each.id, each.open) for each in book.items] == [("mares/items/battery", False), ("a/items/b", True)]
    assert "a photo is required: give the path of a JPEG or PNG" in sitting.words_said


def test_restricted_item_is_answered_by_an_authorised_person(tmp_path: Path) -> None:
    """Who sits at the terminal is asked once; an item of others asks which of them it is, and goes on as before."""
    typed = ["yes", "", "A. Technician", "A. Technician", "c. owner", "", "yes", "", ""]
    sitting = Sitting(tmp_path, typed, (LAMP, item(EvidenceRequest(), ("B. Pilot", "C. Owner"))))
    lamp, switch = sitting.sit()
    assert (switch.evidence[0].by, lamp.evidence[0].by) == ("c. owner", "A. Technician")
    assert "  answers   B. Pilot, C. Owner only\n" in sitting.text
    assert "A. Technician may not answer: the inventory names others" in sitting.words_said


def test_recovery_items_are_asked(tmp_path: Path) -> None:
    listed = plan(pilot(), "coastal", Scope(phases=(Phase.RECOVERY,)))
    sitting = Sitting(tmp_path, ["yes", "", "A. Technician", ""], listed.entries)
    (found,) = sitting.sit()
    assert (found.id, found.verdict) == ("mares/items/rinsed", "PASS")
    assert sitting.text.startswith("\nRECOVERY\n\nmares/items/rinsed: The vehicle was rinsed\n")


def test_custom_texts_are_not_translated(tmp_path: Path) -> None:
    """Even where the catalogue has the very words: they are the user's."""
    ours = replace(item(), item=item().item.model_copy(update={"title": "waits for a person"}))
    sitting = Sitting(tmp_path, ["sim", "16", "", "A. Technician", ""], (ours,))
    language.use(language.Language.PORTUGUESE)
    try:
        sitting.sit()
    finally:
        language.use(language.Language.ENGLISH)
    assert "mares/items/battery: waits for a person\n" in sitting.text
