"""The pages as a site: built without a warning, with tree and search, all from here; the quick start is one sheet."""

import json
import re
import shlex
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest
from house_checkout import ROOT

DOCS = ROOT / "docs"
RESOURCES = {"link": "href", "script": "src", "img": "src", "iframe": "src", "source": "src", "object": "data"}


def build(source: Path, target: Path) -> subprocess.CompletedProcess[str]:
    """As `tools/lint docs` builds them, to another place."""
    found = re.search(r"docs\) python (.*) docs build/docs ;;", (ROOT / "tools" / "lint").read_text())
    assert found is not None
    words = [*shlex.split(found[1]), "-d", str(target / "doctrees"), str(source), str(target / "site")]
    return subprocess.run([sys.executable, *words], cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("docs")
    process = build(DOCS, target)
    assert (process.returncode, process.stdout, process.stderr) == (0, "", "")
    return target / "site"


class Fetched(HTMLParser):
    """What a browser fetches by itself to show a page."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        name = RESOURCES.get(tag)
        self.addresses += [value or "" for key, value in attrs if key == name]


def fetched(page: Path) -> list[str]:
    parser = Fetched()
    parser.feed(page.read_text(encoding="utf-8"))
    return parser.addresses


@pytest.mark.slow
def test_every_page_is_built_and_in_the_navigation(site: Path) -> None:
    pages = {path.relative_to(DOCS).with_suffix("") for path in DOCS.rglob("*.md")}
    assert all((site / page).with_suffix(".html").is_file() for page in pages)
    tree = (site / "index.html").read_text().partition('class="sidebar-tree"')[2].partition("</div>")[0]
    links = {Path(link).with_suffix("") for link in re.findall(r'class="reference internal" href="([^"#]+)"', tree)}
    assert links == pages - {Path("index")}


@pytest.mark.slow
def test_nothing_is_loaded_from_other_sites(site: Path) -> None:
    pages = sorted(site.rglob("*.html"))
    assert sum(len(fetched(page)) for page in pages) > 100
    assert [address for page in pages for address in fetched(page) if re.match(r"(\w+:)?//", address)] == []
    styles = [path.read_text(encoding="utf-8") for path in site.rglob("*.css")]
    assert [found for style in styles for found in re.findall(r"(?:url\(|@import)\s*['\"]?(?:https?:)?//", style)] == []


@pytest.mark.slow
def test_search_finds_how_rollback_works(site: Path) -> None:
    index = json.loads((site / "searchindex.js").read_text().removeprefix("Search.setIndex(").removesuffix(")"))
    found = index["titleterms"]["rollback"]
    numbers = [found] if isinstance(found, int) else found
    assert "running" in {index["docnames"][number] for number in numbers}
    assert "How rollback works" in index["alltitles"]
    assert {"safe", "mode"} <= index["terms"].keys(), "words of the text as well"


@pytest.mark.slow
def test_quick_start_prints_on_one_page(site: Path, tmp_path: Path) -> None:
    for page in ("quick-start", "pt/inicio-rapido"):
        printed = tmp_path / "page.pdf"
        words = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-pdf-header-footer"]
        profile = f"--user-data-dir={tmp_path / 'profile'}"
        address = (site / f"{page}.html").as_uri()
        command = ["chromium", *words, "--disable-background-networking", profile, f"--print-to-pdf={printed}", address]
        subprocess.run(command, capture_output=True, check=True)
        facts = subprocess.run(["pdfinfo", printed], capture_output=True, text=True, check=True).stdout
        assert re.search(r"^Pages: +1$", facts, re.MULTILINE), facts
        assert re.search(r"^Page size: .*\(A4\)$", facts, re.MULTILINE), facts
        text = subprocess.run(["pdftotext", printed, "-"], capture_output=True, text=True, check=True).stdout
        assert "provision report verify site=coastal" in text


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "text", "warning"),
    [
        ("stray.md", "# A page that index.md does not list\n", "isn't included in any toctree"),
        ("running.md", "# A page\n\n[nowhere](no-such-page.md)\n", "no-such-page"),
    ],
)
def test_faulty_page_fails_the_build(name: str, text: str, warning: str, tmp_path: Path) -> None:
    source = tmp_path / "docs"
    source.mkdir()
    shutil.copy2(DOCS / "conf.py", source)
    shutil.copytree(DOCS / "_static", source / "_static")
    (source / "index.md").write_text("# Pages\n\n## Some\n\n- [Running](running.md): a page\n")
    (source / "running.md").write_text("# A page\n")
    (source / name).write_text(text)
    process = build(source, tmp_path)
    assert process.returncode != 0
    assert warning in process.stderr
