"""Ethernet: a vehicle or its operator's computer on the site's cable, and a location's cables; our own column.

The ROV joins through its HMI computer, by cable (report 2.2.2). Loss and round trip are measured between hosts, the
network card that answers is compared with the declared one, and the router's port tells link, rate and errors.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes._reserved import reserved_mac
from atlantis_netcfg.checklist.probes.bearer_probe import link_steps
from atlantis_netcfg.checklist.probes.ethernet._cabled import CabledProbe
from atlantis_netcfg.checklist.probes.step import Step
from atlantis_netcfg.checklist.report import Kind, Phase
from atlantis_netcfg.declaration.model import BearerKind

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.probes.cell import Cell
    from atlantis_netcfg.declaration.model import EthernetEndpoint

__all__ = ["CabledProbe", "steps"]


def steps(cell: Cell) -> tuple[Step, ...]:
    """Give the cables that lead away from a location, and the row's own cable where it is declared."""
    links = link_steps(
        cell,
        BearerKind.ETHERNET,
        lambda bearer: f"Cable {bearer.name} of {cell.name} carries traffic",
    )
    endpoint = cell.endpoints.ethernet
    if endpoint is not None:
        return (*links, _own(cell, endpoint, "own" if links else ""))
    return links or (_by_a_person(cell),)


def _own(cell: Cell, endpoint: EthernetEndpoint, name: str) -> Step:
    router = cell.router
    seen_by = endpoint.seen_by or (router.name if router is not None else None)
    probe = CabledProbe(
        name=cell.name,
        place=cell.place(endpoint.seen_from),
        endpoint=endpoint,
        address=cell.address(endpoint.address),
        mac=reserved_mac(cell, endpoint.mac),
        router=seen_by if endpoint.router_port is not None else None,
    )
    return Step(
        name=name,
        title=f"{cell.name} answers on the site's cable without loss",
        kind=Kind.AUTOMATIC,
        phase=Phase.BENCH,
        probe=probe,
        concerns=() if seen_by is None else (seen_by,),
    )


def _by_a_person(cell: Cell) -> Step:
    return Step(
        name="",
        title=f"Ethernet of {cell.name} works",
        kind=Kind.PERSON,
        phase=Phase.BENCH,
        do=f"Plug {cell.name} into a LAN port of the site, and ping the gateway from it twenty times.",
        look_for="The lamps of both ends are lit, and all pings are answered.",
    )
