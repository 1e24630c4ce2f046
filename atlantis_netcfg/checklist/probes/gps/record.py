"""The common record of every source of positions, its expected values, and findings for a silent source.

A source that is missing, not started, in use, or not reachable: four different cases, with separate messages.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes.base import Transcript, Trouble
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory.model import Geofence, GpsDriver
from atlantis_netcfg.links import LinkFinding

if TYPE_CHECKING:
    from collections.abc import Iterator


DAY_S = 86_400.0


@dataclass(frozen=True, slots=True)
class GpsExpectation:
    """Expected state of one endpoint, and its description in messages."""

    name: str
    """Name of the checklist row: `Sparus`."""
    driver: GpsDriver
    source: str
    """`gpsd at 10.64.1.22:2947`."""
    end: str
    """Endpoint that is connected to: `10.64.1.22:2947`, `/dev/ttyUSB0 of coastal-gateway`."""
    place: str
    """Computer that listens: `coastal-gateway`, `this computer`."""
    fence: Geofence | None
    three: bool = False
    """Whether two dimensions are not enough, because it flies."""
    clear_sky: bool = True
    reports: int = 5
    max_age_s: float = 3.0


class Nature(StrEnum):
    """Origin of a position, as far as reported."""

    MEASURED = "measured"
    DEAD_RECKONING = "dead reckoning"
    """Computed from heading and speed (gpsd status 5, GGA quality 6, mode indicator E)."""
    MANUAL = "set by hand"
    """Typed in or surveyed, not measured (gpsd status 7, GGA quality 7, mode indicator M)."""
    SIMULATED = "simulated"
    """gpsd status 8, GGA quality 8, mode indicator S."""


@dataclass(frozen=True, slots=True)
class Report:
    """One position report, or a report that there is none."""

    at_s: float
    """When it arrived, seconds since listening began."""
    mode: int | None = None
    """1: no fix; 2 and 3: dimensions of the fix (as in gpsd and in GSA); None: not reported."""
    latitude: float | None = None
    longitude: float | None = None
    """Decimal degrees; north (latitude) and east (longitude) are positive."""
    time: float | None = None
    """The receiver's time of the position, seconds since 1970; None: not reported, or without a date."""
    of_day: float | None = None
    """Seconds since midnight UTC, if there is a time without a date."""
    nature: Nature = Nature.MEASURED
    eph_m: float | None = None
    """Estimated horizontal error: gpsd computes it from geometry, so it is good for comparison, not a measurement."""
    speed_m_s: float | None = None
    """Speed over ground."""

    @property
    def has_fix(self) -> bool:
        """Whether the receiver claims a fix."""
        return self.mode is not None and self.mode >= 2  # noqa: PLR2004 - 2D

    @property
    def possible(self) -> bool:
        """Whether the position is valid: latitude and longitude within their ranges."""
        return (
            self.latitude is not None
            and self.longitude is not None
            and math.isfinite(self.latitude)
            and math.isfinite(self.longitude)
            and abs(self.latitude) <= 90  # noqa: PLR2004 - the poles
            and abs(self.longitude) <= 180  # noqa: PLR2004 - the date line
        )

    @property
    def stamp(self) -> float | None:
        """Time stamp, or time of day if there is no date, to check that time advances."""
        return self.time if self.time is not None else self.of_day


@dataclass(frozen=True, slots=True)
class Reception:
    """All data parsed from a source."""

    reports: tuple[Report, ...] = ()
    """Reports of one receiver, in order of arrival."""
    is_recognized: bool = False
    """Whether any data in the language of the source arrived."""
    heard_bytes: int = 0
    good: int = 0
    """Number of intact sentences or objects."""
    bad: int = 0
    """Number of damaged ones: checksum, JSON."""
    devices: tuple[str, ...] | None = None
    """Receivers that gpsd has open; None: not reported."""
    others: tuple[str, ...] = ()
    """Receivers whose reports were ignored."""
    rivals: tuple[Report, ...] = ()
    """Last fix of each of `others` that has one, and the second position of a receiver that reports two at a time."""
    device: str = ""
    version: str = ""
    satellites: int | None = None
    """Satellites used for the last fix."""
    hdop: float | None = None
    single: bool = False
    """Whether the source reports only its latest position, not a stream."""
    zone_s: float = 0.0
    """How far its time may be ahead of UTC: the source runs in a time zone and may report local time."""
    complaints: tuple[str, ...] = ()
    """Errors in the source's own words."""
    began: float = 0.0
    """Seconds since 1970 by the clock of the computer that listened; 0: not known."""
    ended_s: float = 0.0

    fixes: tuple[Report, ...] = field(init=False)
    """Uninterrupted fixes at the end of `reports`."""

    def __post_init__(self) -> None:
        """Find the trailing run of fixes."""
        start = len(self.reports)
        while start and self.reports[start - 1].has_fix:
            start -= 1
        object.__setattr__(self, "fixes", self.reports[start:])

    @property
    def losses(self) -> int:
        """Number of times that a fix was lost."""
        return sum(
            report.has_fix and not then.has_fix for report, then in zip(self.reports, self.reports[1:], strict=False)
        )

    @property
    def clock_ahead_s(self) -> float | None:
        """Seconds by which the receiver's time is ahead of the listening clock; None if unknown."""
        return median(ahead) if (ahead := self._clock_offsets_s()) else None

    @property
    def clock_uneven_s(self) -> float:
        """Variation of the clock difference while listening, in seconds."""
        return max(ahead) - min(ahead) if (ahead := self._clock_offsets_s()) else 0.0

    def _clock_offsets_s(self) -> list[float]:
        if not self.began:
            return []
        offsets = [report.time - self.began - report.at_s for report in self.fixes if report.time is not None]
        day_offsets = [at_day(fix.of_day - self.began - fix.at_s) for fix in self.fixes if fix.of_day is not None]
        return offsets or day_offsets


def at_day(seconds: float) -> float:
    """Normalise a difference between two times of day to at most twelve hours, in either direction."""
    return (seconds + DAY_S / 2) % DAY_S - DAY_S / 2


def median(values: list[float]) -> float:
    """Return the median; of an even number of values, the upper of the two in the middle."""
    return sorted(values)[len(values) // 2]


def lines(transcript: Transcript) -> Iterator[tuple[float, bytes]]:
    r"""Yield complete lines without line ends (LF or CR LF), with their arrival times; skip a truncated one."""
    pieces: list[bytes] = []
    for at_s, data in transcript.chunks:
        first, *others = data.split(b"\n")
        pieces.append(first)
        for other in others:
            yield at_s, b"".join(pieces).rstrip(b"\r")
            pieces = [other]


_INCONCLUSIVE, _FAIL = Verdict.INCONCLUSIVE, Verdict.FAIL
_STREAM = "read from the program that has it open: set `driver: gpsd` or `nmea_tcp`"


def describe_trouble(trouble: Trouble, words: str, expectation: GpsExpectation) -> LinkFinding:
    """Return the finding for a stream that could not be read."""
    text = msg(f": {arg(words)}" if words else "")
    return {
        Trouble.NO_PLACE: lambda: LinkFinding(
            _INCONCLUSIVE,
            "place-not-reached",
            f"{expectation.source} was not read: {expectation.place} was not reached{text}",
            f"restore {expectation.place} first, then repeat this item",
        ),
        Trouble.SILENT: lambda: LinkFinding(
            _INCONCLUSIVE,
            "no-answer",
            f"no response at {expectation.end}: {expectation.name} is off, or not in the network",
            f"switch {expectation.name} on and check its Wi-Fi or cable first",
        ),
        Trouble.UNREACHABLE: lambda: LinkFinding(
            _INCONCLUSIVE,
            "no-route",
            f"{expectation.place} has no route to {expectation.end}",
            f"connect {expectation.place} to the network of {expectation.name} first",
        ),
        Trouble.REFUSED: lambda: _refusal_finding(expectation),
        Trouble.BUSY: lambda: LinkFinding(
            _INCONCLUSIVE,
            "in-use",
            f"{expectation.end} is in use by another program, and was not read{text}",
            _STREAM,
        ),
        Trouble.CLOSED: lambda: LinkFinding(
            _INCONCLUSIVE,
            "in-use",
            f"{expectation.end} closed the connection at once: it probably serves one client only, and has one",
            "repeat this item while the vehicle's own software is stopped, or " + _STREAM,
        ),
        Trouble.MISSING: lambda: LinkFinding(
            _FAIL,
            "device-missing",
            f"there is no {expectation.end}: the receiver is not plugged in, or has another name",
            "plug the receiver in, and compare `device:` with /dev/serial/by-id",
        ),
        Trouble.DENIED: lambda: LinkFinding(
            _INCONCLUSIVE,
            "not-allowed",
            f"{expectation.end} may not be read{text}",
            "add the account that reads it to the group of the port: dialout",
        ),
    }[trouble]()


def _refusal_finding(expectation: GpsExpectation) -> LinkFinding:
    if expectation.driver is GpsDriver.GPSD:
        return LinkFinding(
            _FAIL,
            "driver-not-started",
            msg(f"{arg(expectation.name)} is reachable, but no gpsd listens at {arg(expectation.end)}"),
            msg(
                f"start gpsd on {arg(expectation.name)} with its option -G: without it gpsd serves only its own "
                "computer"
            ),
        )
    return LinkFinding(
        _INCONCLUSIVE,
        "refused",
        msg(f"{arg(expectation.end)} refuses the connection: its program is not running, or serves only one client"),
        msg(f"check on {arg(expectation.name)} whether the NMEA program runs, and which client is connected to it"),
    )


def speechless(reception: Reception, expectation: GpsExpectation) -> LinkFinding | None:
    """Return the finding for a source that is reachable but reports no position; None if it reports any."""
    if reception.reports:
        return None
    if not reception.is_recognized and reception.heard_bytes:
        return _foreign_finding(reception, expectation)
    if reception.devices is not None and not reception.devices:
        return LinkFinding(
            _FAIL,
            "device-missing",
            msg(f"{arg(expectation.source)} runs, but has no receiver open"),
            "connect the receiver; DEVICES in /etc/default/gpsd sets its port, and gpsd's log shows why it fails",
        )
    return _no_data(reception, expectation)


def _foreign_finding(reception: Reception, expectation: GpsExpectation) -> LinkFinding:
    if expectation.driver is GpsDriver.GPSD:
        return LinkFinding(
            _FAIL,
            "not-gpsd",
            msg(
                f"{arg(expectation.end)} is not gpsd: it sent {arg(reception.heard_bytes)} bytes without one line of "
                "gpsd's JSON"
            ),
            "compare `port:` with the port on which gpsd listens (2947 unless option -S changes it)",
        )
    hint = "compare `port:` with the port of the NMEA stream"
    if expectation.driver is GpsDriver.NMEA_SERIAL:
        hint = "compare `baud:` with the receiver's rate: 4800, 9600, 38400 and 115200 are usual"
    message = msg(f"{arg(reception.heard_bytes)} bytes came from {arg(expectation.end)}, but no complete NMEA sentence")
    return LinkFinding(_FAIL, "not-nmea", message, hint)


def _no_data(reception: Reception, expectation: GpsExpectation) -> LinkFinding:
    after = msg(f"in {arg(reception.ended_s):.0f} s")
    if expectation.driver is GpsDriver.GPSD:
        devices = join(", ", reception.devices or ()) or "its receiver"
        message = msg(f"{arg(expectation.source)} has opened {arg(devices)}, which sent nothing {arg(after)}")
        return LinkFinding(
            _FAIL, "no-data", message, "check the receiver's power and wiring; gpsd tries the baud rates itself"
        )
    if expectation.driver is GpsDriver.ROUTEROS:
        hint = "compare `port` of `/system gps` with the port of the receiver"
        return LinkFinding(_FAIL, "no-data", msg(f"{arg(expectation.source)} reports nothing about its receiver"), hint)
    if reception.is_recognized:
        message = msg(
            f"{arg(reception.good)} NMEA sentences came from {arg(expectation.end)} {arg(after)}, but no position "
            "(GGA, RMC, GLL)"
        )
        return LinkFinding(_FAIL, "no-data", message, "configure the receiver to send GGA, RMC and GSA")
    if expectation.driver is GpsDriver.NMEA_SERIAL:
        message = msg(f"{arg(expectation.end)} is open but sent nothing {arg(after)}")
        return LinkFinding(_FAIL, "no-data", message, "check the receiver's power and wiring")
    # A server for one client may as well let the second one wait.
    message = msg(f"{arg(expectation.end)} accepts the connection but sent nothing {arg(after)}")
    hint = msg(
        f"check on {arg(expectation.name)} whether the receiver is on, and whether its program serves only one client"
    )
    return LinkFinding(_INCONCLUSIVE, "no-data", message, hint)
