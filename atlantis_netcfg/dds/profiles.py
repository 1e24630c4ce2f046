"""The files that a participant gets: a profile for each implementation of DDS, and the environment of its processes."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from jinja2 import Environment, FileSystemLoader, StrictUndefined, select_autoescape

from atlantis_netcfg.render import compiled, template_folder

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.dds.view import ProfileView

__all__ = ["FOLDER", "profiles"]

FOLDER = "/etc/atlantis/dds"
"""Where the files stand on the computer; each link has a folder of its own below."""


def profiles(view: ProfileView, templates: Path | None = None) -> dict[str, str]:
    """Name below `FOLDER` -> text, of one link; `templates` overrides where the templates are looked for."""
    files = {"cyclonedds.xml": "cyclonedds.xml.j2"}
    if view.release.fast_dds is not None:
        files["fastdds.xml"] = "fastdds.xml.j2"
    files["ros.env"] = "ros.env.j2"
    environment = _environment(templates or template_folder())
    return {
        f"{view.bearer}/{name}": environment.get_template(f"dds/{template}").render(
            profile=view, folder=f"{FOLDER}/{view.bearer}"
        )
        for name, template in files.items()
    }


@cache
def _environment(templates: Path) -> Environment:
    """Undefined names are errors; in XML values are escaped."""
    return Environment(
        loader=FileSystemLoader(templates),
        bytecode_cache=compiled(__file__),
        undefined=StrictUndefined,
        autoescape=select_autoescape(enabled_extensions=("xml.j2",)),
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
