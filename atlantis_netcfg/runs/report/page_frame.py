"""HTML pages in one design: a frame and a style sheet for all, escaped, self-contained, without external requests."""

from __future__ import annotations

import base64
import hashlib
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Final

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

from atlantis_netcfg.core import language
from atlantis_netcfg.core.language import Language, translate
from atlantis_netcfg.core.printable import split_code
from atlantis_netcfg.runs.report import signs
from atlantis_netcfg.runs.report.drift import clean

if TYPE_CHECKING:
    from collections.abc import Mapping

_UNREAD: Final = "No native speaker has read this translation yet. What was signed is in English."


@dataclass(frozen=True, slots=True)
class PageVerdict:
    """Verdict of a page: a sign and a colour, always with a word."""

    state: signs.ShownState
    word: str
    text: str


@dataclass(frozen=True, slots=True)
class PageHeader:
    """Beginning of every page, in English; the frame translates it."""

    heading: str
    subtitle: str = ""
    """Identity and time."""
    rehearsal: str = ""
    """Notice that no real device was contacted; empty for a real run."""
    verdict: PageVerdict | None = None
    title: str = ""
    """Title of the browser's window, if it is not the heading."""


def environment(package: str = "atlantis_netcfg.runs.report") -> Environment:
    """Return the Jinja environment for a package's page templates; the caller adds filters and globals."""
    result = Environment(
        loader=ChoiceLoader([PackageLoader(name) for name in dict.fromkeys((package, "atlantis_netcfg.runs.report"))]),
        autoescape=select_autoescape(enabled_extensions=("html.j2",)),
        undefined=StrictUndefined,
        finalize=_written_out,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    result.filters.update(
        translate=translate, say=lambda text: with_code(translate(text)), code=with_code, css=signs.css_class
    )
    result.globals.update(signs=signs.SYMBOLS)
    return result


def page(environment: Environment, template: str, header: PageHeader, **values: Any) -> bytes:  # noqa: ANN401 - its words
    """Render a page, which extends `frame.html.j2`; its content security policy allows the common style only."""
    style = _style()
    context = {"language": language_tag(), "unread": unread(), "header": header, **values}
    text = environment.get_template(template).render(
        style=Markup(style),  # noqa: S704 - a template of ours without anything from outside
        style_hash=base64.b64encode(hashlib.sha256(style.encode()).digest()).decode(),
        **context,
    )
    return text.encode()  # `clean` leaves no half of a surrogate pair


@cache
def _style() -> str:
    template = environment().get_template("pages.css.j2")
    return template.render(light=_classes(signs.TINTS), dark=_classes(signs.DARK))


def _classes(tints: Mapping[signs.ShownState | None, signs.Tint]) -> dict[str, signs.Tint]:
    return {signs.css_class(item): tint for item, tint in tints.items()}


def with_code(text: str) -> Markup:
    """Mark text between back-ticks as code."""
    shapes = {False: Markup("{}"), True: Markup("<code>{}</code>")}
    return Markup().join(shapes[is_code].format(clean(piece)) for piece, is_code in split_code(text))


def language_tag() -> str:
    """Return the language tag of the page's own text for HTML and PDF (BCP 47)."""
    return {Language.ENGLISH: "en", Language.PORTUGUESE: "pt-PT"}[language.current()]


def unread() -> str:
    """Return the note that no native speaker has checked the translation; empty in English."""
    return "" if language.current() is Language.ENGLISH else translate(_UNREAD)


def _written_out(value: Any) -> Any:  # noqa: ANN401 - whatever a template prints
    """Write out invisible characters in everything that is printed."""
    return value if isinstance(value, Markup) or not isinstance(value, str) else clean(value)
