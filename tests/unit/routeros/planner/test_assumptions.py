"""The table of assumptions, the code that rests on it, the page about it, and the facts that it was drawn from."""

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from pydantic import BaseModel

from atlantis_netcfg.emulator.routeros import Deviation
from atlantis_netcfg.operations.lte import assumptions as rutos
from atlantis_netcfg.routeros.assumptions import ASSUMPTIONS, READS, SILENCE, TRY, summarize_assumptions
from atlantis_netcfg.routeros.verify import CHECKS, TRIES

CHECKOUT = Path(__file__).parents[4]
PACKAGE = CHECKOUT / "atlantis_netcfg"
FOLDERS = ("routeros", "emulator/routeros", "rsc", "bootstrap", "console")
FACTS = CHECKOUT.parent / "shared" / "facts" / "routeros.md"
IDS = [each.id for each in ASSUMPTIONS]
NAMED = re.compile(r"Assumption: ([a-z0-9-]+)")
MARK = re.compile(r" ?\[[IU]\]")
PAGE = CHECKOUT / "docs" / "engineers" / "assumptions.md"
COLUMNS = "| Assumption | Expected behaviour | What depends on it | How to test it |\n|---|---|---|---|\n"
QUESTIONS = "16"
"""The section of the facts whose every sentence is unconfirmed."""


class Fact(BaseModel, extra="forbid"):
    """A row of assumed-facts.yml."""

    section: str
    begins: str
    rows: tuple[str, ...] = ()
    unused: str = ""


def mapped() -> list[Fact]:
    text = (CHECKOUT / "tests" / "data" / "assumed-facts.yml").read_text(encoding="utf-8")
    return [Fact(**row) for row in yaml.safe_load(text)]


def sources() -> dict[str, str]:
    found = {}
    for folder in FOLDERS:
        for file in sorted((PACKAGE / folder).rglob("*.py")):
            name = file.relative_to(PACKAGE).as_posix()
            if name != "routeros/assumptions.py":
                found[name] = file.read_text(encoding="utf-8")
    for file in sorted(PACKAGE.rglob("*routeros*.py")):
        found[file.relative_to(PACKAGE).as_posix()] = file.read_text(encoding="utf-8")
    return found


def test_assumption_ids_are_unique_and_entries_well_formed() -> None:
    assert [name for name, number in Counter(IDS).items() if number > 1] == []
    for each in ASSUMPTIONS:
        assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)+", each.id)
        assert each.sentence.endswith(".")
        assert each.rests.endswith(".")
        assert each.proof in {READS, TRY, SILENCE} or each.proof.startswith("needs a person: ")
    assert str(len(ASSUMPTIONS)) in summarize_assumptions()


def test_code_references_every_assumption_and_no_other() -> None:
    named = {name for text in sources().values() for name in NAMED.findall(text)}
    assert sorted(named - set(IDS)) == [], "these stand in no row of routeros/assumptions.py"
    assert sorted(set(IDS) - named) == [], "nothing names these: take them out, or write where they are assumed"


def test_no_inference_is_mentioned_outside_the_table() -> None:
    words = re.compile(r"infer(?:red|ence)|not documented|undocumented", re.IGNORECASE)
    assert [name for name, text in sources().items() if words.search(text)] == []


def test_every_verifiable_assumption_has_a_check() -> None:
    of_the_session = {"api-flight-100", "tls-version"}
    assert {each.id for each in ASSUMPTIONS if each.proof == READS} == {*CHECKS, *of_the_session}
    assert {each.id for each in ASSUMPTIONS if each.proof == TRY} == set(TRIES)
    assert [each.id for each in ASSUMPTIONS if each.proof == SILENCE] == ["api-silent-session"]
    assert {deviation.value for deviation in Deviation} <= set(IDS)


def test_docs_page_contains_the_table() -> None:
    text = PAGE.read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line.startswith("| `")]
    table = (*ASSUMPTIONS, *rutos.ASSUMPTIONS)
    assert rows == [f"| `{each.id}` | {each.sentence} | {each.rests} | {each.proof} |" for each in table]
    assert text == page(), "generate it: .venv/bin/python -P tests/unit/routeros/planner/test_assumptions.py"


def page() -> str:
    """Return the page with the tables as the code has them; the text above the first table is written by hand."""
    parts = [PAGE.read_text(encoding="utf-8").partition("## ")[0]]
    for title, table in (("## RouterOS", ASSUMPTIONS), ("\n## RutOS", rutos.ASSUMPTIONS)):
        rows = (f"| `{each.id}` | {each.sentence} | {each.rests} | {each.proof} |\n" for each in table)
        parts.append(f"{title}\n\n{COLUMNS}{''.join(rows)}")
    return "".join(parts)


def test_fact_map_references_assumptions_or_a_reason() -> None:
    facts = mapped()
    assert [fact for fact in facts if bool(fact.rows) == bool(fact.unused)] == []
    assert sorted({name for fact in facts for name in fact.rows} - set(IDS)) == []
    assert [key for key, number in Counter((fact.section, fact.begins) for fact in facts).items() if number > 1] == []


def test_unconfirmed_sentences_are_detected_by_their_marks() -> None:
    text = """## 1. Numbers
* Sure [M]. A guess
  of two lines [I]; sure again. Unknown [U]: so.
### 1.1 All of it [I]
1. First. Second.
2. Third
```
code. [I]
```
## 16. Questions
3. One? Two;
   three.
## 17. Others
Nothing."""
    assert list(unconfirmed_sentences(text)) == [
        ("1", "A guess of two lines;"),
        ("1", "Unknown: so."),
        ("1.1", "1.1 All of it"),
        ("1.1", "First. Second."),
        ("1.1", "Third"),
        ("16", "One?"),
        ("16", "Two;"),
        ("16", "three."),
    ]


@pytest.mark.skipif(not FACTS.exists(), reason="no facts about RouterOS in ../shared/facts")
def test_every_unconfirmed_fact_is_in_the_map() -> None:
    facts = mapped()
    found = list(unconfirmed_sentences(FACTS.read_text(encoding="utf-8")))
    matches = [[fact for fact in facts if fact.section == at and text.startswith(fact.begins)] for at, text in found]
    assert [text for text, fitting in zip(found, matches, strict=True) if len(fitting) != 1] == []
    met = {(fact.section, fact.begins) for fitting in matches for fact in fitting}
    assert [fact for fact in facts if (fact.section, fact.begins) not in met] == []


def unconfirmed_sentences(text: str) -> Iterator[tuple[str, str]]:
    """Yield section and text of each: sentences with a mark or of the questions; where a mark stands for a whole
    section, at its heading or its first sentence, every paragraph and item of it."""
    whole = ""
    for section, block in _blocks(text):
        is_heading, plain = block.startswith("#"), re.sub(r"^(?:#+|\*|\d+\.) ", "", block)
        marked = MARK.search(plain) is not None
        for sentence in re.split(r"(?<=[.;?]) (?!\d)", plain):
            if MARK.search(sentence) or (section == QUESTIONS and not is_heading):
                yield section, MARK.sub("", sentence)
        if section == whole and not marked:
            yield section, plain
        if marked and (is_heading or "**Not run on a device** [I]" in plain):
            whole = section


def _blocks(text: str) -> Iterator[tuple[str, str]]:
    """Yield headings, items and paragraphs, each in one line, with the number of their section; code is left out."""
    section, lines, is_code = "", list[str](), False
    for line in [*text.splitlines(), ""]:
        fence, heading = line.startswith("```"), re.match(r"##+ (\d+(?:\.\d+)?)", line)
        if lines and (fence or heading or lines[0].startswith("#") or not line or re.match(r"\* |\d+\. ", line)):
            yield section, " ".join(lines)
            lines = []
        section = heading[1] if heading else section
        is_code ^= fence
        if line and section and not fence and not is_code:
            lines.append(line.strip())


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
