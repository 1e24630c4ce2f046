"""The table of assumptions, the code that rests on it, the page about it, and the facts that it was drawn from."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import pytest

from atlantis_netcfg.emulator.routeros import Deviation
from atlantis_netcfg.routeros.assumptions import ASSUMPTIONS, READS, SILENCE, TRY, unconfirmed
from atlantis_netcfg.routeros.verify import CHECKS, TRIES

CHECKOUT = Path(__file__).parents[3]
PACKAGE = CHECKOUT / "atlantis_netcfg"
FOLDERS = ("routeros", "emulator/routeros", "rsc", "bootstrap", "console")
FACTS = CHECKOUT.parent / "shared" / "facts" / "routeros.md"
IDS = [each.id for each in ASSUMPTIONS]
NAMED = re.compile(r"Assumption: ([a-z0-9-]+)")
NOTHING_RESTS = {
    "Certus at 176 kbit/s": "of the satellite, not of RouterOS",
    "hold-down >= 90 s": "of the satellite, not of RouterOS",
    "A 56-byte ping every 10 s": "of the satellite, not of RouterOS",
    "explicit ADH cipher list": "a device without a certificate is refused",
    "Nagle can add an RTT": "of this computer: a flight is one write",
    "Answers [I]:": "how the planner works, nothing of the device",
    "DFS channels fall silent on radar": "of the air, not of RouterOS",
    "Guard [I]: prove a session": "a rule for the guard, nothing of the device",
}


def sources() -> dict[str, str]:
    found = {}
    for folder in FOLDERS:
        for file in sorted((PACKAGE / folder).rglob("*.py")):
            name = file.relative_to(PACKAGE).as_posix()
            if name != "routeros/assumptions.py":
                found[name] = file.read_text(encoding="utf-8")
    return found


def test_the_table_says_everything_once() -> None:
    assert [name for name, number in Counter(IDS).items() if number > 1] == []
    for each in ASSUMPTIONS:
        assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)+", each.id)
        assert each.sentence.endswith(".")
        assert each.rests.endswith(".")
        assert each.shown in {READS, TRY, SILENCE} or each.shown.startswith("needs a person: ")
    assert str(len(ASSUMPTIONS)) in unconfirmed()


def test_the_code_names_every_row_and_no_other() -> None:
    named = {name for text in sources().values() for name in NAMED.findall(text)}
    assert sorted(named - set(IDS)) == [], "these stand in no row of routeros/assumptions.py"
    assert sorted(set(IDS) - named) == [], "nothing names these: take them out, or write where they are assumed"


def test_no_inference_is_left_beside_the_table() -> None:
    words = re.compile(r"infer(?:red|ence)|not documented|undocumented", re.IGNORECASE)
    assert [name for name, text in sources().items() if words.search(text)] == []


def test_whatever_a_device_can_show_is_shown() -> None:
    of_the_session = {"api-flight-100", "tls-version"}
    assert {each.id for each in ASSUMPTIONS if each.shown == READS} == {*CHECKS, *of_the_session}
    assert {each.id for each in ASSUMPTIONS if each.shown == TRY} == set(TRIES)
    assert [each.id for each in ASSUMPTIONS if each.shown == SILENCE] == ["api-silent-session"]
    assert {deviation.value for deviation in Deviation} <= set(IDS)


def test_the_page_has_the_table() -> None:
    page = (CHECKOUT / "docs" / "verify.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| `")]
    assert rows == [f"| `{each.id}` | {each.sentence} | {each.rests} | {each.shown} |" for each in ASSUMPTIONS]


@pytest.mark.skipif(not FACTS.exists(), reason="no facts about RouterOS in ../shared/facts")
def test_every_unconfirmed_fact_has_its_row() -> None:
    flat = " ".join(FACTS.read_text(encoding="utf-8").split())
    meant = {words: each.id for each in ASSUMPTIONS for words in each.facts} | NOTHING_RESTS
    assert [words for words in meant if words not in flat] == []
    facts, questions = flat.split("## 16. Open questions only a device can answer ")
    questions = questions.split(" ## 17.")[0]
    marks = [found for found in re.finditer(r"\[[IU]\]", facts) if not facts[found.end() :].startswith("** inferred")]
    assert len(marks) > 10
    around = [facts[max(0, found.start() - 260) : found.end() + 60] for found in marks]
    around += re.split(r" (?=(?:10|[1-9])\. )", questions)
    assert [text for text in around if not any(words in text for words in meant)] == []
