"""Wi-Fi: the vehicle's own, as access point or as station, and the site's bridge.

An AUV carries an access point that is usable on the surface only (report 2.2.2), and the gateway's radio is its client:
`iw` on the gateway tells the association, how it is heard and at which rate. ASV and UAV are stations of the site: its
access point tells, where that is a RouterOS device. Loss and round trip are measured between hosts in either case; the
bridge of a location is what `provision links` says of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes._reserved import reserved_mac
from atlantis_netcfg.checklist.probes.bearer_probe import link_steps
from atlantis_netcfg.checklist.probes.step import Step
from atlantis_netcfg.checklist.probes.wifi._associated import AssociatedProbe
from atlantis_netcfg.checklist.probes.wifi._registered import RegisteredProbe
from atlantis_netcfg.checklist.report import Kind, Phase
from atlantis_netcfg.declaration.model import BearerKind, WifiRole

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.probes.cell import Cell
    from atlantis_netcfg.checklist.probes.step import Probe
    from atlantis_netcfg.declaration.model import WifiEndpoint

__all__ = ["AssociatedProbe", "RegisteredProbe", "steps"]


def steps(cell: Cell) -> tuple[Step, ...]:
    """Give the bridges of a location, and the row's own Wi-Fi where it is declared."""
    bridges = link_steps(
        cell,
        BearerKind.WIFI_PTP,
        lambda bearer: f"Wi-Fi bridge {bearer.name} of {cell.name} carries traffic, and both ends hear each other well",
    )
    endpoint = cell.endpoints.wifi
    if endpoint is not None:
        return (*bridges, _own(cell, endpoint, "own" if bridges else ""))
    return bridges or (() if cell.vehicle is not None else (_by_a_person(cell),))


def _own(cell: Cell, endpoint: WifiEndpoint, name: str) -> Step:
    probe = _probe(cell, endpoint)
    gateway = cell.gateway
    concerns = (endpoint.seen_by, gateway.name if gateway is not None else None)
    return Step(
        name=name,
        title=_title(cell, endpoint),
        kind=Kind.AUTOMATIC,
        phase=Phase.BENCH,
        probe=probe,
        concerns=tuple(concern for concern in concerns if concern is not None),
    )


def _title(cell: Cell, endpoint: WifiEndpoint) -> str:
    if endpoint.role is WifiRole.ACCESS_POINT:
        return f"Access point of {cell.name} is heard well, and answers without loss"
    if endpoint.seen_by is None:
        return f"{cell.name} answers over the Wi-Fi of the site without loss"
    return f"{cell.name} is registered at {endpoint.seen_by}, is heard well, and answers without loss"


def _probe(cell: Cell, endpoint: WifiEndpoint) -> Probe:
    place, address = cell.place(endpoint.seen_from), cell.address(endpoint.address)
    if endpoint.role is WifiRole.ACCESS_POINT:
        return AssociatedProbe(cell.name, place, endpoint, address, cell.declaration.pilot.country)
    return RegisteredProbe(cell.name, place, endpoint, address, reserved_mac(cell, endpoint.mac))


def _by_a_person(cell: Cell) -> Step:
    return Step(
        name="",
        title=f"Wi-Fi of {cell.name} works",
        kind=Kind.PERSON,
        phase=Phase.BENCH,
        do=f"Connect a computer to the Wi-Fi of {cell.name} where the vehicles will be, and look at its level.",
        look_for="It connects, hears the access point with -35 to -75 dBm, and pings the gateway without loss.",
    )
