"""The checklist as one page that needs nothing else: no script, no request, pictures inside."""

from __future__ import annotations

import base64
import hashlib
from functools import cache
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

from atlantis_netcfg.checklist.report._colours import DARK, TINTS, css_class
from atlantis_netcfg.checklist.report._grid import grid
from atlantis_netcfg.checklist.report._photos import attached
from atlantis_netcfg.checklist.report._states import SYMBOLS, State, state
from atlantis_netcfg.checklist.report._svg import drawing_svg
from atlantis_netcfg.checklist.report._words import clock, counts, evidence_groups, first, headline, scope, title
from atlantis_netcfg.report._xml import clean

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.checklist.report._photos import Photo
    from atlantis_netcfg.checklist.report.document import Document


def html(document: Document, files: Mapping[str, bytes]) -> bytes:
    """The page, the same for the same document and files."""
    style = _style()
    text = (
        _environment()
        .get_template("page.html.j2")
        .render(
            document=document,
            style=Markup(style),  # noqa: S704 - a template of ours without anything from outside
            style_hash=base64.b64encode(hashlib.sha256(style.encode()).digest()).decode(),
            svg=Markup(drawing_svg(document)),  # noqa: S704 - made by ElementTree, which escapes
            grid=grid(document),
            headline=headline(document),
            counts=counts(document.items),
            scope=scope(document),
            anchors={id(item): f"i{number}" for number, item in enumerate(document.items, start=1)},
            first=first(document),
            overridden=[item for item in document.items if item.override is not None],
            unsettled=[item for item in document.items if state(item) in {State.OPEN, State.INCONCLUSIVE}],
            attached=attached(document, files),
        )
    )
    return text.encode()  # `visible` leaves no half of a surrogate pair


@cache
def _style() -> str:
    return _environment().get_template("style.css.j2").render(light=_classes(TINTS), dark=_classes(DARK))


def _classes(tints: Mapping[State | None, Any]) -> dict[str, Any]:
    return {css_class(item): tint for item, tint in tints.items()}


@cache
def _environment() -> Environment:
    made = Environment(
        loader=PackageLoader("atlantis_netcfg.checklist.report"),
        autoescape=select_autoescape(enabled_extensions=("html.j2",)),
        undefined=StrictUndefined,
        finalize=_shown,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters.update(title_of=title, clock=clock, css=css_class, data_uri=_data_uri)
    made.globals.update(state=state, symbols=SYMBOLS, ident=id, evidence_groups=evidence_groups)
    return made


def _shown(value: Any) -> Any:  # noqa: ANN401 - whatever a template prints
    """Write out what cannot be seen, in all that is printed."""
    if isinstance(value, Markup) or not isinstance(value, str):
        return value
    return clean(value)


def _data_uri(photo: Photo) -> str:
    return f"data:{photo.media};base64,{base64.b64encode(photo.data).decode()}"
