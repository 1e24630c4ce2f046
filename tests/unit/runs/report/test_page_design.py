"""All HTML pages share one design: the same frame and style sheet, nothing external, readable on a phone."""

import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from page_kinds import PAGES, REHEARSALS, ROOT, VERDICTS

from atlantis_netcfg.core import language
from atlantis_netcfg.runs.report import page_frame

PHONE = 360
EXTERNAL = re.compile(r"""(?:src|href|action|srcset|poster|data)=["'](?!#|data:image/)|url\(|@import|<script|<link""")


class Tags(HTMLParser):
    """The tags of a page with their attributes."""

    def __init__(self, page: bytes) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(page.decode())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def named(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


@pytest.fixture(params=PAGES)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_page_has_the_shared_style_once_and_no_other(kind: str) -> None:
    text = PAGES[kind]().decode()
    assert re.findall(r"<style[^>]*>(.*?)</style>", text, re.DOTALL) == [page_frame._style()]
    assert [attributes for _, attributes in Tags(text.encode()).tags if "style" in attributes] == []


def test_page_loads_nothing_external(kind: str) -> None:
    text = PAGES[kind]().decode()
    assert EXTERNAL.findall(text) == []
    assert "content=\"default-src 'none'; style-src 'sha256-" in text


def test_page_is_made_for_a_phone(kind: str) -> None:
    page = Tags(PAGES[kind]())
    assert {"name": "viewport", "content": "width=device-width, initial-scale=1"} in page.named("meta")
    assert [attributes["lang"] for attributes in page.named("html")] == ["en"]
    fixed = [
        attributes for tag, attributes in page.tags if tag in {"table", "td", "th", "svg"} and "width" in attributes
    ]
    assert [attributes for attributes in fixed if float(attributes["width"] or 0) > PHONE] == []
    wide = [float(size) for size in re.findall(r"[^-\w]width: ([\d.]+)px", page_frame._style())]
    assert [size for size in wide if size > PHONE] == []


def test_page_states_its_language(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(language, "_current_language", language.Language.PORTUGUESE)
    assert '<html lang="pt-PT">' in PAGES[kind]().decode()


def test_page_begins_with_heading_time_rehearsal_and_verdict(kind: str) -> None:
    text = PAGES[kind]().decode()
    assert len(re.findall(r"<h1 dir=\"auto\">[^<]+</h1>", text)) == 1
    assert ('<p class="faint">' in text.partition("</header>")[0]) == (kind != "enrolment")
    assert ('<section class="rehearsal"' in text) == (kind in REHEARSALS)
    verdicts = re.findall(
        r'<section class="verdict s-[\w-]+".*?<span class="state">([^<]+)</span>: \S', text, re.DOTALL
    )
    assert verdicts == ([VERDICTS[kind]] if kind in VERDICTS else [])
    assert re.search(rf"<title>{'|'.join(verdicts)}", text) is not None


def test_no_template_has_its_own_frame_or_style() -> None:
    folders = (ROOT / "atlantis_netcfg", ROOT / "templates", ROOT / "bench")
    files = [path for folder in folders for path in folder.rglob("*") if path.suffix in {".j2", ".py", ".html", ".css"}]
    assert len(files) > 500
    whole = [path for path in files if re.search(r"<html|<style", path.read_text(encoding="utf-8"), re.IGNORECASE)]
    styles = [path for path in files if ".css" in path.name]
    templates = Path(page_frame.__file__).with_name("templates")
    assert (whole, styles) == ([templates / "frame.html.j2"], [templates / "pages.css.j2"])
