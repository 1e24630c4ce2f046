"""HTML pages from templates: escaped, self-contained, without hidden text or external requests."""

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
    """Return the Jinja environment for a package's page templates; the caller adds filters and globals."""
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
    """Render a page with its own style, the only one that its content security policy allows (by hash)."""
    text = environment.get_template(template).render(
        style=Markup(style),  # noqa: S704 - a template of ours without anything from outside
        style_hash=base64.b64encode(hashlib.sha256(style.encode()).digest()).decode(),
        language=page_language(),
        unread=unread(),
        **values,
    )
    return text.encode()  # `clean` leaves no half of a surrogate pair


def page_language() -> str:
    """Return the language tag of the page's own text for HTML and PDF (BCP 47)."""
    return {Language.ENGLISH: "en", Language.PORTUGUESE: "pt-PT"}[language.current()]


def unread() -> str:
    """Return the note that no native speaker has checked the translation; empty in English."""
    return "" if language.current() is Language.ENGLISH else translate(_UNREAD)


def _written_out(value: Any) -> Any:  # noqa: ANN401 - whatever a template prints
    """Write out invisible characters in everything that is printed."""
    return value if isinstance(value, Markup) or not isinstance(value, str) else clean(value)
