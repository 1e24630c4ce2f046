"""The page in a real browser: as a telephone, a desktop, in the dark, and printed; one start of Chromium for all.

What is measured: nothing is wider than the screen, nothing is asked for, nobody's words run, and axe-core finds nothing
serious. The pictures are kept in the folder of the test, for people.
"""

import json
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from chromium_pipe import Chromium, chromium
from pages_example import SHORT, hostile, made, marked

from atlantis_netcfg.checklist.report._pages import html
from atlantis_netcfg.checklist.report._pdf import pdf

AXE = Path(__file__).parents[4] / ".venv-strangers" / "node_modules" / "axe-core" / "axe.min.js"
RULES = {"type": "tag", "values": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]}
COLOURS = {"type": "rule", "values": ["color-contrast"]}
"""In the dark nothing else is otherwise."""
WIDEST = (
    "[...document.querySelectorAll('body *')].map(e => e.getBoundingClientRect().right).reduce((a, b) => a > b ? a : b)"
)
HOSTILE = hostile((*SHORT, "x" * 2_000))
MANY = made.example(items=tuple(item.model_copy(update={"message": f"{item.message}. " * 6}) for item in made.items()))
"""Long messages, so that paper is full of text."""
DOCUMENTS = {"example": made.example(), "green": made.green(), "empty": made.empty(), "hostile": HOSTILE, "many": MANY}
A4_PIXELS = 297 / 25.4 * 96


@dataclass(frozen=True, slots=True)
class Screen:
    width: int
    height: int
    dark: bool = False


SCREENS = {"telephone": Screen(360, 800), "desktop": Screen(1280, 900), "telephone-dark": Screen(360, 800, dark=True)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pages")
    for name, document in DOCUMENTS.items():
        (folder / f"{name}.html").write_bytes(html(document, made.files()))
    with pytest.MonkeyPatch.context() as monkeypatch, marked(monkeypatch, longer):
        (folder / "longer.html").write_bytes(html(made.example(), made.files()))
    return folder


def longer(text: str) -> str:
    """A message as another language may have it: a third longer."""
    return text + "x" * (len(text) // 3)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with chromium(tmp_path_factory.mktemp("profile")) as one:
        yield one


def show(browser: Chromium, folder: Path, name: str, screen: Screen) -> None:
    page = folder / f"{name}.html"
    browser.open(page, width=screen.width, height=screen.height, dark=screen.dark)


def test_page_fits_loads_nothing_external_and_prints(browser: Chromium, folder: Path) -> None:
    """One test, for workers that share tests would each start a browser."""
    for name in DOCUMENTS:
        for screen in ("telephone", "desktop"):
            fits_and_asks_for_nothing(browser, folder, name, SCREENS[screen])
    the_grid_is_on_a_telephone(browser, folder)
    the_print_is_black_and_white_and_whole(browser, folder)
    the_print_is_no_longer_than_the_pdf(browser, folder)
    the_drawing_takes_less_than_half_a_page(browser, folder)
    longer_words_have_room(browser, folder)
    what_is_asked_for_is_counted(browser, folder)
    the_policy_holds(browser, folder)


@pytest.mark.skipif(not AXE.exists(), reason="no .venv-strangers here: `tools/strangers` makes it")
def test_page_has_no_serious_accessibility_violation(browser: Chromium, folder: Path) -> None:
    for name, size in SCREENS.items():
        show(browser, folder, "example", size)
        browser.picture(folder / f"{name}.png")
        told = judged(browser, COLOURS if size.dark else RULES)
        serious = [one for one in told["violations"] if one["impact"] in {"serious", "critical"}]
        assert [(name, one["id"], one["help"], one["nodes"]) for one in serious] == []
        assert told["passes"] >= (1 if size.dark else 25)


def fits_and_asks_for_nothing(browser: Chromium, folder: Path, name: str, size: Screen) -> None:
    show(browser, folder, name, size)
    asked = [address for address in browser.requests() if not address.startswith("data:image/")]
    assert asked == [(folder / f"{name}.html").as_uri()]
    assert [event for event in browser.events if event["method"] in {"Log.entryAdded", "Runtime.exceptionThrown"}] == []
    assert browser.run("document.documentElement.scrollWidth") <= size.width
    assert browser.run(WIDEST) <= size.width
    assert [event for event in browser.events if event["method"] == "Page.javascriptDialogOpening"] == []
    assert outside(browser) == []


def outside(browser: Chromium) -> list[str]:
    """What the proxy was asked for; Chromium asks for things of its own as well."""
    return [line for line in browser.proxy.asked if "example" in line]


def judged(browser: Chromium, rules: Mapping[str, object]) -> Any:  # noqa: ANN401 - axe-core's JSON
    """What axe-core says of the page; DevTools may run it though the page's own policy forbids scripts."""
    browser.run(AXE.read_text(encoding="utf-8") + "; null")
    return browser.run(
        f"axe.run(document, {{runOnly: {json.dumps(rules)}}}).then(told => ({{passes: told.passes.length, violations: "
        "told.violations.map(one => ({id: one.id, impact: one.impact, help: one.help, "
        "nodes: one.nodes.slice(0, 3).map(node => node.html + ' ' + node.failureSummary)}))}))"
    )


def the_grid_is_on_a_telephone(browser: Chromium, folder: Path) -> None:
    show(browser, folder, "example", SCREENS["telephone"])
    cells = browser.run(
        "[...document.querySelectorAll('.grid td a')].map(cell => [cell.getBoundingClientRect().width, "
        "cell.getBoundingClientRect().height])"
    )
    assert len(cells) == 25
    # 24 pixels are the least that a finger is asked to hit (WCAG 2.2, 2.5.8).
    assert all(width >= 24 and height >= 24 for width, height in cells)
    assert browser.run("document.querySelector('.scroll').scrollWidth <= document.querySelector('.scroll').clientWidth")


def the_print_is_black_and_white_and_whole(browser: Chromium, folder: Path) -> None:
    show(browser, folder, "example", SCREENS["desktop"])
    browser.look(media="print")
    browser.printed(folder / "example-print.pdf")
    words = text(folder / "example-print.pdf")
    for item in made.example().items:
        assert "".join(item.id.split()) in words
        assert "".join(item.message.split()) in words
    for row in ("Girona 500", "Coastal testbed", "Satellite", "INCONCLUSIVE", "(✓)"):
        assert "".join(row.split()) in words
    inks = browser.run("[...document.querySelectorAll('.grid a')].map(one => getComputedStyle(one).color)")
    assert set(inks) == {"rgb(0, 0, 0)"}
    # On paper as wide as A4 between its margins nothing is cut off, and no word of the grid leaves its cell.
    browser("Emulation.setDeviceMetricsOverride", width=703, height=1000, deviceScaleFactor=1, mobile=False)
    assert browser.run(WIDEST) <= 703
    wide = (
        "[...document.querySelectorAll('.grid td a')].filter(cell => cell.querySelector('.word')"
        ".getBoundingClientRect().width > cell.getBoundingClientRect().width).map(cell => cell.textContent)"
    )
    assert browser.run(wide) == []


def the_print_is_no_longer_than_the_pdf(browser: Chromium, folder: Path) -> None:
    for name in ("example", "green", "empty", "many"):
        show(browser, folder, name, SCREENS["desktop"])
        browser.look(media="print")
        browser.printed(folder / f"{name}-print.pdf")
        (folder / f"{name}.pdf").write_bytes(pdf(DOCUMENTS[name], made.files()))
        printed, made_here = (sheets(folder / file) for file in (f"{name}-print.pdf", f"{name}.pdf"))
        assert 1 <= printed <= made_here, (name, printed, made_here)


def sheets(file: Path) -> int:
    """Pages, as poppler counts them."""
    told = subprocess.run(["pdfinfo", file], check=True, capture_output=True, text=True).stdout
    return int(told.partition("Pages:")[2].split()[0])


def the_drawing_takes_less_than_half_a_page(browser: Chromium, folder: Path) -> None:
    for name in ("example", "many"):
        show(browser, folder, name, SCREENS["desktop"])
        assert drawn(browser) == ["drawing-wide"]
        browser.look(media="print")
        browser("Emulation.setDeviceMetricsOverride", width=703, height=1000, deviceScaleFactor=1, mobile=False)
        assert drawn(browser) == ["drawing-wide"]
        high = browser.run("document.querySelector('.drawing-wide').getBoundingClientRect().height")
        assert 50 < high < A4_PIXELS / 2
    show(browser, folder, "example", SCREENS["telephone"])
    assert drawn(browser) == ["drawing-narrow"]


def drawn(browser: Chromium) -> list[str]:
    """Which drawings are to be seen."""
    shown = "[...document.querySelectorAll('svg')].filter(one => one.getBoundingClientRect().height > 0)"
    return [str(name).split()[-1] for name in browser.run(f"{shown}.map(one => one.getAttribute('class'))")]


def longer_words_have_room(browser: Chromium, folder: Path) -> None:
    """Texts that are a third longer, as Portuguese ones are, do not leave the page."""
    for screen in SCREENS.values():
        show(browser, folder, "longer", screen)
        assert browser.run("document.documentElement.scrollWidth") <= screen.width
        assert browser.run(WIDEST) <= screen.width
    show(browser, folder, "longer", SCREENS["desktop"])
    browser.look(media="print")
    browser("Emulation.setDeviceMetricsOverride", width=703, height=1000, deviceScaleFactor=1, mobile=False)
    assert browser.run(WIDEST) <= 703


def what_is_asked_for_is_counted(browser: Chromium, folder: Path) -> None:
    """Else the counts above would say nothing."""
    (folder / "asks.html").write_text('<img src="http://asks.example/a">', encoding="utf-8")
    show(browser, folder, "asks", SCREENS["desktop"])
    assert browser.requests()[1:] == ["http://asks.example/a"]
    assert outside(browser) == ["GET http://asks.example/a HTTP/1.1"]


def the_policy_holds(browser: Chromium, folder: Path) -> None:
    """Even if somebody's words got into the page as they are, nothing would run and nothing would be fetched."""
    page = (folder / "green.html").read_text(encoding="utf-8")
    put_in = '<img src="http://evil.example/b"><script>document.title = "ran"</script><style>body{width:9px}</style>'
    (folder / "put-in.html").write_text(page.replace("</main>", f"{put_in}</main>"), encoding="utf-8")
    show(browser, folder, "put-in", SCREENS["desktop"])
    assert browser.run("document.title").startswith("PASS: Checklist of")
    assert browser.run("document.body.clientWidth") > 1000
    assert [line for line in outside(browser) if "evil" in line] == []
    refused = [event for event in browser.events if event["method"] == "Log.entryAdded"]
    assert len(refused) == 3
    assert all("Content Security Policy" in event["params"]["entry"]["text"] for event in refused)


def text(path: Path) -> str:
    told = subprocess.run(["pdftotext", "-layout", path, "-"], check=True, capture_output=True, text=True)
    return "".join(told.stdout.split())
