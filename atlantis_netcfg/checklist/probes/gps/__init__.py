"""GPS: whether a vehicle or a location knows where it is, now, and in the place of the test.

A reader for each source (gpsd, NMEA 0183 over TCP or a serial port, a RouterOS device) makes the same record of what it
hears, and one judge looks at it: no data, data without a fix, a stale fix and a fix are four states and stay apart. A
passing receiver reports several times in a row from inside the site's geofence, with the time of the listening clock
and, where the vehicle flies, in three dimensions. Where no endpoint is declared, a person looks.

How it could be fooled, and what stops it, stands in docs/probes.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes.gps.probe import Nowhere, RouterosGps, StreamGps
from atlantis_netcfg.checklist.probes.gps.record import Wanted
from atlantis_netcfg.checklist.probes.requests import Place
from atlantis_netcfg.checklist.probes.step import Step
from atlantis_netcfg.checklist.report import Kind, Phase
from atlantis_netcfg.declaration.model import GpsDriver, VehicleKind

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.probes.cell import Cell
    from atlantis_netcfg.checklist.probes.step import Probe
    from atlantis_netcfg.declaration.model import GpsEndpoint

__all__ = ["GPSD_PORT", "NMEA_PORT", "RouterosGps", "StreamGps", "Wanted", "steps"]

GPSD_PORT = 2947
"""IANA: gpsd."""
NMEA_PORT = 10110
"""IANA: nmea-0183."""


def steps(cell: Cell) -> tuple[Step, ...]:
    """Give the one step of a cell: a probe where an endpoint is declared, else a person's."""
    endpoint = cell.endpoints.gps
    if endpoint is None:
        return (_by_a_person(cell),)
    return (
        Step(
            name="",
            title=f"{cell.name} knows where it is",
            kind=Kind.AUTOMATIC,
            phase=Phase.QUAY,
            probe=_probe(cell, endpoint),
            concerns=_concerns(cell, endpoint),
        ),
    )


def _by_a_person(cell: Cell) -> Step:
    dimensions = "3D" if _flies(cell) else "2D or 3D"
    return Step(
        name="",
        title=f"{cell.name} knows where it is",
        kind=Kind.PERSON,
        phase=Phase.QUAY,
        do=f"Bring {cell.name} under an open sky, and watch its position in its operator's program for a minute.",
        look_for=f"A {dimensions} fix that stays, where it is on the map to a few metres, at the right time (UTC).",
    )


def _flies(cell: Cell) -> bool:
    return cell.vehicle is not None and cell.declaration.vehicles[cell.vehicle].kind is VehicleKind.UAV


def _probe(cell: Cell, endpoint: GpsEndpoint) -> Probe:
    if endpoint.driver is GpsDriver.ROUTEROS:
        host = endpoint.seen_by or (cell.router.name if cell.router else None)
        if host is None:
            return Nowhere(cell.name)
        return RouterosGps(_wanted(cell, endpoint, f"GPS of {host}", host, host), host)
    place = cell.place(endpoint.seen_from)
    stands = _name(cell, place)
    if endpoint.driver is GpsDriver.NMEA_SERIAL:
        end = f"{endpoint.device} of {stands}"
        expected = _wanted(cell, endpoint, f"NMEA from {end}", end, stands)
        return StreamGps(expected, place, device=endpoint.device or "", baud=endpoint.baud)
    address = cell.address(endpoint.address)
    if address is None:
        return Nowhere(cell.name)
    port = endpoint.port or (GPSD_PORT if endpoint.driver is GpsDriver.GPSD else NMEA_PORT)
    end = f"{address}:{port}"
    source = f"gpsd at {end}" if endpoint.driver is GpsDriver.GPSD else f"NMEA from {end}"
    return StreamGps(_wanted(cell, endpoint, source, end, stands), place, address=address, port=port)


def _wanted(cell: Cell, endpoint: GpsEndpoint, source: str, end: str, place: str) -> Wanted:
    return Wanted(
        name=cell.name,
        driver=endpoint.driver,
        source=source,
        end=end,
        place=place,
        fence=cell.declared.checklist.geofence,
        three=_flies(cell),
        clear_sky=endpoint.clear_sky,
        reports=endpoint.reports,
        max_age_s=endpoint.max_age_s,
    )


def _name(cell: Cell, place: Place) -> str:
    return cell.gateway.name if place is Place.GATEWAY and cell.gateway is not None else "this computer"


def _concerns(cell: Cell, endpoint: GpsEndpoint) -> tuple[str, ...]:
    if endpoint.driver is GpsDriver.ROUTEROS:
        return tuple(filter(None, (endpoint.seen_by or (cell.router.name if cell.router else None),)))
    stands = _name(cell, cell.place(endpoint.seen_from))
    return () if stands == "this computer" else (stands,)
