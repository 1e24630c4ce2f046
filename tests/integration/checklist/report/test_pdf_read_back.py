"""The words of the PDF, as poppler's pdftotext reads them."""

import re
import subprocess
from collections.abc import Mapping
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from impostor import HOSTILE, control_characters
from pages_example import SHORT, documents, hostile, made

from atlantis_netcfg.checklist.report import Document
from atlantis_netcfg.checklist.report._pdf import pdf
from atlantis_netcfg.checklist.report._pdf._sheet import printable
from atlantis_netcfg.checklist.report._texts import strip_code

pytestmark = pytest.mark.slow


def read(document: Document, files: Mapping[str, bytes]) -> list[str]:
    """Its pages, without blanks."""
    told = subprocess.run(["pdftotext", "-raw", "-", "-"], input=pdf(document, files), check=True, capture_output=True)
    assert told.stderr == b""
    return ["".join(page.split()) for page in told.stdout.decode().split("\f")[:-1]]


def plain(text: str) -> str:
    return "".join(strip_code(printable(text)).split())


def holds(document: Document, files: Mapping[str, bytes]) -> list[str]:
    """No item is left out, nor what is said of it, though a page ends in the middle of it."""
    pages = read(document, files)
    head = plain(f"{document.site}, run {document.run};")
    bodies = [re.sub(r"page\d+of\d+$", "", page) for page in pages]
    assert all(page.startswith(head) for page in bodies)
    assert [page for page in pages if not page.endswith(f"page{pages.index(page) + 1}of{len(pages)}")] == []
    words = "".join(bodies)
    for item in document.items:
        assert plain(item.id) in words
        assert plain(item.message) in words
    return bodies


@pytest.mark.smoke("example")
@pytest.mark.parametrize("document", [made.example(), made.green(), made.empty()], ids=["example", "green", "empty"])
def test_example_documents_are_complete(document: Document) -> None:
    holds(document, made.files())


@pytest.fixture(scope="module")
def example() -> list[str]:
    return read(made.example(), made.files())


@pytest.mark.smoke
def test_essentials_are_on_the_first_page(example: list[str]) -> None:
    first = example[0]
    for words in (
        "Pre-test checklist: Coastal testbed",
        "REHEARSAL: nothing real was checked.",
        "Injected faults: • a second DHCP server at 10.64.1.77",
        "The checklist has not passed",
        "1 ERROR, 2 FAIL, 1 INCONCLUSIVE, 2 OPEN, 1 OVERRIDDEN, 1 WARN, 25 PASS, 1 SKIP",
        "Signed by A. Technician, 2026-05-04 11:12 WEST (10:12 UTC)",
        made.signature().digest,
        made.signature().key,
        "not in Table 3",
        "INCONCLUSIVE",
    ):
        assert plain(words) in first


def test_drawing_and_unchecked_items_are_included(example: list[str]) -> None:
    document, words = made.example(), "".join(example)
    assert document.drawing.nodes
    assert all(plain(node.label) in words for node in document.drawing.nodes if not node.detail)
    assert document.left_out
    for entry in document.left_out:
        assert plain(f"{entry.what}: {entry.why}") in words


def test_evidence_overrides_and_hashes_are_included(example: list[str]) -> None:
    words = "".join(example)
    for one in (
        "signal at coastal-gateway, wlan1: -22 dBm (read from the device, 2026-05-04 10:30 WEST (09:30 UTC))",
        "Overridden by A. Technician, 2026-05-04 10:30 WEST (09:30 UTC):",
        "Zarco stays ashore today; its crew replaces the radio",
        f"failsafe.png: SHA-256 {made.sha256(made.photo())}",
        "sparus/wifi: ✓ PASS → ✗ FAIL: -22 dBm, was -50 dBm",
        "Mares: Acoustic: left out by `phase=bench`",
        "radio waves: the signal is what the twin is told to say",
        made.sha256(b"the example inventory"),
    ):
        assert plain(one) in words


def test_photo_is_embedded() -> None:
    shown = made.green(items=tuple(item for item in made.items() if item.id == "stork/rc_rf/failsafe"))
    with_photo, without = (pdf(shown, files) for files in (made.files(), {}))
    assert with_photo.count(b"/Subtype /Image") > without.count(b"/Subtype /Image")


@pytest.mark.smoke
def test_hostile_text_is_printed_literally() -> None:
    document = hostile(SHORT)
    words = "".join(read(document, {}))
    assert [one for one in SHORT if plain(one) not in words] == []


def test_control_characters_are_removed() -> None:
    """Of what a device said: a form feed ends a page for pdftotext, a line feed its lines."""
    said = hostile((f"before{HOSTILE}after",))
    told = subprocess.run(["pdftotext", "-raw", "-", "-"], input=pdf(said, {}), check=True, capture_output=True).stdout
    words = told.decode().replace("\f", "")
    assert "before" in words
    assert control_characters(words) == []


def test_no_character_of_a_very_long_word_is_lost() -> None:
    long = "".join(f"{number:04d}" for number in range(2_500))
    document = made.green(items=(made.item("sparus/gps", message=long),))
    pages = read(document, {})
    told = "".join(re.sub(r"[^0-9]", "", page) for page in pages)
    lost = [number for number in range(2_500) if f"{number:04d}" not in told]
    assert len(lost) < len(pages), "more than those through which a page's end goes"


@given(document=documents())
@settings(max_examples=6, suppress_health_check=[HealthCheck.too_slow])
def test_any_document_can_be_printed(document: Document) -> None:
    read(document, made.files())


def families(document: Document, tmp_path: Path) -> dict[str, str]:
    """Piece of text -> the font of its letters, as poppler's pdftohtml finds them."""
    (tmp_path / "page.pdf").write_bytes(pdf(document, {}))
    command = ["pdftohtml", "-xml", "-i", "-stdout", str(tmp_path / "page.pdf")]
    told = subprocess.run(command, check=True, capture_output=True).stdout.decode()
    names = dict(re.findall(r'<fontspec id="(\d+)"[^>]* family="([^"]*)"', told))
    texts = re.findall(r'<text[^>]* font="(\d+)">(.*?)</text>', told)
    return {re.sub(r"<[^>]*>", "", text).strip(): names[number] for number, text in texts}


def test_back_ticks_are_printed_as_code(example: list[str], tmp_path: Path) -> None:
    assert "`" not in "".join(example)
    shown = made.green(items=(made.item("sparus/wifi", message="type `provision check` now"),))
    found = families(shown, tmp_path)
    assert "Mono" in found["provision check"]
    assert "Mono" not in found["type"]
    assert "typeprovisionchecknow" in "".join(read(shown, {}))


@pytest.mark.parametrize("code", ["`Ωmega`", "`日`", "`\u202e`", "odd ` one", "``", f"`{'x' * 400}`", "`a` " * 900])
def test_code_of_any_kind_is_printed_completely(code: str) -> None:
    shown = made.green(items=(made.item("sparus/wifi", message=code),))
    assert plain(code) in re.sub(r"page\d+of\d+|coastal,run\S+?NOTSIGNED", "", "".join(read(shown, {})))


def test_paragraph_with_code_continues_on_the_next_page() -> None:
    words = " ".join(f"word{number} `code{number}`" for number in range(1_500))
    pages = holds(made.green(items=(made.item("sparus/gps", message="none"),), notes=(words,)), {})
    assert len(pages) > 2
    lost = [number for number in range(1_500) if f"word{number}code{number}" not in "".join(pages)]
    assert len(lost) < len(pages), "more than those through which a page's end goes"
