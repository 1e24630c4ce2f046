"""What a person at the desk of a checklist is asked, word by word, and what becomes of the answers."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from check_desk import LAMP, PING, RADIO, Sitting, entry
from PIL import Image

from atlantis_netcfg.checklist import PlanEntry
from atlantis_netcfg.checklist.probes.base import EvidenceRequest
from atlantis_netcfg.checklist.report import ItemKind, Phase
from atlantis_netcfg.cli.checklist.workflow import Price, Prompt, PromptAbort, doubt_of_name
from atlantis_netcfg.core import language
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.inventory.model import EvidenceKind
from atlantis_netcfg.links.cost import CostRefusal

WELL = "PASS hears the boat"


def verdicts(sitting: Sitting) -> dict[str, str]:
    return {item.id: "open" if item.open else str(item.counts) for item in sitting.sit()}


def test_whole_checklist_with_a_person(tmp_path: Path) -> None:
    photo = tmp_path / "lamp.jpg"
    photo.write_bytes(b"a lamp")
    sitting = Sitting(
        tmp_path,
        ["yes", "green for a minute", "A. Technician", str(photo), "", "yes"],
        words={"sparus/wifi": [WELL], "sparus/usbl/ping": ["PASS answers"]},
    )
    assert verdicts(sitting) == {"sparus/wifi": "PASS", "sparus/gps": "PASS", "sparus/usbl/ping": "PASS"}
    assert sitting.text == WHOLE.replace("PHOTO", str(photo)).replace("EMPTY", " ")
    with sitting.book() as book:
        (_, lamp, ping) = book.items
        assert [(one.type, one.by) for one in lamp.evidence] == [
            ("confirmed", "A. Technician"),
            ("file", "A. Technician"),
        ]
        assert [(one.what, one.value, one.by) for one in ping.evidence] == [
            ("consent", "Sparus is in the water, and nobody dives near it", "A. Technician")
        ]


def test_active_step_is_not_offered_after_a_failure(tmp_path: Path) -> None:
    modem = entry("sparus/usbl", ItemKind.AUTOMATIC, Phase.WATER)
    sitting = Sitting(tmp_path, ["on", "open"], (modem, PING), {"sparus/usbl": ["FAIL is armed"]})
    assert verdicts(sitting) == {"sparus/usbl": "FAIL", "sparus/usbl/ping": "open"}
    assert "not now: is armed (sparus/usbl)" in sitting.text
    assert "nobody dives near it" not in sitting.text
    assert sitting.ears.asked == [["sparus/usbl"]]


WHOLE = """

BENCH
  PASS         sparus/wifi: hears the boat

QUAY

sparus/gps: title of sparus/gps
  do        look at the lamp
  look for  it is green
(item 2 of 3) Is it so? [yes, but, no, unclear, skip, back, later] yes
(item 2 of 3) Note (may be empty): green for a minute
(item 2 of 3) Your name, as it should appear in the report: A. Technician
(item 2 of 3) Photo or file as evidence (a path; empty: none or no more): PHOTO
(item 2 of 3) Photo or file as evidence (a path; empty: none or no more):EMPTY
  PASS         sparus/gps: A. Technician has seen that it is in order: green for
               a minute

IN WATER

sparus/usbl/ping: title of sparus/usbl/ping
  This step needs your consent: Sparus is in the water, and nobody dives near
  it.
(item 3 of 3) Is that so, and do you want to start it now?
  Type yes (the whole word) to continue, or no: yes
  Now: hold the boat still.
  PASS         sparus/usbl/ping: answers"""[1:]


@pytest.mark.parametrize(
    ("word", "verdict", "question"),
    [
        ("but", "WARN", "Confirmed, but:"),
        ("no", "FAIL", "What was seen instead:"),
        ("unclear", "INCONCLUSIVE", "Why it cannot be determined:"),
        ("skip", "SKIP", "Why it does not apply here:"),
    ],
)
def test_answers_other_than_yes_need_a_note(word: str, verdict: str, question: str, tmp_path: Path) -> None:
    more = ["on"] if verdict in {"FAIL", "INCONCLUSIVE"} else []
    sure = ["y"] if verdict == "FAIL" else []
    sitting = Sitting(tmp_path, [word, *sure, "", "it is dark", "N", "", *more], entries=(LAMP,))
    assert verdicts(sitting) == {"sparus/gps": verdict}
    asked = f"(item 1 of 1) {question}"
    assert f"{asked} \n  an entry is required; `later` leaves the item open\n{asked} it is dark" in sitting.text


def test_required_photo_is_requested_until_given(tmp_path: Path) -> None:
    """Nothing that the question offers is refused afterwards, and no answer is asked for twice."""
    notes, photo = tmp_path / "notes.txt", tmp_path / "lamp.png"
    notes.write_text("it is green", encoding="utf-8")
    Image.new("RGB", (2, 2)).save(photo)
    step = replace(LAMP.step, evidence=EvidenceRequest(EvidenceKind.PHOTO))
    typed = ["yes", "", "N", "", str(notes), str(tmp_path / "absent.png"), str(photo), ""]
    sitting = Sitting(tmp_path, typed, (replace(LAMP, step=step),))
    assert verdicts(sitting) == {"sparus/gps": "PASS"}
    assert sitting.text.count("Is it so?") == 1
    assert sitting.text.count("Photo as evidence (path of a JPEG or PNG):") == 4
    assert "empty: none" not in sitting.text
    refused = "a photo is required: give the path of a JPEG or PNG; `later` leaves the item open"
    assert " ".join(sitting.text.split()).count(refused) == 3


def test_required_photo_is_not_requested_for_a_failure(tmp_path: Path) -> None:
    step = replace(LAMP.step, evidence=EvidenceRequest(EvidenceKind.PHOTO))
    sitting = Sitting(tmp_path, ["unclear", "it is dark", "N", "", "on"], (replace(LAMP, step=step),))
    assert verdicts(sitting) == {"sparus/gps": "INCONCLUSIVE"}
    assert "a JPEG or PNG" not in sitting.text


@pytest.mark.parametrize("kept", range(5))
def test_later_at_any_prompt_leaves_the_rest_open(kept: int, tmp_path: Path) -> None:
    typed = ["yes", "", "N", "", "yes"]
    words = {"sparus/wifi": [WELL], "sparus/usbl/ping": ["PASS answers"]}
    sitting = Sitting(tmp_path, [*typed[:kept], "later"], words=words)
    with pytest.raises(PromptAbort):
        sitting.sit()
    with sitting.book() as book:
        assert [item.open for item in book.items] == [False, kept < 4, True]
    again = Sitting(tmp_path, typed if kept < 4 else ["yes", "N"], words=words)
    assert verdicts(again) == {"sparus/wifi": "PASS", "sparus/gps": "PASS", "sparus/usbl/ping": "PASS"}
    assert again.ears.asked == [["sparus/usbl/ping"]], "what was found before is not asked again"


def test_failed_item_can_be_repeated(tmp_path: Path) -> None:
    sitting = Sitting(tmp_path, ["again", "ag"], (RADIO,), {"sparus/wifi": ["FAIL silent", "ERROR odd", WELL]})
    assert verdicts(sitting) == {"sparus/wifi": "PASS"}
    assert sitting.text.count("hint of silent") == 2


def test_failed_item_can_be_overridden_with_a_reason(tmp_path: Path) -> None:
    typed = ["override", "", "it is spare", "N"]
    sitting = Sitting(tmp_path, typed, (RADIO,), {"sparus/wifi": ["FAIL silent"]})
    (item,) = sitting.sit()
    assert item.verdict is Verdict.FAIL
    assert item.override is not None
    assert (item.override.reason, item.override.by) == ("it is spare", "N")


def test_earlier_failure_is_offered_again(tmp_path: Path) -> None:
    Sitting(tmp_path, ["on"], (RADIO,), {"sparus/wifi": ["FAIL silent"]}).sit()
    sitting = Sitting(tmp_path, ["again"], (RADIO,), {"sparus/wifi": [WELL]})
    assert verdicts(sitting) == {"sparus/wifi": "PASS"}


@pytest.mark.parametrize(
    ("typed", "verdict"),
    [
        (["no", "open"], "open"),
        (["y", "No", "open"], "open"),
        (["y", "ye", "", "open"], "open"),
        (["", "n", "override", "it was pinged yesterday", "N"], "WARN"),
        (["no", "seen", "yes", "by the diver", "N", ""], "PASS"),
    ],
)
def test_nothing_is_sent_without_the_whole_word(typed: list[str], verdict: str, tmp_path: Path) -> None:
    sitting = Sitting(tmp_path, typed, (PING,))
    (item,) = sitting.sit()
    assert ("open" if item.open and item.override is None else str(item.counts)) == verdict
    assert sitting.ears.asked == []


SHIP = entry("sparus/acoustic", ItemKind.AUTOMATIC, Phase.WATER)


@pytest.mark.parametrize(("typed", "asked"), [("yes", 2), ("skip", 1)])
def test_next_phase_waits_for_confirmation(typed: str, asked: int, tmp_path: Path) -> None:
    words = {"sparus/wifi": [WELL], "sparus/acoustic": [WELL]}
    sitting = Sitting(tmp_path, [typed], (RADIO, SHIP), words)
    assert [item.open for item in sitting.sit()] == [False, asked == 1]
    assert "Is everything in the water and switched on? [yes, skip, back, later] " in sitting.text
    assert len(sitting.ears.asked) == asked


def test_rehearsal_checks_all_phases_together(tmp_path: Path) -> None:
    sitting = Sitting(tmp_path, [], (RADIO, SHIP), {"sparus/wifi": [WELL], "sparus/acoustic": [WELL]}, at_once=True)
    assert [item.open for item in sitting.sit()] == [False, False]
    assert len(sitting.ears.asked) == 1


def test_cost_needs_separate_consent(tmp_path: Path) -> None:
    price = Price("over satellite: 20 kB, about 0.16 EUR", due=True)
    sitting = Sitting(tmp_path, ["yes", "yes", "no", "open"], (PING,), price=lambda _entry: price)
    assert [item.open for item in sitting.sit()] == [True]
    asked = "(item 1 of 1) Accept the cost? Type pay (the whole word) to continue, or no: "
    assert f"  Traffic: over satellite: 20 kB, about 0.16 EUR\n{asked}yes" in sitting.text
    words = {"sparus/usbl/ping": ["PASS answers"]}
    paid = Sitting(tmp_path, ["yes", "pay", "N"], (PING,), words, price=lambda _entry: price)
    assert verdicts(paid) == {"sparus/usbl/ping": "PASS"}


def test_step_above_the_cost_cap_is_not_offered(tmp_path: Path) -> None:
    def refuse(_entry: PlanEntry) -> Price:
        raise CostRefusal("more than the cap", hint="raise it")

    sitting = Sitting(tmp_path, ["open"], (PING,), price=refuse)
    assert [item.open for item in sitting.sit()] == [True]
    assert "  more than the cap\n  raise it" in sitting.text


def test_missing_or_empty_file_is_requested_again(tmp_path: Path) -> None:
    (tmp_path / "empty.jpg").touch()
    typed = ["yes", "", "N", "nowhere.jpg", str(tmp_path / "empty.jpg"), "", "yes", "", ""]
    sitting = Sitting(tmp_path, typed, (LAMP,))
    assert verdicts(sitting) == {"sparus/gps": "PASS"}
    assert "  no such file: nowhere.jpg" in sitting.text
    assert "empty.jpg` is empty: use a file that is not empty" in sitting.words_said


def test_choices_match_by_prefix_and_suggest_corrections() -> None:
    typed = iter(["x", "overide", "unlcear", "u"])
    said: list[str] = []
    desk = Prompt(lambda _question: next(typed), said.append)
    assert desk.choose("?", {"yes": 1, "unclear": 2, "override": 3}) == 2
    assert said == [
        "  type one of: yes, unclear, override, back, later",
        "  type one of: yes, unclear, override, back, later (`override`?)",
        "  type one of: yes, unclear, override, back, later (`unclear`?)",
    ]


def test_name_is_requested_until_valid_and_then_remembered(tmp_path: Path) -> None:
    sitting = Sitting(tmp_path, ["yes", "", "N" * 101, "a\x1b[2J", "N", ""], (LAMP,))
    assert verdicts(sitting) == {"sparus/gps": "PASS"}
    assert sitting.text.count("  a name is too long, or contains control characters: ") == 2
    assert sitting.desk.name == "N"


def test_end_of_input_means_later() -> None:
    def ended(_question: str) -> str:
        raise EOFError

    with pytest.raises(PromptAbort):
        Prompt(ended).ask("Anybody?")


def test_output_cannot_move_the_cursor() -> None:
    said: list[str] = []
    Prompt(say=said.append).say("one\x1b[2Jtwo\nthree")
    assert said == ["one\\u001b[2Jtwo\nthree"]


def records(sitting: Sitting) -> list[tuple[str, str, bool]]:
    """What the log has, in its order: how, verdict, whether it was overridden."""
    (log,) = sitting.folder.rglob("records.jsonl")
    rows = [json.loads(line) for line in log.read_text().splitlines()]
    found = [row for row in rows if "item" in row]
    return [(row["record"], row["item"]["verdict"], row["item"]["override"] is not None) for row in found]


def test_back_corrects_an_answer_and_both_are_kept(tmp_path: Path) -> None:
    typed = ["yes", "green", "N", "", "back", "again", "unclear", "fog", "", "on", "yes"]
    words = {"sparus/wifi": [WELL], "sparus/usbl/ping": ["PASS answers"]}
    sitting = Sitting(tmp_path, typed, words=words)
    assert verdicts(sitting) == {"sparus/wifi": "PASS", "sparus/gps": "INCONCLUSIVE", "sparus/usbl/ping": "PASS"}
    assert records(sitting) == [
        ("settled", "PASS", False),
        ("confirmed", "PASS", False),
        ("confirmed", "INCONCLUSIVE", False),
        ("settled", "PASS", False),
    ]
    with sitting.book() as book:
        evidence = book.item("sparus/gps").evidence
    assert [(each.what, each.value, each.by) for each in evidence] == [
        ("title of sparus/gps", "fog", "N"),
        ("earlier answer, replaced", "PASS: green", "N"),
    ]


def test_back_within_an_item_restarts_it(tmp_path: Path) -> None:
    sitting = Sitting(tmp_path, ["but", "back", "yes", "", "N", ""], (LAMP,))
    assert verdicts(sitting) == {"sparus/gps": "PASS"}
    assert len(records(sitting)) == 1
    assert sitting.text.count("Is it so?") == 2


def test_back_at_the_first_prompt_is_explained(tmp_path: Path) -> None:
    sitting = Sitting(tmp_path, ["back", "yes", "", "N", ""], (LAMP,))
    assert verdicts(sitting) == {"sparus/gps": "PASS"}
    assert "  this is the first question" in sitting.text


def test_back_removes_an_override_and_shows_it(tmp_path: Path) -> None:
    typed = ["override", "it is spare", "N", "back", "again", "yes", "", ""]
    sitting = Sitting(tmp_path, typed, (RADIO, LAMP), {"sparus/wifi": ["FAIL silent", WELL]})
    assert verdicts(sitting) == {"sparus/wifi": "PASS", "sparus/gps": "PASS"}
    with sitting.book() as book:
        (evidence,) = book.item("sparus/wifi").evidence
    assert (evidence.what, evidence.value, evidence.by) == ("earlier override, replaced", "FAIL: it is spare", "N")


def test_back_between_phases_returns_to_the_previous_item(tmp_path: Path) -> None:
    typed = ["yes", "", "N", "", "back", "on", "yes"]
    sitting = Sitting(tmp_path, typed, (LAMP, SHIP), {"sparus/acoustic": [WELL]})
    assert verdicts(sitting) == {"sparus/gps": "PASS", "sparus/acoustic": "PASS"}
    assert records(sitting) == [("confirmed", "PASS", False), ("settled", "PASS", False)]


@pytest.mark.parametrize("slip", ["n", "no"])
def test_no_must_be_confirmed(slip: str, tmp_path: Path) -> None:
    sitting = Sitting(tmp_path, ["no", slip, "yes", "", "N", ""], (LAMP,))
    assert verdicts(sitting) == {"sparus/gps": "PASS"}
    assert "(item 1 of 1) You answered no: FAIL will be recorded. Is that right? [yes, no]" in sitting.text
    assert records(sitting) == [("confirmed", "PASS", False)]


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("photos/lamp.jpg", "a file"),
        ("lamp.JPG", "a file"),
        ("--rehearse", "an option"),
        ("site=coastal", "an argument"),
        ("Yes", "an answer to another question"),
    ],
)
def test_doubtful_name_must_be_confirmed(name: str, what: str, tmp_path: Path) -> None:
    sitting = Sitting(tmp_path, ["yes", "", name, "no", "N", ""], (LAMP,))
    assert verdicts(sitting) == {"sparus/gps": "PASS"}
    assert f"`{name}` looks like {what}. Is it your name? [yes, no]" in sitting.words_said
    assert sitting.desk.name == "N"
    taken = Sitting(tmp_path / "taken", ["yes", "", name, "y", ""], (LAMP,))
    taken.sit()
    assert taken.desk.name == name


@pytest.mark.parametrize("name", ["A. Technician", "João d'Ávila", "M. Silva-Pinto", "N"])
def test_plausible_names_are_accepted(name: str) -> None:
    assert doubt_of_name(name) is None


def test_long_choices_are_shown_below_the_prompt(tmp_path: Path) -> None:
    sitting = Sitting(tmp_path, ["on"], (RADIO,), {"sparus/wifi": ["FAIL silent"]})
    sitting.sit()
    asked = (
        "(item 1 of 1) Check again (`again`), override it (`override`), or continue\n  (`on`)?\n"
        "  [again, override, on, back, later] on"
    )
    assert asked in sitting.text
    assert max(map(len, sitting.text.splitlines())) <= 80


def test_both_languages_are_accepted_in_portuguese(tmp_path: Path) -> None:
    language.use(language.Language.PORTUGUESE)
    try:
        sitting = Sitting(tmp_path, ["não", "s", "escuro", "N", "", "repetir", "sim", "", "", "Sim"], (LAMP, PING))
        sitting.words = {"sparus/usbl/ping": ["PASS answers"]}
        sitting.ears.words = sitting.words
        assert verdicts(sitting) == {"sparus/gps": "PASS", "sparus/usbl/ping": "PASS"}
    finally:
        language.use(language.Language.ENGLISH)
    assert "[sim, mas, não, incerto, saltar, voltar, depois]" in sitting.text
    assert records(sitting)[0] == ("confirmed", "FAIL", False), "what is kept is the same in every language"
