"""The page read back: strictly balanced tags, its words, its links, the cells of its table."""

from dataclasses import dataclass, field
from html.parser import HTMLParser

from atlantis_netcfg.checklist.report import Document
from atlantis_netcfg.checklist.report._texts import strip_code
from atlantis_netcfg.core.printable import visible
from atlantis_netcfg.runs.report.drift import clean

VOID = frozenset({"meta", "img", "br"})
SVG_EMPTY = frozenset({"rect", "polyline"})


@dataclass(slots=True)
class Element:
    tag: str
    attributes: dict[str, str]
    children: "list[Element | str]" = field(default_factory=list)

    @property
    def words(self) -> str:
        """All text inside."""
        return "".join(child if isinstance(child, str) else child.words for child in self.children)

    @property
    def classes(self) -> set[str]:
        """Of it and of all inside."""
        return {name for one in self.every() for name in one.attributes.get("class", "").split()}

    def every(self) -> "list[Element]":
        inside = [one for child in self.children if isinstance(child, Element) for one in child.every()]
        return [self, *inside]

    def named(self, tag: str) -> "list[Element]":
        return [one for one in self.every() if one.tag == tag]


class Page(HTMLParser):
    """Raises AssertionError where a tag is not closed, or is closed that was not open."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.root = Element("", {})
        self._open = [self.root]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        names = [name for name, _ in attrs]
        assert len(names) == len(set(names)), (tag, names)
        one = Element(tag, {name: value or "" for name, value in attrs})
        self._open[-1].children.append(one)
        if tag not in VOID:
            self._open.append(one)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag in SVG_EMPTY | {"title", "desc", "text"}, tag
        self.handle_starttag(tag, attrs)
        self._open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self._open[-1].tag == tag, (self._open[-1].tag, tag)
        self._open.pop()

    def handle_data(self, data: str) -> None:
        self._open[-1].children.append(data)

    def handle_comment(self, data: str) -> None:
        raise AssertionError(f"a comment: {data}")

    @property
    def elements(self) -> list[Element]:
        return self.root.every()

    @property
    def text(self) -> str:
        return " ".join(self.root.words.split())

    def grid(self) -> dict[str, dict[str, Element]]:
        """Row to column to cell, empty ones as well."""
        table = next(one for one in self.root.named("table") if "grid" in one.attributes.get("class", ""))
        columns = [one.words for one in table.named("th") if one.attributes.get("class") == "column"]
        rows = [row for body in table.named("tbody") for row in body.named("tr")]
        cells = {row.named("th")[0].words: [one for one in row.named("td") if not _gap(one)] for row in rows}
        return {name: dict(zip(columns, found, strict=True)) for name, found in cells.items()}

    def cell(self, row: str, column: str) -> Element:
        return self.grid()[row][column]


def _gap(cell: Element) -> bool:
    return cell.attributes.get("class") == "gap"


def parsed(page: bytes) -> Page:
    one = Page()
    one.feed(page.decode())
    one.close()
    assert len(one._open) == 1, "a tag is left open"
    return one


OUTSIDE = ("src", "href", "action", "srcset", "poster", "data", "background", "xlink:href", "formaction")


def safe(page: Page) -> None:
    """Nothing runs, nothing is fetched, every link ends in the page."""
    identities = [one.attributes["id"] for one in page.elements if "id" in one.attributes]
    assert len(identities) == len(set(identities))
    assert not {one.tag for one in page.elements} & {"script", "iframe", "object", "embed", "link", "form", "base"}
    for one in page.elements:
        assert not [name for name in one.attributes if name.startswith("on") or name == "style"]
        for name in OUTSIDE:
            address = one.attributes.get(name, "#")
            assert address.startswith(("#", "data:image/png;base64,", "data:image/jpeg;base64,"))
            assert not address.startswith("#") or address[1:] in {*identities, ""}


def shown(text: str) -> str:
    """Somebody's words as a page holds them, without the blanks where lines are broken."""
    return "".join(strip_code(clean(visible(text))).split())


def written(text: str) -> str:
    """The same as a file for programs holds them: what stands in back-ticks keeps them."""
    return "".join(clean(visible(text)).split())


def holds(page: Page, document: Document) -> None:
    """No item is left out, nor what is said of it."""
    words = "".join(page.text.split())
    for item in document.items:
        assert shown(item.id) in words
        assert shown(item.message) in words
