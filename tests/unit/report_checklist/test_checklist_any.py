"""Whatever a document holds, every page can be made of it, hides no item, and does no harm."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import checklist_example as made
import pytest
from checklist_html import holds, parsed, safe, shown
from checklist_strategies import HOSTILE, documents, hostile
from hypothesis import HealthCheck, given, settings

from atlantis_netcfg.errors import ExitCode
from atlantis_netcfg.printable import visible
from atlantis_netcfg.report.checklist import Document, lines
from atlantis_netcfg.report.checklist._grid import grid
from atlantis_netcfg.report.checklist._html import html
from atlantis_netcfg.report.checklist._junit import junit


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
    assert all(shown(item.id) in words and shown(item.message) in words for item in document.items)


@given(documents())
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_any_document(document: Document) -> None:
    harmless(document)
    whole(document)
    page = parsed(html(document, made.files()))
    safe(page)
    holds(page, document)


def test_hostile_words_on_a_console() -> None:
    harmless(hostile())


def test_hostile_words_in_jenkins() -> None:
    whole(hostile())


def test_hostile_words_are_words_in_the_page() -> None:
    document = hostile()
    page = parsed(html(document, {}))
    safe(page)
    holds(page, document)
    words = "".join(page.text.split())
    assert [one for one in HOSTILE if shown(one) not in words] == []


@pytest.mark.parametrize("document", [made.example(), made.green(), made.empty()], ids=["example", "green", "empty"])
def test_the_examples(document: Document) -> None:
    harmless(document)
    whole(document)
    page = parsed(html(document, made.files()))
    safe(page)
    holds(page, document)
