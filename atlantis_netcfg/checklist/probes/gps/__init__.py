"""GPS: whether a vehicle or a location has a current position, in the area of the test.

A reader for each source (gpsd, NMEA 0183 over TCP or a serial port, a RouterOS device) builds the same record from the
received data, and one judge checks it: no data, data without a fix, a stale fix and a fix are four separate states. A
passing receiver reports several times in a row from inside the site's geofence, with the time of the listening clock
and, for a flying vehicle, in three dimensions. If the inventory has no endpoint, a person checks.

RouterOS: `/system/gps/monitor once` returns the latest position; there is none before it. Field names: Manual, GPS
(package `gps`). `data-age` exists from 7.1 on. Coordinates have the form of `coordinate-format`: decimal degrees, or a
letter with degrees, minutes and seconds; `none` is no position. The manual does not give the time zone of
`date-and-time`: UTC and that of the device's clock are accepted.

docs/engineers/probes.md describes how it could be deceived, and what prevents that.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.checklist.probes.gps import gpsd, nmea
from atlantis_netcfg.checklist.probes.gps.judge import evidence, judge
from atlantis_netcfg.checklist.probes.gps.record import GpsExpectation, Nature, Reception, Report, describe_trouble
from atlantis_netcfg.checklist.report import ItemKind, Phase
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.links import LinkFinding
from atlantis_netcfg.links.status import Query

if TYPE_CHECKING:
    from collections.abc import Mapping


__all__ = [
    "CLOCK_QUERY",
    "GPSD_PORT",
    "GPS_MONITOR",
    "GPS_SETTINGS",
    "NMEA_PORT",
    "GpsExpectation",
    "RouterosGps",
    "StreamGps",
    "read_monitor",
    "steps",
]


GPS_MONITOR = Query("/system/gps", "monitor", (("once", ""),))
GPS_SETTINGS = Query("/system/gps", "print")
CLOCK_QUERY = Query("/system/clock", "print")
_YES = {"yes": True, "true": True, "no": False, "false": False}
_QUALITY = {"6": Nature.DEAD_RECKONING, "7": Nature.MANUAL, "8": Nature.SIMULATED}
_TIMES = ("%Y-%m-%d %H:%M:%S", "%b/%d/%Y %H:%M:%S")
_SECONDS = {"w": 604_800.0, "d": 86_400.0, "h": 3600.0, "m": 60.0, "s": 1.0, "ms": 0.001}
_PART = r"(\d+(?:\.\d+)?)(ms|[wdhms])"


def is_enabled(settings: base.Rows) -> bool | None:
    """Return whether the receiver is switched on; None if unknown."""
    return _YES.get(settings.rows[0].get("enabled", "")) if settings.rows else None


def read_monitor(monitor: base.Rows, clock: base.Rows | None = None) -> Reception:
    """Parse the monitor's row; `clock`: the device's own, for its time zone. Raises nothing."""
    row = monitor.rows[0] if monitor.rows else {}
    age_s = _age(row.get("data-age", ""))
    count = re.fullmatch(r"\d{1,3}", row.get("satellites", ""))
    hdop = re.fullmatch(r"\d{1,3}(\.\d+)?", row.get("horizontal-dilution", ""))
    return Reception(
        reports=(_report(row),) if row else (),
        is_recognized=bool(row),
        good=len(row),
        satellites=int(count[0]) if count else None,
        hdop=float(hdop[0]) if hdop else None,
        single=True,
        zone_s=_zone_s(clock),
        began=monitor.response_time - age_s if monitor.response_time else 0.0,
        ended_s=age_s,
    )


def _report(row: Mapping[str, str]) -> Report:
    valid = _YES.get(row.get("valid", ""))
    altitude = re.match(r"-?\d", row.get("altitude", ""))
    return Report(
        at_s=0.0,
        mode=None if valid is None else 1 if not valid or row.get("fix-quality") == "0" else 3 if altitude else 2,
        latitude=_degrees(row.get("latitude", "")),
        longitude=_degrees(row.get("longitude", "")),
        time=_time(row.get("date-and-time", "")),
        nature=_QUALITY.get(row.get("fix-quality", ""), Nature.MEASURED),
    )


def _degrees(text: str) -> float | None:
    parts = re.findall(r"\d{1,3}(?:\.\d{1,12})?", text)
    if not re.fullmatch(r"[NSEW]?\s*-?[\d.\s'\"°]+[NSEW]?", text) or not 1 <= len(parts) <= 3:  # noqa: PLR2004 - d, m, s
        return None
    value = math.fsum(float(part) / 60**place for place, part in enumerate(parts))
    return -value if "-" in text or "S" in text or "W" in text else value


def _time(text: str) -> float | None:
    for form in _TIMES:
        try:
            return (
                datetime.strptime(text.strip().title() if "%b" in form else text.strip(), form)
                .replace(tzinfo=UTC)
                .timestamp()
            )
        except (ValueError, OverflowError):
            continue
    return None


def _age(text: str) -> float:
    """Parse `2s`, `1m4s`, or bare seconds; older versions do not report the age, which then counts as 0."""
    if re.fullmatch(r"\d{1,9}(\.\d+)?", text):
        return float(text)
    if not re.fullmatch(f"(?:{_PART})+", text):
        return 0.0
    return sum(float(count) * _SECONDS[unit] for count, unit in re.findall(_PART, text))


def _zone_s(clock: base.Rows | None) -> float:
    """Return the device clock's offset from UTC in seconds, from a `gmt-offset` such as `+01:00`."""
    text = clock.rows[0].get("gmt-offset", "") if clock is not None and clock.rows else ""
    match = re.fullmatch(r"([+-])(\d\d):(\d\d)", text)
    return 0.0 if match is None else (-1 if match[1] == "-" else 1) * (int(match[2]) * 3600.0 + int(match[3]) * 60.0)


@dataclass(frozen=True, slots=True)
class StreamGps:
    """Check that the receiver has a fresh fix in the right place, and keeps it."""

    expectation: GpsExpectation
    place: base.Place
    address: str = ""
    port: int = 0
    device: str = ""
    baud: int = 0

    def asks(self) -> tuple[base.Question, ...]:
        """Listen to the stream; gpsd needs a request before it reports, the others do not."""
        speaks_json = self.expectation.driver is model.GpsDriver.GPSD
        count = self.expectation.reports
        return (
            base.Listen(
                name="positions",
                place=self.place,
                transport="serial" if self.device else "tcp",
                address=self.address,
                port=self.port,
                device=self.device,
                baud=self.baud,
                say=(base.Say(gpsd.WATCH, gpsd.WATCH_REPLY),) if speaks_json else (),
                listen_s=5.0 + 2 * count,
                enough=gpsd.enough(count) if speaks_json else nmea.enough(count),
            ),
        )

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        """Judge the stream."""
        answer = results["positions"]
        assert isinstance(answer, base.Transcript)  # noqa: S101 - what Listen gives
        reception = (gpsd if self.expectation.driver is model.GpsDriver.GPSD else nmea).read(answer)
        if answer.words and answer.trouble is None:
            # The other end hung up in between.
            reception = replace(reception, complaints=(*reception.complaints, answer.words))
        if answer.trouble is not None and not reception.reports:
            return base.ProbeResult(
                (describe_trouble(answer.trouble, answer.words, self.expectation),),
                evidence(reception, self.expectation),
            )
        return _judge_reception(reception, self.expectation)


@dataclass(frozen=True, slots=True)
class RouterosGps:
    """Check that the router's receiver has a fresh fix in the right place."""

    expectation: GpsExpectation
    host: str

    def asks(self) -> tuple[base.Question, ...]:
        """Query the latest position, whether the receiver is switched on, and the time zone of its clock."""
        queries = {"monitor": GPS_MONITOR, "settings": GPS_SETTINGS, "clock": CLOCK_QUERY}
        return tuple(base.RouterOsQuery(name, self.host, query) for name, query in queries.items())

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        """Judge the router's latest position."""
        monitor, settings, clock = results["monitor"], results["settings"], results["clock"]
        assert isinstance(monitor, base.Rows)  # noqa: S101 - what Ask gives
        assert isinstance(settings, base.Rows)  # noqa: S101 - what Ask gives
        assert isinstance(clock, base.Rows)  # noqa: S101 - what Ask gives
        if monitor.trouble is not None:
            return base.ProbeResult((describe_trouble(monitor.trouble, monitor.words, self.expectation),))
        reception = read_monitor(monitor, clock)
        unknown = settings.rows is None and settings.trouble is None
        if unknown or is_enabled(settings) is False:
            return base.ProbeResult((self._off(settings),), evidence(reception, self.expectation))
        return _judge_reception(reception, self.expectation)

    def _off(self, settings: base.Rows) -> LinkFinding:
        if settings.rows is None:
            message = msg(f"{arg(self.host)} has no menu `/system gps`")
            return LinkFinding(
                Verdict.FAIL, "driver-not-started", message, "install the package gps for its RouterOS version"
            )
        message = msg(f"the receiver of {arg(self.host)} is not switched on")
        return LinkFinding(
            Verdict.FAIL, "driver-not-started", message, "set `enabled=yes` and the receiver's `port` in `/system gps`"
        )


@dataclass(frozen=True, slots=True)
class Nowhere:
    """Probe of a receiver whose address is not in the inventory."""

    name: str

    def asks(self) -> tuple[base.Question, ...]:
        """Return no requests."""
        return ()

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        """Return the finding that the address is missing."""
        del results
        message = msg(f"the inventory has no address for the receiver of {arg(self.name)}")
        hint = msg(
            f"set `address:` under its `endpoints.gps`, or add a DHCP reservation with the key of {arg(self.name)}"
        )
        return base.ProbeResult((LinkFinding(Verdict.INCONCLUSIVE, "no-address", message, hint),))


def _judge_reception(reception: Reception, expectation: GpsExpectation) -> base.ProbeResult:
    return base.ProbeResult(judge(reception, expectation), evidence(reception, expectation))


GPSD_PORT = 2947
"""IANA: gpsd."""
NMEA_PORT = 10110
"""IANA: nmea-0183."""


def steps(cell: base.Cell) -> tuple[base.Step, ...]:
    """Return the step of a cell: a probe if the inventory has an endpoint, otherwise a check by a person."""
    endpoint = cell.endpoints.gps
    if endpoint is None:
        return (_manual_step(cell),)
    return (
        base.Step(
            name="",
            title=msg(f"{arg(cell.name)} has a valid position"),
            kind=ItemKind.AUTOMATIC,
            phase=Phase.QUAY,
            probe=_probe(cell, endpoint),
            concerns=_concerned_hosts(cell, endpoint),
        ),
    )


def _manual_step(cell: base.Cell) -> base.Step:
    dimensions = "3D" if _is_uav(cell) else "2D or 3D"
    return base.Step(
        name="",
        title=msg(f"{arg(cell.name)} has a valid position"),
        kind=ItemKind.PERSON,
        phase=Phase.QUAY,
        do=msg(
            f"Bring {arg(cell.name)} under an open sky, and watch its position in the operator's program for a minute."
        ),
        look_for=msg(
            f"A {arg(dimensions)} fix that stays, matches the map to a few metres, and has the right time (UTC)."
        ),
    )


def _is_uav(cell: base.Cell) -> bool:
    return cell.vehicle is not None and cell.inventory.vehicles[cell.vehicle].kind is model.VehicleKind.UAV


def _probe(cell: base.Cell, endpoint: model.GpsEndpoint) -> base.Probe:
    if endpoint.driver is model.GpsDriver.ROUTEROS:
        host = endpoint.seen_by or (cell.router.name if cell.router else None)
        if host is None:
            return Nowhere(cell.name)
        return RouterosGps(_expectation(cell, endpoint, msg(f"GPS of {arg(host)}"), host, host), host)
    place = cell.place(endpoint.seen_from)
    stands = _name(cell, place)
    if endpoint.driver is model.GpsDriver.NMEA_SERIAL:
        end = msg(f"{arg(endpoint.device)} of {arg(stands)}")
        expectation = _expectation(cell, endpoint, msg(f"NMEA from {arg(end)}"), end, stands)
        return StreamGps(expectation, place, device=endpoint.device or "", baud=endpoint.baud)
    address = cell.address(endpoint.address)
    if address is None:
        return Nowhere(cell.name)
    port = endpoint.port or (GPSD_PORT if endpoint.driver is model.GpsDriver.GPSD else NMEA_PORT)
    end = f"{address}:{port}"
    source = msg(f"gpsd at {arg(end)}" if endpoint.driver is model.GpsDriver.GPSD else f"NMEA from {arg(end)}")
    return StreamGps(_expectation(cell, endpoint, source, end, stands), place, address=address, port=port)


def _expectation(cell: base.Cell, endpoint: model.GpsEndpoint, source: str, end: str, place: str) -> GpsExpectation:
    return GpsExpectation(
        name=cell.name,
        driver=endpoint.driver,
        source=source,
        end=end,
        place=place,
        fence=cell.site_config.checklist.geofence,
        three=_is_uav(cell),
        clear_sky=endpoint.clear_sky,
        reports=endpoint.reports,
        max_age_s=endpoint.max_age_s,
    )


def _name(cell: base.Cell, place: base.Place) -> str:
    return cell.gateway.name if place is base.Place.GATEWAY and cell.gateway is not None else "this computer"


def _concerned_hosts(cell: base.Cell, endpoint: model.GpsEndpoint) -> tuple[str, ...]:
    if endpoint.driver is model.GpsDriver.ROUTEROS:
        return tuple(filter(None, (endpoint.seen_by or (cell.router.name if cell.router else None),)))
    stands = _name(cell, cell.place(endpoint.seen_from))
    return () if stands == "this computer" else (stands,)
