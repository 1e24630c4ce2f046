"""How every page of ours is made of templates: escaped, complete, without text that hides, and without a request."""

from __future__ import annotations

import base64
import hashlib
from typing import Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

from atlantis_netcfg.core import language
from atlantis_netcfg.core.language import Language, translate
from atlantis_netcfg.runs.report.drift import clean

_UNREAD: Final = "No native speaker has read this translation yet. What was signed is in English."


def page_environment(package: str) -> Environment:
    """The templates of a package, for pages; whoever makes one adds its filters and globals."""
    result = Environment(
        loader=PackageLoader(package),
        autoescape=select_autoescape(enabled_extensions=("html.j2",)),
        undefined=StrictUndefined,
        finalize=_written_out,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    result.filters.update(translate=translate)
    return result


def page(environment: Environment, template: str, style: str, **values: Any) -> bytes:  # noqa: ANN401 - its words
    """Render a page that holds its own style, whose hash is the only one that its policy lets a browser apply."""
    text = environment.get_template(template).render(
        style=Markup(style),  # noqa: S704 - a template of ours without anything from outside
        style_hash=base64.b64encode(hashlib.sha256(style.encode()).digest()).decode(),
        language=page_language(),
        unread=unread(),
        **values,
    )
    return text.encode()  # `clean` leaves no half of a surrogate pair


def page_language() -> str:
    """The language of the page's own words, as HTML and PDF name it (BCP 47)."""
    return {Language.ENGLISH: "en", Language.PORTUGUESE: "pt-PT"}[language.current()]


def unread() -> str:
    """That the translation was not read by a native speaker; empty in English."""
    return "" if language.current() is Language.ENGLISH else translate(_UNREAD)


def _written_out(value: Any) -> Any:  # noqa: ANN401 - whatever a template prints
    """Write out what cannot be seen, in all that is printed."""
    return value if isinstance(value, Markup) or not isinstance(value, str) else clean(value)
