"""The shipped inventory's routers as views and texts."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from atlantis_netcfg.inventory import load
from atlantis_netcfg.routeros import rsc
from atlantis_netcfg.routeros.render import RouterView, router, router_view
from atlantis_netcfg.routeros.rsc import Export

SITES = ("coastal", "te4sea")


@dataclass(frozen=True)
class Rendered:
    view: RouterView
    export: Export


@cache
def rendered(site: str) -> Rendered:
    declaration = load(Path(__file__).parents[4] / "inventory")
    host = declaration.hosts[f"{site}-router"]
    return Rendered(router_view(declaration, host), rsc.parse(router(declaration, host), host.name))
