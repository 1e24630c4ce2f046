"""Everything that the templates can say: rendered with every branch taken, and read off their sources."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

from spoken import Said, lines
from trees import ROOT, TREES

from atlantis_netcfg.render import environment, router_view, template_folder
from atlantis_netcfg.site import load

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.render import RouterView

_INCLUDE = re.compile(r"\{% include \"([^\"]+)\" %\}")
_STATEMENT = re.compile(r"\{%-?.*?-?%\}", re.DOTALL)
_COMMENT = re.compile(r"\{#.*?#\}", re.DOTALL)
_VALUE = re.compile(r"\{\{.*?\}\}", re.DOTALL)


def routers() -> Iterator[RouterView]:
    """Yield the views of all routers of the shipped inventory, and each with single things left out or added."""
    declaration = load(ROOT / "inventory")
    for host in declaration.hosts.values():
        if host.device.kind == "router":
            view = router_view(declaration, host)
            yield view
            yield from _variants(view)


def _variants(view: RouterView) -> Iterator[RouterView]:
    yield replace(view, tunnel=None)
    yield replace(view, remotes=(), forwards=(), served=(), uplinks=view.uplinks[:1])
    yield replace(view, uplinks=tuple(replace(link, canaries=(), targets=()) for link in view.uplinks))
    yield replace(view, server_in_lan=not view.server_in_lan)
    yield replace(view, ports=tuple(replace(port, poe_out=None, poe_priority=None) for port in view.ports))
    yield replace(view, ports=tuple(replace(port, poe_out="auto-on", poe_priority=10) for port in view.ports))


@cache
def rendered() -> tuple[str, ...]:
    """Every text that can come out; a new kind of template has to be rendered here."""
    template = environment().get_template("routeros/router.rsc.j2")
    return tuple(template.render(router=view) for view in routers())


def sources() -> dict[str, str]:
    """Return every template that is rendered by itself, with what it includes in its place."""
    tops = sorted((template_folder() / "routeros").glob("*.j2"))
    return {path.name: _whole(path.read_text("utf-8")) for path in tops}


def left_out() -> set[str]:
    """Return the names of parts that no template includes."""
    folder = template_folder()
    named = {name for path in folder.rglob("*.j2") for name in _INCLUDE.findall(path.read_text("utf-8"))}
    parts = {path.relative_to(folder).as_posix() for path in (folder / "routeros").glob("*/**/*.j2")}
    return parts - named


def _whole(source: str) -> str:
    return _INCLUDE.sub(lambda found: _whole((template_folder() / found[1]).read_text("utf-8")), source)


def bare(source: str) -> str:
    """Return a template as if every branch were taken once, with a word in place of every value."""
    text = _COMMENT.sub("", source)
    return _VALUE.sub("X", _STATEMENT.sub("", text))


def words(texts: tuple[str, ...]) -> frozenset[tuple[str, str, str]]:
    """Return menu, command and argument of everything in the texts, as the newest tree reads them."""
    return frozenset(cell for text in texts for said in lines(text, TREES[-1]) for cell in cells(said))


def cells(said: Said) -> Iterator[tuple[str, str, str]]:
    yield said.menu, said.command, ""
    for name in said.names:
        yield said.menu, said.command, name
