"""Every text of the pages passes the catalogue exactly once; what devices and people have said stays as it is."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import checklist_example as made
import pytest
from checklist_html import Element, parsed, safe
from checklist_marks import marked, rest_of, without_marks

from atlantis_netcfg.checklist._ledger import ChecklistLog, RecordedResult, read
from atlantis_netcfg.checklist.report import Document, Evidence, EvidenceType, lines
from atlantis_netcfg.checklist.report._junit import junit
from atlantis_netcfg.checklist.report._pages import html
from atlantis_netcfg.checklist.report._pdf import pdf
from atlantis_netcfg.checklist.report._pdf._sheet import _all_glyphs
from atlantis_netcfg.core import language
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import Message, arg, msg
from atlantis_netcfg.runs.report.signs import ShownState

SAID = "value `x` of a device"


def document(**changes: object) -> Document:
    """The example, in which a device has said something that looks like a message."""
    evidence = Evidence(type=EvidenceType.READ, what="name of the terminal", value=SAID)
    odd = made.item("zarco/gps", Verdict.WARN, "few satellites", hint="type `print`", evidence=(evidence,))
    items = tuple(odd if item.id == odd.id else item for item in made.items())
    return made.example(items=items, **changes)


CASES = {"example": document, "green": made.green, "empty": made.empty}


@pytest.fixture(autouse=True)
def marks(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    with marked(monkeypatch):
        yield


def visible_texts(element: Element) -> Iterator[str]:
    """Text and the attributes that people hear."""
    if element.tag == "style":
        return
    for name in ("alt", "aria-label"):
        if name in element.attributes:
            yield element.attributes[name]
    for child in element.children:
        if isinstance(child, str):
            yield child
        else:
            yield from visible_texts(child)


def values(shown: Document) -> str:
    """All that stands on a page and is no word of ours: names, addresses, times, keys, verdicts, words of people."""
    items = shown.items
    names = [
        *(item.id for item in items),
        *(finding.code for item in items for finding in item.findings),
        *(f"{evidence.value} {evidence.by} {evidence.file}" for item in items for evidence in item.evidence),
        *(f"{item.override.reason} {item.override.by}" for item in items if item.override is not None),
        *(f"{row.name} {' '.join(row.aliases)} {row.key}" for row in shown.rows),
        *(f"{node.label} {node.detail}" for node in shown.drawing.nodes),
        *(change.id for change in (shown.since_green.changes if shown.since_green is not None else ())),
        *map(str, ShownState),
        f"{shown.signed.digest} {shown.signed.key}" if shown.signed is not None else "",
        f"{shown.run} {shown.inventory} atlantis-netcfg {shown.tool} WEST UTC s",
    ]
    return " ".join(names)


@pytest.mark.parametrize("name", CASES)
def test_every_text_of_the_page_is_translated_once(name: str) -> None:
    shown = CASES[name]()
    page = parsed(html(shown, made.files()))
    safe(page)
    assert rest_of(without_marks("\n".join(visible_texts(page.root))), values(shown)) == []


@pytest.mark.parametrize("name", CASES)
def test_every_text_of_the_console_is_translated_once(name: str) -> None:
    shown = CASES[name]()
    # The heads of the grid are cut to its columns, their marks as well; a long name is cut, and signs are letters.
    text = "\n".join(line for line in lines(shown).splitlines() if not line.startswith(f"{'':<14}«"))
    assert rest_of(without_marks(text), f"{values(shown)} ok test X o") == []


@pytest.mark.parametrize("name", CASES)
def test_every_text_of_the_pdf_is_translated_once(name: str) -> None:
    shown = CASES[name]()
    command = ["pdftotext", "-raw", "-", "-"]
    text = subprocess.run(command, input=pdf(shown, made.files()), check=True, capture_output=True).stdout.decode()
    assert rest_of(without_marks(text.replace("\f", " ")), f"{values(shown)} failsafe png") == []


def test_device_output_is_not_translated() -> None:
    page = parsed(html(document(), {}))
    assert f": {SAID}" in page.text
    assert f"«name of the terminal»: {SAID}" in " ".join(page.text.split())


def test_machine_readable_output_stays_english() -> None:
    assert "«" not in junit(document()).decode()
    assert "«" not in document().model_dump_json()


def test_page_states_language_and_unreviewed_translation() -> None:
    unread = "No native speaker has read this translation yet. What was signed is in English."
    english = html(document(), {}).decode()
    assert '<html lang="en">' in english
    assert unread not in english
    language.use(language.Language.PORTUGUESE)
    try:
        portuguese, paper = html(document(), {}).decode(), pdf(document(), {})
    finally:
        language.use(language.Language.ENGLISH)
    assert '<html lang="pt-PT">' in portuguese
    assert f"«{unread}»" in portuguese
    assert b"/Lang (pt-PT)" in paper


def test_the_fonts_have_portuguese_letters() -> None:
    letters = "áàâãçéêíóôõúüÁÀÂÃÇÉÊÍÓÔÕÚÜªº«»“”–—"  # noqa: RUF001 - quotes and dashes
    assert all(glyphs.issuperset(map(ord, letters)) for glyphs in _all_glyphs())


def test_missing_translation_would_be_detected() -> None:
    """Else the tests above would say nothing."""
    assert rest_of("«known» forgotten 12 PASS", "PASS") == ["forgotten"]
    with pytest.raises(AssertionError, match="twice"):
        without_marks("«a «b» c»")
    assert "atlantis_netcfg.checklist.report._pages" in sys.modules


def test_a_message_of_a_stored_checklist_keeps_its_values(tmp_path: Path) -> None:
    """The page and the summary of a checklist are shown in the language of their reader."""
    message = msg(f"{arg(3)} of {arg(4)} modems respond")
    settled = made.item("sparus/usbl", message=message)
    assert settled.message is message
    with ChecklistLog(tmp_path / "log") as log:
        log.write(RecordedResult(record="settled", item=settled))
    record = read(tmp_path / "log").records[0].record
    assert isinstance(record, RecordedResult)
    assert record.item == settled
    assert isinstance(record.item.message, Message)
    assert record.item.message.source == f"{arg(3)} of {arg(4)} modems respond"
