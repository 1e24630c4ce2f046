"""Our Jinja environment: undefined names are errors, and filters write values the way RouterOS reads them."""

from __future__ import annotations

from datetime import timedelta
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from atlantis_netcfg.paths import checkout
from atlantis_netcfg.rsc import quote

if TYPE_CHECKING:
    from atlantis_netcfg.secret import Secret

__all__ = ["MARK", "duration", "environment", "mark", "template_folder"]

MARK = "atlantis: "
"""Opens the comment of every row that is ours."""

_PACKAGE = Path(__file__).resolve().parent.parent
_UNITS = (("w", 7 * 24 * 3600), ("d", 24 * 3600), ("h", 3600), ("m", 60), ("s", 1))


def template_folder() -> Path:
    """`templates/` of the checkout; in an installed wheel the copy inside the package."""
    beside = checkout() / "templates"
    return beside if (beside / "routeros").is_dir() else _PACKAGE / "templates"


def environment(templates: Path | None = None) -> Environment:
    """The environment, in which a template is compiled once; `templates` overrides where it looks."""
    return _made(templates or template_folder())


@cache
def _made(folder: Path) -> Environment:
    made = Environment(
        loader=FileSystemLoader(folder),
        undefined=StrictUndefined,
        autoescape=False,  # noqa: S701 - router text, not HTML: `&` must stay `&`; the filter `quote` does RouterOS' escaping
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    made.filters.update(quote=_quoted, mark=mark, duration=duration, reveal=_reveal, yesno=_yesno)
    return made


def mark(what: str) -> str:
    """Write the comment that marks a row as ours and says what it is for."""
    return quote(MARK + what)


def duration(seconds: float) -> str:
    """Write a time interval as RouterOS prints it: `1h30m`, `1d`, `500ms`."""
    milliseconds = round(timedelta(seconds=seconds) / timedelta(milliseconds=1))
    left, below = divmod(milliseconds, 1000)
    text = ""
    for unit, size in _UNITS:
        count, left = divmod(left, size)
        text += f"{count}{unit}" if count else ""
    return text + (f"{below}ms" if below else "") or "0s"


def _quoted(value: object) -> str:
    return quote(str(value))


def _reveal(secret: Secret) -> str:
    return secret.reveal()


def _yesno(value: bool) -> str:  # noqa: FBT001 - a filter's value
    return "yes" if value else "no"
