"""Pages stored with a signed document; the HTML page is self-contained: no script, no request, embedded images."""

from __future__ import annotations

import base64
from functools import cache
from typing import TYPE_CHECKING

from markupsafe import Markup

from atlantis_netcfg.checklist.report import _shapes, _texts, _words
from atlantis_netcfg.checklist.report._junit import junit
from atlantis_netcfg.checklist.report._photos import find_attachments
from atlantis_netcfg.checklist.report._svg import drawing_svg
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.times import time_text
from atlantis_netcfg.runs.report import page_frame, signs

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jinja2 import Environment

    from atlantis_netcfg.checklist.report._photos import Photo
    from atlantis_netcfg.checklist.report.document import Document


def html(document: Document, files: Mapping[str, bytes]) -> bytes:
    """Return the page; the same document and files always give the same bytes."""
    return page_frame.page(
        _environment(),
        "page.html.j2",
        _header(document),
        document=document,
        # Made by ElementTree, which escapes.
        svg=Markup(drawing_svg(document) + drawing_svg(document, wide=True)),  # noqa: S704
        zone=document.time_zone,
        signed=_words.signature_line(document),
        grid=_shapes.grid(document),
        counts=_words.counts(document.items),
        scope=_words.scope(document),
        anchors={id(item): f"i{number}" for number, item in enumerate(document.items, start=1)},
        first=_words.to_look_at(document),
        overridden=[item for item in document.items if item.override is not None],
        unsettled=[
            item
            for item in document.items
            if _shapes.state(item) in {signs.ShownState.OPEN, signs.ShownState.INCONCLUSIVE}
        ],
        attached=find_attachments(document, files),
    )


def _header(document: Document) -> page_frame.PageHeader:
    state, sentence = _words.headline(document)
    return page_frame.PageHeader(
        _texts.heading(document),
        _texts.subtitle(document),
        _texts.PageText.REHEARSAL if document.rehearsed else "",
        page_frame.PageVerdict(state, state, sentence),
        _texts.name_of_page(document),
    )


@cache
def _environment() -> Environment:
    result = page_frame.environment("atlantis_netcfg.checklist.report")
    result.filters.update(title_of=_words.title, data_uri=_data_uri, tr=translate)
    result.filters.update(item_title=lambda item: page_frame.with_code(_texts.item_title(item)))
    result.globals.update(
        state=_shapes.state,
        ident=id,
        evidence_groups=_words.evidence_groups,
        circumstances=_words.circumstances,
        text=_texts.PageText,
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
    return result


def _data_uri(photo: Photo) -> str:
    return f"data:{photo.media};base64,{base64.b64encode(photo.data).decode()}"


def pages(document: Document, files: Mapping[str, bytes]) -> Mapping[str, bytes]:
    """Build `report.html`, `report.pdf` and `junit.xml`; `files` are the evidence files by name.

    The bytes are reproducible as long as the versions of the libraries that write them do not change.
    """
    # fpdf2 and Jinja take half a second to import, and every probe imports this package.
    from atlantis_netcfg.checklist.report._pdf import pdf  # noqa: PLC0415 - see above

    return {"report.html": html(document, files), "report.pdf": pdf(document, files), "junit.xml": junit(document)}
