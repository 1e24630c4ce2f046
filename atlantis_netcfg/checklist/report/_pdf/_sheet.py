"""PDF page: fonts, margins, header and footer, and the functions that print text."""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import TYPE_CHECKING

from fpdf import FPDF
from fpdf.enums import XPos, YPos
from fpdf.fonts import TTFFont

from atlantis_netcfg.checklist.report import _texts
from atlantis_netcfg.checklist.report._words import signature_line
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.printable import split_code, visible
from atlantis_netcfg.runs.report import page_frame, signs

if TYPE_CHECKING:
    from datetime import datetime

    from atlantis_netcfg.checklist.report.document import Document, Item

FAMILY = "DejaVu"
_CODE_FAMILY = "DejaVuMono"


_FONTS = {"": "DejaVuSans.ttf", "B": "DejaVuSans-Bold.ttf"}
_CODE_FONT = "DejaVuSansMono.ttf"


BODY, SMALL = 9.5, 8.0


_MARGIN = 14.0


_PAGES = "⌘⌘"
"""Placeholder for the number of pages until it is known; `printable` keeps it out of all other text."""


_FAINT = (75, 88, 99)


def _add_fonts(paper: FPDF) -> None:
    folder = resources.files("atlantis_netcfg.checklist.report") / "fonts"
    for family, style, name in (*((FAMILY, *font) for font in _FONTS.items()), (_CODE_FAMILY, "", _CODE_FONT)):
        with resources.as_file(folder / name) as path:
            paper.add_font(family, style, path)


@cache
def _all_glyphs() -> tuple[frozenset[int], frozenset[int]]:
    """Return the characters of the two text fonts, and those of the code font."""
    paper = FPDF()
    _add_fonts(paper)
    *text, code = [frozenset(font.cmap) for font in _fonts(paper)]
    for font in _fonts(paper):
        font.close()
    return frozenset.intersection(*text) - frozenset(map(ord, _PAGES)), code


def _glyphs() -> frozenset[int]:
    return _all_glyphs()[0]


def _fonts(paper: FPDF) -> list[TTFFont]:
    return [font for font in paper.fonts.values() if isinstance(font, TTFFont)]


def printable(text: str) -> str:
    """Make text printable: a character missing in the fonts becomes `U+1F600`; none is dropped."""
    glyphs = _glyphs()
    visible_text = visible(text).replace("\t", " ")
    return "".join(item if ord(item) in glyphs or item == "\n" else f"U+{ord(item):04X}" for item in visible_text)


def rgb(colour: str) -> tuple[int, int, int]:
    """Parse a colour such as `#0a5226`."""
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue


class Paper(FPDF):
    """A4 pages with our fonts; lengths are in millimetres, font sizes in points."""

    def __init__(self, title: str, tool: str, creation_time: datetime) -> None:
        super().__init__(format="A4")
        self.set_margin(_MARGIN)
        self.set_auto_page_break(True, 16)
        self.set_creation_date(creation_time)
        self.set_title(printable(title))
        self.set_creator(printable(f"atlantis-netcfg {tool}"))
        self.set_lang(page_frame.language_tag())
        self.alias_nb_pages(_PAGES)
        _add_fonts(self)
        self.head_line, self.foot_line = "", ""
        """Text on every page, so that a page that was torn off can be identified."""
        self.plain()

    def to_bytes(self) -> bytes:
        """Return all pages as bytes; the object cannot be used afterwards."""
        try:
            return bytes(self.output())
        finally:
            for font in _fonts(self):
                font.close()

    def header(self) -> None:
        """Print the first line of a page, above a rule."""
        # It may stand on top of a paragraph that is indented.
        left_margin, self.l_margin = self.l_margin, _MARGIN
        self.plain(6.5, faint=True)
        self.say(self.head_line)
        self.set_draw_color(150)
        self.line(_MARGIN, self.y + 0.5, self.w - self.r_margin, self.y + 0.5)
        self.set_y(self.y + 3)
        self.l_margin = left_margin

    def footer(self) -> None:
        """Print the page number."""
        self.set_y(-12)
        self.plain(7, faint=True)
        self.set_x(_MARGIN)
        self.cell(0, 4, printable(self.foot_line)[:90])
        self.set_x(_MARGIN)
        self.cell(0, 4, translate(f"page {arg(self.page_no())} of {arg(_PAGES)}"), align="R")

    def plain(self, size: float = BODY, *, bold: bool = False, faint: bool = False) -> None:
        """Set the font of the following text."""
        self.set_font(FAMILY, "B" if bold else "", size)
        self.set_text_color(*(_FAINT if faint else (0, 0, 0)))

    def say(self, text: str, *, indent: float = 0.0) -> None:
        """Print a paragraph with line breaks at the margin."""
        self.set_x(self.l_margin + indent)
        height = self.font_size * 1.35
        pieces = split_code(printable(text))
        if any(is_code for _, is_code in pieces):
            self._with_code(pieces, height, indent)
        else:
            self.multi_cell(0, height, printable(text), align="L", new_x=XPos.LMARGIN, new_y=YPos.NEXT)

    def _with_code(self, pieces: list[tuple[str, bool]], height: float, indent: float) -> None:
        """Print a paragraph with code in its own font."""
        margin, style, size = self.l_margin, self.font_style, self.font_size_pt
        self.set_left_margin(margin + indent)
        for piece, is_code in pieces:
            plain_code = is_code and _all_glyphs()[1].issuperset(map(ord, piece))
            self.set_font(_CODE_FAMILY if plain_code else FAMILY, "" if plain_code else style, size)
            self.write(height, piece)
        self.set_left_margin(margin)
        self.ln(height)
        self.set_font(FAMILY, style, size)

    def tell(
        self, text: str, *, size: float = BODY, bold: bool = False, faint: bool = False, indent: float = 0
    ) -> None:
        """Set the font and print a paragraph."""
        self.plain(size, bold=bold, faint=faint)
        self.say(text, indent=indent)

    def head(self, text: str, *, size: float = 13.0, room: float = 40.0) -> None:
        """Print a heading; never as the last line of a page."""
        self.room(room)
        self.set_y(self.y + 4)
        self.tell(text, size=size, bold=True)
        self.set_draw_color(150)
        self.line(self.l_margin, self.y + 0.6, self.w - self.r_margin, self.y + 0.6)
        self.set_y(self.y + 2)

    def room(self, height: float) -> None:
        """Start a new page unless so much height is left."""
        if self.will_page_break(height):
            self.add_page()


class Sheet(Paper):
    """Pages of one document."""

    def __init__(self, document: Document) -> None:
        super().__init__(translate(_texts.name_of_page(document)), document.tool, document.ended or document.started)
        self._links_to = {id(item): self.add_link(page=1) for item in document.items}
        words = [translate(f"{arg(document.site)}, run {arg(document.run)}")]
        if document.rehearsed:
            words.append(translate(_texts.PageText.REHEARSAL_NOTE))
        digest = (
            msg(f"digest {arg(document.signed.digest)}") if document.signed is not None else _texts.PageText.NOT_SIGNED
        )
        self.head_line = join("; ", (*words, translate(digest)))
        self.foot_line = translate(signature_line(document))

    def tint(self, state: signs.ShownState | None) -> None:
        """Set the colours of a state, with an edge that identifies it in black and white."""
        tint = signs.TINTS[state]
        self.set_text_color(*rgb(tint.ink))
        self.set_fill_color(*rgb(tint.paper))
        self.set_draw_color(*rgb(tint.edge))

    def badge(self, state: signs.ShownState, words: str, *, link: int | None = None) -> None:
        """Print a state in a box; the following text is placed beside it."""
        self.plain(SMALL, bold=True)
        self.tint(state)
        text = printable(f"{signs.SYMBOLS[state]} {words}")
        width = self.get_string_width(text) + 4
        self.cell(width, 5, text, border=1, fill=True, align="C", link=link or "")
        self.set_x(self.x + 2)

    def badge_line(self, state: signs.ShownState, words: str, text: str, *, link: int | None = None) -> None:
        """Print a badge with its text beside it."""
        self.badge(state, words, link=link)
        self.plain(BODY, bold=True)
        self.multi_cell(0, 5, printable(_texts.strip_code(text)), align="L", new_x=XPos.LMARGIN, new_y=YPos.NEXT)
        self.set_y(self.y + 0.7)

    def link_of(self, item: Item) -> int:
        """Return the link to an item's place."""
        return self._links_to[id(item)]
