"""Every kind of page in a real browser, on phone, tablet and laptop, in both languages: no scrolling, no broken word.

The pictures are kept in the folder of the test, for people.
"""

from pathlib import Path

import pytest
from chromium_pipe import Chromium, chromium
from page_kinds import PAGES

from atlantis_netcfg.core import language

PHONE = 360
WIDTHS = (PHONE, 760, 1100)
"""In pixels."""
BROKEN_WORDS = """(() => {
  const broken = [], walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const node = walker.currentNode;
    if (!node.parentElement.checkVisibility() || node.parentElement.closest('svg, .digest, .hidden')) continue;
    for (const match of node.data.matchAll(/(?<![\\p{L}\\p{N}])[\\p{L}\\p{N}]{2,20}(?![\\p{L}\\p{N}])/gu)) {
      const range = document.createRange();
      range.setStart(node, match.index);
      range.setEnd(node, match.index + match[0].length);
      const lines = new Set([...range.getClientRects()].map(one => Math.round(one.top)));
      if (lines.size > 1) broken.push(match[0]);
    }
  }
  return broken;
})()"""
CUT = """[...document.querySelectorAll('body *')].filter(one => one.scrollWidth > one.clientWidth + 1
  && getComputedStyle(one).overflowX === 'hidden' && !one.closest('.hidden, .word, svg')).map(one => one.outerHTML)"""


@pytest.mark.slow
def test_every_page_is_readable_on_a_phone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One test, for workers that share tests would each start a browser."""
    with chromium(tmp_path / "profile") as browser:
        for tongue in language.Language:
            monkeypatch.setattr(language, "_current_language", tongue)
            for kind, build in PAGES.items():
                path = tmp_path / f"{kind}-{tongue.name.lower()}.html"
                path.write_bytes(build())
                for width in WIDTHS:
                    is_readable(browser, path, width)
        broken_words_are_noticed(browser, tmp_path)


def is_readable(browser: Chromium, path: Path, width: int) -> None:
    browser.open(path, width=width, height=800)
    browser.picture(path.with_suffix(f".{width}.png"))
    assert (path.name, browser.run("document.documentElement.scrollWidth")) == (path.name, width)
    assert (path.name, width, browser.run(BROKEN_WORDS)) == (path.name, width, [])
    assert (path.name, width, browser.run(CUT)) == (path.name, width, [])
    assert [address for address in browser.requests() if not address.startswith("data:image/")] == [path.as_uri()]


def broken_words_are_noticed(browser: Chromium, folder: Path) -> None:
    """Else the test above would say nothing."""
    (folder / "broken.html").write_text('<p style="width: 3em; overflow-wrap: anywhere">interoperability</p>')
    browser.open(folder / "broken.html", width=PHONE, height=800)
    assert browser.run(BROKEN_WORDS) == ["interoperability"]
