"""Pages stored with a signed document; the HTML page is self-contained: no script, no request, embedded images."""

from __future__ import annotations

import base64
from functools import cache
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from atlantis_netcfg.checklist.report import _shapes, _texts, _words
from atlantis_netcfg.checklist.report._junit import junit
from atlantis_netcfg.checklist.report._photos import find_attachments
from atlantis_netcfg.checklist.report._svg import drawing_svg
from atlantis_netcfg.checklist.report._texts import split_code
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.times import time_text
from atlantis_netcfg.runs.report.drift import clean
from atlantis_netcfg.runs.report.page import page, page_environment

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jinja2 import Environment

    from atlantis_netcfg.checklist.report._photos import Photo
    from atlantis_netcfg.checklist.report.document import Document


def html(document: Document, files: Mapping[str, bytes]) -> bytes:
    """Return the page; the same document and files always give the same bytes."""
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
        signed=_words.signature_line(document),
        grid=_shapes.grid(document),
        headline=_words.headline(document),
        counts=_words.counts(document.items),
        scope=_words.scope(document),
        anchors={id(item): f"i{number}" for number, item in enumerate(document.items, start=1)},
        first=_words.to_look_at(document),
        overridden=[item for item in document.items if item.override is not None],
        unsettled=[
            item
            for item in document.items
            if _shapes.state(item) in {_shapes.ShownState.OPEN, _shapes.ShownState.INCONCLUSIVE}
        ],
        attached=find_attachments(document, files),
    )


@cache
def _style() -> str:
    return (
        _environment().get_template("style.css.j2").render(light=_classes(_shapes.TINTS), dark=_classes(_shapes.DARK))
    )


def _classes(tints: Mapping[_shapes.ShownState | None, Any]) -> dict[str, Any]:
    return {_shapes.css_class(item): tint for item, tint in tints.items()}


@cache
def _environment() -> Environment:
    result = page_environment("atlantis_netcfg.checklist.report")
    result.filters.update(
        title_of=_words.title, css=_shapes.css_class, data_uri=_data_uri, tr=translate, say=_message, code=_with_code
    )
    result.filters.update(item_title=lambda item: _with_code(_texts.item_title(item)))
    result.globals.update(
        state=_shapes.state,
        symbols=_shapes.SYMBOLS,
        ident=id,
        evidence_groups=_words.evidence_groups,
        circumstances=_words.circumstances,
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
    return result


def _message(message: str) -> Markup:
    """Format a message in the language of the page, with code marked up as code."""
    return _with_code(translate(message))


def _with_code(text: str) -> Markup:
    shapes = {False: Markup("{}"), True: Markup("<code>{}</code>")}
    return Markup().join(shapes[is_code].format(clean(piece)) for piece, is_code in split_code(text))


def _data_uri(photo: Photo) -> str:
    return f"data:{photo.media};base64,{base64.b64encode(photo.data).decode()}"


def pages(document: Document, files: Mapping[str, bytes]) -> Mapping[str, bytes]:
    """Build `report.html`, `report.pdf` and `junit.xml`; `files` are the evidence files by name.

    The bytes are reproducible as long as the versions of the libraries that write them do not change.
    """
    # fpdf2 and Jinja take half a second to import, and every probe imports this package.
    from atlantis_netcfg.checklist.report._pdf import pdf  # noqa: PLC0415 - see above

    return {"report.html": html(document, files), "report.pdf": pdf(document, files), "junit.xml": junit(document)}
