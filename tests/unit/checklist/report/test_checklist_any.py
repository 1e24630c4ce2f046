"""Whatever a document holds, every page can be made of it, hides no item, and does no harm."""

import re
import sys
import unicodedata
import xml.etree.ElementTree as ET

import checklist_example as made
import pytest
from checklist_html import holds, parsed, safe, shown, written
from checklist_strategies import HOSTILE, documents, hostile
from hypothesis import HealthCheck, given, settings

from atlantis_netcfg.checklist.report import Document, ItemFinding, lines
from atlantis_netcfg.checklist.report._junit import junit
from atlantis_netcfg.checklist.report._pages import html
from atlantis_netcfg.checklist.report._shapes import grid
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.printable import visible

CONTROLS = frozenset({"Cc", "Cf", "Zl", "Zp"})


def harmless(document: Document) -> None:
    """On a console: nothing reaches the terminal, and nothing is wider than it."""
    told = lines(document)
    assert visible(told) == told
    words = "".join(told.split())
    assert all("".join(visible(item.id).split()) in words for item in document.items)
    table = grid(document)
    if len(table.columns) + len(table.beside) <= 9:  # Table 3, Ethernet and the site
        assert all(len(line) <= 80 for line in told.splitlines() if line.isascii())


def whole(document: Document) -> None:
    """In Jenkins: what is not green there, and nothing else, is not green here."""
    root = ET.fromstring(junit(document))  # noqa: S314 - ours
    green = root.get("failures") == root.get("errors") == "0"
    assert green == (document.exit is ExitCode.DONE)
    told = "".join("".join([*case.itertext(), case.get("name", "")]) for case in root.iter("testcase"))
    words = "".join(told.split())
    assert all(written(item.id) in words and written(item.message) in words for item in document.items)


@given(documents())
@settings(max_examples=30, suppress_health_check=[HealthCheck.too_slow])
def test_any_document_is_rendered_safely(document: Document) -> None:
    harmless(document)
    whole(document)
    page = parsed(html(document, made.files()))
    safe(page)
    holds(page, document)


def test_trailing_carriage_return_is_shown_in_jenkins() -> None:
    found = ItemFinding(verdict=Verdict.PASS, code="code", message="the next line")
    whole(made.example(items=(made.item("coastal/site/clock", Verdict.PASS, "at the end\r", findings=(found,)),)))


def test_hostile_text_is_harmless_on_a_console() -> None:
    harmless(hostile())


def test_hostile_text_is_valid_in_jenkins() -> None:
    whole(hostile())


def test_hostile_text_stays_text_in_the_page() -> None:
    document = hostile()
    page = parsed(html(document, {}))
    safe(page)
    holds(page, document)
    words = "".join(page.text.split())
    assert [one for one in HOSTILE if shown(one) not in words] == []


SEEN = re.compile("[\u0600-\u0605\u06dd\u070f\u0890\u0891\u08e2\U000110bd\U000110cd\U00013430-\U0001345f]")
"""Signs of scripts that Unicode counts among its controls: numbers' strokes, and what joins hieroglyphs."""
JOINING = {"\u200c", "\u200d"}


def test_no_control_character_reaches_a_report() -> None:
    """A line feed is the layout's; what joins letters or pictures hides none."""
    every = "".join(one for one in map(chr, range(sys.maxunicode + 1)) if unicodedata.category(one) in CONTROLS)
    document = hostile((f"before{every}after", "\n\tbefore\r\n"))
    for page in (html(document, {}).decode(), junit(document).decode(), lines(document)):
        assert "before" in page
        rest = {one for one in page if unicodedata.category(one) in CONTROLS} - JOINING - {"\n"}
        assert [ascii(one) for one in sorted(rest) if not SEEN.match(one)] == []


@pytest.mark.parametrize("document", [made.example(), made.green(), made.empty()], ids=["example", "green", "empty"])
def test_examples_are_rendered_safely(document: Document) -> None:
    harmless(document)
    whole(document)
    page = parsed(html(document, made.files()))
    safe(page)
    holds(page, document)
