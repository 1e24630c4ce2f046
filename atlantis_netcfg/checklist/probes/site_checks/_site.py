"""What the checks need to know of a site, and the questions that several of them ask."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

from atlantis_netcfg.bearers.query import Query
from atlantis_netcfg.checklist.probes.requests import Ask, Look, Place, Run
from atlantis_netcfg.checklist.probes.step import Step
from atlantis_netcfg.checklist.report import Kind, Phase
from atlantis_netcfg.declaration.model import AddressBy, Gateway, Router
from atlantis_netcfg.render import router_view

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.probes.cell import Cell
    from atlantis_netcfg.checklist.probes.step import Probe
    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.declaration.model import Site
    from atlantis_netcfg.render import RouterView

__all__ = ["Computer", "OwnSite", "ask", "by_hand", "look", "own_site", "run", "step"]


@dataclass(frozen=True, slots=True)
class Computer:
    """The gateway computer as it is declared."""

    name: str
    device: Gateway

    @property
    def interface(self) -> str:
        """Of the LAN: its name where it is declared, else the address that it has."""
        named = self.device.network.interface if self.device.network is not None else None
        if named is None and self.device.image is not None:
            named = self.device.image.interface
        return named or str(self.device.address)

    @property
    def leased(self) -> bool:
        """Whether a reservation of the LAN gives it its address."""
        return self.device.image is not None and self.device.image.address_by is AddressBy.DHCP


@dataclass(frozen=True, slots=True)
class OwnSite:
    """A site, with its router and its gateway computer."""

    declaration: Declaration
    name: str
    declared: Site
    router: Host | None
    view: RouterView | None
    """Of the router."""
    gateway: Computer | None

    @property
    def device(self) -> Router:
        """The router, where there is one."""
        assert self.router is not None  # noqa: S101 - steps are made for sites with a router
        return cast("Router", self.router.device)

    @property
    def hosts(self) -> tuple[str, ...]:
        """Whom the checks speak of."""
        return tuple(item.name for item in (self.router, self.gateway) if item is not None)


def own_site(cell: Cell) -> OwnSite:
    """Find router and gateway computer."""
    router, gateway = cell.router, cell.gateway
    return OwnSite(
        declaration=cell.declaration,
        name=cell.site,
        declared=cell.declared,
        router=router,
        view=None if router is None else router_view(cell.declaration, router),
        gateway=None if gateway is None else Computer(gateway.name, cast("Gateway", gateway.device)),
    )


def step(name: str, title: str, probe: Probe | None, concerns: tuple[str, ...] = (), unless: str = "") -> Step:
    """Make the step of a check by the tool; `unless` says that there is nothing to check at this site."""
    return Step(
        name=name,
        title=title,
        kind=Kind.AUTOMATIC,
        phase=Phase.BENCH,
        probe=None if unless else probe,
        unless=unless,
        concerns=concerns,
    )


def by_hand(name: str, title: str, do: str, look_for: str, concerns: tuple[str, ...]) -> Step:
    """Make the step of a check that no program can make at this site: it applies, so a person looks."""
    return Step(
        name=name,
        title=title,
        kind=Kind.PERSON,
        phase=Phase.BENCH,
        do=do,
        look_for=look_for,
        concerns=concerns,
    )


def ask(name: str, site: OwnSite, menu: str, *properties: str) -> tuple[Ask, ...]:
    """Ask the router for rows of a menu; nothing where the site has none."""
    if site.router is None:
        return ()
    return (Ask(name, site.router.name, Query(menu, "print", proplist=properties)),)


def run(name: str, site: OwnSite, command: str, within_s: float = 20.0) -> tuple[Run, ...]:
    """Run a program on the gateway computer; nothing where the site has none."""
    return (Run(name, Place.GATEWAY, tuple(command.split()), within_s),) if site.gateway is not None else ()


def look(site: OwnSite) -> tuple[Look, ...]:
    """How every bearer of the site is; `look` and its name are the question's."""
    return tuple(Look(f"look {bearer.name}", bearer.name) for bearer in site.declared.bearers) if site.router else ()
