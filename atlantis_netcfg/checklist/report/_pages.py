"""The checklist as one page that needs nothing else: no script, no request, pictures inside.

The pages that are kept beside a signed document.

Photos that are evidence, in a size that a report can carry; every other file is only named, with its SHA-256.

A telephone's photo has 5 MB, a report is sent over a satellite: large ones are made smaller, and the page says so. What
counts as the evidence is the file that is kept beside the document; its hash is compared before anything is shown.

The checklist as JUnit XML: a suite a row, a case an item. What keeps a checklist from being green fails in it.

FAIL, INCONCLUSIVE and what is open are failures, ERROR is an error, SKIP is skipped with its reason; what a person has
overridden passes, and `system-out` says who and why. A checklist in which nothing was checked has an error of its own.
"""

from __future__ import annotations

import base64
import hashlib
import io
import warnings
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from markupsafe import Markup
from PIL import Image, ImageOps

from atlantis_netcfg.checklist.report import _texts
from atlantis_netcfg.checklist.report._shapes import DARK, SYMBOLS, TINTS, ShownState, css_class, grid, state
from atlantis_netcfg.checklist.report._svg import drawing_svg
from atlantis_netcfg.checklist.report._texts import coded
from atlantis_netcfg.checklist.report._words import (
    circumstances,
    closing,
    counts,
    english,
    evidence_groups,
    evidence_words,
    headline,
    scope,
    signed,
    title,
    to_look_at,
)
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.times import time_text
from atlantis_netcfg.report.drift import add, clean, count, skip, tell, written
from atlantis_netcfg.report.page import page, page_environment

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from jinja2 import Environment

    from atlantis_netcfg.checklist.report.document import Document, Evidence, Item


_FAILURES = frozenset({ShownState.FAIL, ShownState.INCONCLUSIVE, ShownState.OPEN})


def junit(document: Document) -> bytes:
    """The file, the same for the same document."""
    rehearsed = ", rehearsed: nothing real was checked" if document.rehearsed else ""
    root = ET.Element("testsuites", name=clean(f"checklist of {document.site}{rehearsed}"))
    root.append(_whole(document))
    for row in grid(document).rows:
        if row.items:
            root.append(_suite(row.row.key, row.items))
    if document.left_out:
        root.append(_left_out(document))
    return written(root)


def _whole(document: Document) -> ET.Element:
    suite = ET.Element("testsuite", name="checklist", time="0")
    case = ET.SubElement(suite, "testcase", name="something was checked", classname="checklist", time="0")
    if document.exit is ExitCode.NOTHING:
        add(case, "error", "NOTHING", "nothing was checked: there is no item that is not skipped")
    tell(case, f"run {document.run}", closing(document, english), signed(document), *document.notes)
    count(suite)
    return suite


def _suite(key: str, items: tuple[Item, ...]) -> ET.Element:
    seconds = sum(item.seconds or 0 for item in items)
    suite = ET.Element("testsuite", name=clean(key), time=f"{seconds:.3f}")
    for item in items:
        given = {"name": clean(item.id), "classname": clean(key), "time": f"{item.seconds or 0:.3f}"}
        _judge(ET.SubElement(suite, "testcase", given), item)
    count(suite)
    return suite


def _judge(case: ET.Element, item: Item) -> None:
    shown = state(item)
    words = filter(None, (item.message, item.hint))
    if shown in _FAILURES:
        add(case, "failure", str(shown), *words)
    elif shown is ShownState.ERROR:
        add(case, "error", str(shown), *words)
    elif shown is ShownState.SKIP:
        skip(case, item.message)
    tell(case, *_lines(item))


def _lines(item: Item) -> Iterator[str]:
    yield f"{item.verdict}: {item.title}"
    yield item.message
    if item.override is not None:
        yield f"OVERRIDDEN by {item.override.by}: {item.override.reason}"
    yield from (f"{finding.verdict} {finding.code}: {finding.message}" for finding in item.findings)
    yield from map(evidence_words, item.evidence)


def _left_out(document: Document) -> ET.Element:
    suite = ET.Element("testsuite", name="left out", time="0")
    for item in document.left_out:
        case = ET.SubElement(suite, "testcase", name=clean(item.what), classname="left out", time="0")
        skip(case, item.why)
    count(suite)
    return suite


MAX_BYTES = 30_000_000
MAX_PIXELS = 60_000_000
"""Of a file that is looked at at all."""
PLAIN_BYTES = 400_000
SIDE = 1400
"""A picture of at most so many bytes, and pixels each way, is shown as it is; a larger one is made smaller."""
ALL_BYTES = 12_000_000
"""Of all pictures of a page together; the rest is named."""
_QUALITY = 78
_MEDIA = {"JPEG": "image/jpeg", "PNG": "image/png", "GIF": "image/gif", "WEBP": "image/webp"}
_BESIDE = frozenset({"exif", "xmp", "photoshop", "comment", "XML:com.adobe.xmp", "Raw profile type exif"})
"""What Pillow calls the places in which a camera writes more than the picture."""


@dataclass(frozen=True, slots=True)
class Photo:
    """A picture as a page shows it."""

    media: str
    data: bytes
    width: int
    height: int
    reduced: bool


@dataclass(frozen=True, slots=True)
class Attached:
    """A file of evidence."""

    name: str
    words: str
    """What is to be known of it, its hash above all."""
    photo: Photo | None
    amiss: bool = False
    """The file is gone, or is another one than the document says."""


def attached(document: Document, files: Mapping[str, bytes]) -> dict[tuple[str, str | None], Attached]:
    """Every file that the document names, by its name and SHA-256, in the order of the document."""
    values: dict[tuple[str, str | None], Attached] = {}
    left = ALL_BYTES
    for evidence in (entry for item in document.items for entry in item.evidence):
        if evidence.file is not None and (evidence.file, evidence.sha256) not in values:
            picture = _attached(evidence.file, evidence, files.get(evidence.file), left)
            left -= len(picture.photo.data) if picture.photo is not None else 0
            values[evidence.file, evidence.sha256] = picture
    return values


def _attached(name: str, evidence: Evidence, data: bytes | None, left: int) -> Attached:
    digest = f"SHA-256 {evidence.sha256}" if evidence.sha256 is not None else "without a SHA-256"
    if data is None:
        return Attached(name, f"{digest}; the file is not beside this document", None, amiss=True)
    found = hashlib.sha256(data).hexdigest()
    if evidence.sha256 is not None and evidence.sha256 != found:
        return Attached(name, f"{digest}; the file there is ANOTHER ONE, with {found}", None, amiss=True)
    photo = _photo(data)
    if photo is not None and len(photo.data) > left:
        return Attached(name, f"{digest}; not shown, there are too many pictures", None)
    smaller = "; shown smaller than it is" if photo is not None and photo.reduced else ""
    return Attached(name, f"{digest}; {len(data)} bytes{smaller}", photo)


def _photo(data: bytes) -> Photo | None:
    """The picture; None for whatever is none, is damaged, or is too large to be looked at."""
    if len(data) > MAX_BYTES:
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # its size is looked at below, and what is odd inside is not ours to mend
            with Image.open(io.BytesIO(data), formats=tuple(_MEDIA)) as image:
                return _photo_of(image, data) if image.width * image.height <= MAX_PIXELS else None
    except Exception:  # noqa: BLE001 - Pillow raises all sorts for damaged files; such a file is named like any other
        return None


def _photo_of(image: Image.Image, data: bytes) -> Photo:
    # A book of an earlier release has photos as the telephone made them, with the place where it stood.
    bare = not image.getexif() and _BESIDE.isdisjoint(image.info)
    small = len(data) <= PLAIN_BYTES and max(image.size) <= SIDE
    if small and bare and image.format in {"JPEG", "PNG"}:
        image.load()
        return Photo(_MEDIA[image.format], data, *image.size, reduced=False)
    whole = sorted(image.size)
    image.draft("RGB", (SIDE, SIDE))
    turned = ImageOps.exif_transpose(image).convert("RGB")
    turned.info.clear()  # a comment would be written again
    turned.thumbnail((SIDE, SIDE))
    kept = io.BytesIO()
    turned.save(kept, "JPEG", quality=_QUALITY)
    return Photo(_MEDIA["JPEG"], kept.getvalue(), *turned.size, reduced=sorted(turned.size) != whole)


def html(document: Document, files: Mapping[str, bytes]) -> bytes:
    """The page, the same for the same document and files."""
    return page(
        _environment(),
        "page.html.j2",
        _style(),
        document=document,
        # Made by ElementTree, which escapes.
        svg=Markup(drawing_svg(document) + drawing_svg(document, wide=True)),  # noqa: S704
        heading=_texts.heading(document),
        name=_texts.name_of_page(document),
        zone=document.time_zone,
        signed=signed(document),
        grid=grid(document),
        headline=headline(document),
        counts=counts(document.items),
        scope=scope(document),
        anchors={id(item): f"i{number}" for number, item in enumerate(document.items, start=1)},
        first=to_look_at(document),
        overridden=[item for item in document.items if item.override is not None],
        unsettled=[item for item in document.items if state(item) in {ShownState.OPEN, ShownState.INCONCLUSIVE}],
        attached=attached(document, files),
    )


@cache
def _style() -> str:
    return _environment().get_template("style.css.j2").render(light=_classes(TINTS), dark=_classes(DARK))


def _classes(tints: Mapping[ShownState | None, Any]) -> dict[str, Any]:
    return {css_class(item): tint for item, tint in tints.items()}


@cache
def _environment() -> Environment:
    made = page_environment("atlantis_netcfg.checklist.report")
    made.filters.update(title_of=title, css=css_class, data_uri=_data_uri, tr=translate, say=_message, code=_with_code)
    made.filters.update(item_title=lambda item: _with_code(_texts.item_title(item)))
    made.globals.update(
        state=state,
        symbols=SYMBOLS,
        ident=id,
        evidence_groups=evidence_groups,
        circumstances=circumstances,
        text=_texts.PageText,
        subtitle=_texts.subtitle,
        also=_texts.also,
        differs=_texts.differs,
        was=_texts.was,
        of_integration=_texts.of_integration,
        photo=_texts.photo,
        overridden_by=_texts.overridden_by,
        was_green=_texts.was_green,
        time=time_text,
        translate=translate,
    )
    return made


def _message(message: str) -> Markup:
    """A message in the language of the page, with its code shown as code."""
    return _with_code(translate(message))


def _with_code(text: str) -> Markup:
    shapes = {False: Markup("{}"), True: Markup("<code>{}</code>")}
    return Markup().join(shapes[is_code].format(clean(piece)) for piece, is_code in coded(text))


def _data_uri(photo: Photo) -> str:
    return f"data:{photo.media};base64,{base64.b64encode(photo.data).decode()}"


def pages(document: Document, files: Mapping[str, bytes]) -> Mapping[str, bytes]:
    """Make `report.html`, `report.pdf` and `junit.xml`; `files` are those that evidence names, by that name.

    They are the same bytes for the same document and files, as long as the libraries that write them are.
    """
    # fpdf2 and Jinja take half a second to import, and every probe imports this package.
    from atlantis_netcfg.checklist.report._pdf import pdf  # noqa: PLC0415 - see above

    return {"report.html": html(document, files), "report.pdf": pdf(document, files), "junit.xml": junit(document)}
