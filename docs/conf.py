"""How Sphinx builds the pages of this folder: `make docs` writes build/docs, and a warning is an error.

The page tree is what index.md lists: each of its headings with the links below it. So the list stands once, and
index.md can be read in the repository as well. A page that index.md does not list is a warning of Sphinx.
"""
# ruff: noqa: INP001 - Sphinx looks for this file here, and the folder is no package

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from sphinx.highlighting import lexer_classes

from atlantis_netcfg import __version__

if TYPE_CHECKING:
    from sphinx.application import Sphinx

project = "ATLANTIS network configuration"
release = __version__
language = "en"
extensions = ["myst_parser"]
source_suffix = {".md": "markdown"}
root_doc = "index"
exclude_patterns = ["pictures/*"]
myst_heading_anchors = 4

html_theme = "furo"
html_title = f"{project} {release}"
html_static_path = ["_static"]
html_css_files = ["print.css"]
html_copy_source = False
html_show_copyright = False
html_show_sphinx = False

_HEADING = re.compile(r"^## (.+)$", re.MULTILINE)
_LISTED = re.compile(r"^- \[[^\]]+\]\(([\w/-]+)\.md\)", re.MULTILINE)
_OUTSIDE = re.compile(r"\[([^\]]+)\]\((?:\.\./)+((?!\.\.)[^)]+\.md)\)")
"""A link to a text file of the checkout that is no page."""


def page_tree(text: str) -> str:
    """Return the toctree directives of an index page: one for each heading that has links below it."""
    trees = []
    _, *parts = _HEADING.split(text)
    for caption, section in zip(parts[::2], parts[1::2], strict=True):
        if pages := _LISTED.findall(section):
            trees.append("\n".join(["```{toctree}", ":hidden:", f":caption: {caption}", "", *pages, "```", ""]))
    return "\n".join(trees)


def _prepare(app: Sphinx, name: str, source: list[str]) -> None:
    """Name the files that are not built, and add the page tree to the index."""
    folder = (app.srcdir / name).parent

    def named(link: re.Match[str]) -> str:
        target = (folder / link[0].rpartition("(")[2].rstrip(")")).resolve()
        return link[0] if target.is_relative_to(app.srcdir) else f"{link[1]} (`{link[2]}` in the checkout)"

    source[0] = _OUTSIDE.sub(named, source[0])
    if name == root_doc:
        source[0] = f"{source[0]}\n{page_tree(source[0])}"


def setup(app: Sphinx) -> None:
    """Prepare each page as it is read; the block `layers` of the architecture page is plain text."""
    lexer_classes["layers"] = lexer_classes["none"]
    app.connect("source-read", _prepare)
