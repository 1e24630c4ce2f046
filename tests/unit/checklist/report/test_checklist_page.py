"""The page: whole, safe, with every item; what it looks like is looked at in tests/integration/checklist/report."""

import base64
import hashlib
import re

import checklist_example as made
import pytest
from checklist_html import Page, holds, parsed, safe

from atlantis_netcfg.checklist.report import Evidence, EvidenceType, Row, lines
from atlantis_netcfg.checklist.report._junit import junit
from atlantis_netcfg.checklist.report._pages import html
from atlantis_netcfg.core.events import Verdict


@pytest.fixture(scope="module")
def page() -> Page:
    return parsed(html(made.example(), made.files()))


def test_page_is_complete_and_safe(page: Page) -> None:
    safe(page)
    holds(page, made.example())


def test_content_policy_permits_only_its_own_style() -> None:
    text = html(made.example(), made.files()).decode()
    (style,) = re.findall(r"<style>(.*?)</style>", text, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    allowed = f"default-src 'none'; style-src 'sha256-{digest}'; img-src data:; base-uri 'none'; form-action 'none'"
    assert f'<meta http-equiv="Content-Security-Policy" content="{allowed}">' in text
    assert "url(" not in style
    assert "@import" not in style


def test_grid_matches_the_report(page: Page) -> None:
    marked = {row: [name for name, cell in cells.items() if cell.words] for row, cells in page.grid().items()}
    assert marked == {
        "Girona 500": ["Wi-Fi", "Acoustic", "USBL", "GPS"],
        "Sparus": ["Wi-Fi", "Acoustic", "USBL", "GPS"],
        "Zarco": ["Wi-Fi", "Acoustic", "USBL", "GPS"],
        "Stork": ["Wi-Fi", "RC RF", "GPS"],
        "Mares": ["Wi-Fi", "Acoustic", "USBL", "GPS"],
        "ECA ROV": ["USBL", "Ethernet"],
        "Coastal testbed": ["Wi-Fi", "Satellite", "4G", "Site"],
    }
    heads = ["Wi-Fi", "Acoustic", "Satellite", "USBL", "RC RF", "4G", "GPS", "Ethernet", "Site"]
    assert list(page.grid()["Sparus"]) == heads


@pytest.mark.parametrize(
    ("row", "column", "words"),
    [
        ("Girona 500", "Wi-Fi", "✓PASS, Wi-Fi, Girona 500"),
        ("Girona 500", "GPS", "!WARN, GPS, Girona 500"),
        ("Sparus", "Wi-Fi", "✗FAIL, Wi-Fi, Sparus"),
        ("Sparus", "USBL", "?INCONCLUSIVE, USBL, Sparus"),
        ("Zarco", "Wi-Fi", "✎OVERRIDDEN, Wi-Fi, Zarco"),
        ("Mares", "GPS", "■ERROR, GPS, Mares"),
        ("ECA ROV", "USBL", "○OPEN, USBL, ECA ROV"),
        ("ECA ROV", "Ethernet", "(✓)PASS, Ethernet, ECA ROV, not in Table 3"),
        ("Coastal testbed", "Satellite", "(–)SKIP, Satellite, Coastal testbed, not in Table 3"),  # noqa: RUF001 - a dash
        ("Coastal testbed", "Site", "(✗)FAIL, Site, Coastal testbed, not in Table 3"),
        ("Mares", "RC RF", ""),
    ],
)
def test_cell_shows_sign_and_word(page: Page, row: str, column: str, words: str) -> None:
    assert page.cell(row, column).words == words


def test_cell_links_to_its_item(page: Page) -> None:
    (link,) = page.cell("Sparus", "Wi-Fi").named("a")
    (item,) = [one for one in page.elements if "#" + one.attributes.get("id", "") == link.attributes["href"]]
    assert "the signal of Sparus overdrives the receiver" in item.words
    assert "signal at coastal-gateway, wlan1: -22 dBm" in " ".join(item.words.split())


def test_omitted_cell_is_marked() -> None:
    own = tuple(item for item in made.healthy_items() if item.vehicle == "sparus")
    found = parsed(html(made.green(items=own, scope={"vehicle": ("sparus",)}), {}))
    assert found.cell("Mares", "GPS").words == "…NOT CHECKED, GPS, Mares"
    assert "The checklist has passed, for vehicle=sparus only" in found.text


def test_first_screen_shows_the_essentials(page: Page) -> None:
    words = page.text.partition("Table 3")[0]
    for one in (
        "Pre-test checklist: Coastal testbed",
        "REHEARSAL: nothing real was checked.",
        "a second DHCP server at 10.64.1.77",
        "The checklist has not passed",
        "1 ERROR, 2 FAIL, 1 INCONCLUSIVE, 2 OPEN, 1 OVERRIDDEN, 1 WARN, 25 PASS, 1 SKIP",
        "Signed by A. Technician",
        made.signature().digest,
        made.signature().key,
    ):
        assert one in words


def test_worst_item_comes_first(page: Page) -> None:
    first = page.text.partition("What to fix first")[2].partition("Overridden by a person")[0]
    order = ["the probe crashed", "overdrives the receiver", "a second DHCP server", "no fix was heard", "waits for"]
    places = [first.index(words) for words in order]
    assert places == sorted(places)
    assert "move the antennas apart" in first
    assert "Zarco does not answer" not in first


def test_empty_sections_are_omitted() -> None:
    words = parsed(html(made.green(), {})).text
    assert "The checklist has passed 32 PASS" in words
    for one in (
        "REHEARSAL",
        "What to fix first",
        "Overridden by",
        "Changes since the last green checklist",
        "Notes",
        "Limits of the rehearsal",
    ):
        assert one not in words
    assert "Everything on the list was checked." in words


def test_note_is_on_every_page_and_affects_no_verdict(page: Page) -> None:
    noted = made.green(notes=made.example().notes)
    assert noted.exit is made.green().exit
    for words in (page.text, parsed(html(noted, {})).text, junit(noted).decode(), " ".join(lines(noted).split())):
        assert made.example().notes[0] in words


def test_empty_checklist_is_clearly_reported() -> None:
    words = parsed(html(made.empty(), {})).text
    assert "Nothing was checked" in words
    assert "NOT SIGNED Nobody vouches for this page." in words


def test_row_that_differs_from_the_report_states_why() -> None:
    row = Row(key="stork", name="Stork", kind="uav", table3=("wifi",), deviation="its GPS is on the ground")
    words = parsed(html(made.green(rows=(row,)), {})).text
    assert "Stork differs from the report: its GPS is on the ground" in words


def test_warnings_are_shown_when_nothing_failed() -> None:
    warned = made.item("sparus/gps", Verdict.WARN, "few satellites", hint="wait for a clear sky")
    words = parsed(html(made.green(items=(warned, made.item("sparus/wifi"))), {})).text
    assert "The checklist has passed, with warnings 1 WARN, 1 PASS" in words
    assert "What to check ! WARN GPS of Sparus few satellites wait for a clear sky" in words
    assert "What to fix first" not in words


def test_evidence_of_one_kind_is_grouped() -> None:
    told = [("firmware", "1.7"), ("battery", "24 V")]
    read = tuple(Evidence(type=EvidenceType.READ, what=what, value=value) for what, value in told)
    declared = Evidence(type=EvidenceType.DECLARED, what="address", value="3")
    item = made.item("sparus/acoustic", evidence=(*read, declared))
    words = parsed(html(made.green(items=(item,)), {})).text
    assert "firmware: 1.7; battery: 24 V (read from the device)" in words
    assert "address: 3 (from the inventory)" in words


def test_changes_are_listed(page: Page) -> None:
    words = page.text.partition("Changes since the last green checklist")[2].partition("What was not checked")[0]
    assert "sparus/wifi ✓ PASSNow ✗ FAIL-22 dBm, was -50 dBm" in words
    assert "coastal/site/poe no such itemNow ✓ PASSis new" in words


def test_photo_is_embedded(page: Page) -> None:
    (image,) = [one for one in page.elements if one.tag == "img"]
    kept = image.attributes["src"].removeprefix("data:image/png;base64,")
    assert base64.b64decode(kept) == made.photo()
    assert image.attributes["alt"] == "Photo failsafe.png"
    assert f"failsafe.png: SHA-256 {made.sha256(made.photo())}; {len(made.photo())} bytes" in page.text


@pytest.mark.parametrize("letter", ["\u202e", "\x1b", "\0", "\u200b", "\ufeff", "\x9b", "\u2066"])
def test_invisible_character_is_written_out(letter: str) -> None:
    document = made.green(items=(made.item("sparus/wifi", Verdict.WARN, f"a{letter}b"),))
    shown = f"aU+{ord(letter):04X}b"
    for told in (html(document, {}).decode(), lines(document), junit(document).decode()):
        assert letter not in told
        assert shown in told


def test_output_is_reproducible() -> None:
    assert html(made.example(), made.files()) == html(made.example(), made.files())


def test_back_ticks_are_shown_as_code(page: Page) -> None:
    shown = [element.words for element in page.root.named("code")]
    assert {"tx_power_dbm", "/interface bridge host print", "phase=bench"} <= set(shown)
    assert "`" not in page.text


@pytest.mark.parametrize(
    ("text", "codes", "words"),
    [
        ("type `a b` or `c`", ["a b", "c"], "type a b or c"),
        ("an odd ` back-tick", [], "an odd ` back-tick"),
        ("`` and `\n`", [], "`` and ` `"),
        ("`<b>&amp;</b>`", ["<b>&amp;</b>"], "<b>&amp;</b>"),
        ("<code>`x`</code>", ["x"], "<code>x</code>"),
    ],
)
def test_code_is_marked_up_without_loss(text: str, codes: list[str], words: str) -> None:
    message = parsed(html(made.green(items=(made.item("sparus/wifi", Verdict.WARN, text),)), {}))
    safe(message)
    (paragraph, *_) = [one for one in message.elements if one.attributes.get("class") == "words" and one.tag == "p"]
    assert [code.words for code in paragraph.named("code")] == codes
    assert " ".join(paragraph.words.split()) == words


def test_rehearsal_banner_is_no_warning(page: Page) -> None:
    """Each has a shape, a heading and colours of its own; the banner takes none of a state."""
    (banner,) = [one for one in page.elements if one.attributes.get("class") == "rehearsal"]
    assert banner.words.split()[0] == "REHEARSAL:"
    assert not {name for name in banner.classes if name.startswith("s-")}
    (verdict,) = [one for one in page.elements if one.attributes.get("class", "").startswith("verdict ")]
    assert verdict.attributes["aria-label"] == "Verdict"
    assert "REHEARSAL" not in verdict.words
