"""The PDF's fonts and bytes; its words are read back by a stranger in tests/integration/checklist/report."""

import checklist_example as made
import pytest
from checklist_strategies import SHORT, hostile

from atlantis_netcfg.checklist.report import Document, _pdf, pages
from atlantis_netcfg.checklist.report._pdf import pdf
from atlantis_netcfg.checklist.report._pdf._sheet import printable
from atlantis_netcfg.runs.report.signs import SYMBOLS


@pytest.mark.parametrize(
    "text", ["Viana do Castelo", "Ωκεανός", "Атлантида", "é ñ ç ø ł ž", "→ ✓ ✗ ■ °±µ", *SYMBOLS.values()]
)
def test_characters_in_the_fonts_are_printed(text: str) -> None:
    assert printable(text) == text


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("🚤", "U+1F6A4"),
        ("日", "U+65E5"),
        ("a\u202eb", "aU+202Eb"),
        ("a\tb\nc", "a b\nc"),
        ("soft\u00adhyphen", "softU+00ADhyphen"),
        ("⌘⌘", "U+2318U+2318"),
        ("\ud800", "U+D800"),
    ],
)
def test_characters_missing_in_the_fonts_are_written_out(text: str, told: str) -> None:
    assert printable(text) == told


def test_output_is_reproducible(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "Pacific/Auckland")
    first = pdf(made.example(), made.files())
    monkeypatch.setenv("TZ", "UTC")
    assert pdf(made.example(), made.files()) == first
    assert b"/CreationDate (D:20260504101100Z)" in first


@pytest.mark.parametrize("document", [made.empty(), hostile(SHORT)], ids=["empty", "hostile"])
def test_any_document_gives_a_pdf(document: Document) -> None:
    assert pdf(document, {}).startswith(b"%PDF-1.")


def test_there_are_three_pages() -> None:
    made_of = pages(made.empty(), {})
    assert list(made_of) == ["report.html", "report.pdf", "junit.xml"]
    assert made_of["report.pdf"] == _pdf.pdf(made.empty(), {})
