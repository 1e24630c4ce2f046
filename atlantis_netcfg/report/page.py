"""How every page of ours is made of templates: escaped, complete, and without text that hides."""

from __future__ import annotations

from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

from atlantis_netcfg.report.drift import clean


def page_environment(package: str) -> Environment:
    """The templates of a package, for pages; whoever makes one adds its filters and globals."""
    return Environment(
        loader=PackageLoader(package),
        autoescape=select_autoescape(enabled_extensions=("html.j2",)),
        undefined=StrictUndefined,
        finalize=_written_out,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _written_out(value: Any) -> Any:  # noqa: ANN401 - whatever a template prints
    """Write out what cannot be seen, in all that is printed."""
    return value if isinstance(value, Markup) or not isinstance(value, str) else clean(value)
