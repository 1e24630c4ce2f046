"""The probes of GPS: what is asked of a source, and where its answer goes to."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.gps import gpsd, nmea, routeros
from atlantis_netcfg.checklist.probes.gps.evidence import evidence
from atlantis_netcfg.checklist.probes.gps.judge import judge
from atlantis_netcfg.checklist.probes.gps.no_data import troubled
from atlantis_netcfg.checklist.probes.requests import Ask, Listen, Place, Question, Say
from atlantis_netcfg.checklist.probes.results import Rows, Transcript
from atlantis_netcfg.checklist.probes.step import Judged
from atlantis_netcfg.core.verdicts import Verdict
from atlantis_netcfg.declaration.model import GpsDriver

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.checklist.probes.gps.record import Reception, Wanted
    from atlantis_netcfg.checklist.probes.results import Answer

__all__ = ["Nowhere", "RouterosGps", "StreamGps"]


@dataclass(frozen=True, slots=True)
class StreamGps:
    """The receiver has a fresh fix in the right place, and keeps it."""

    wanted: Wanted
    place: Place
    address: str = ""
    port: int = 0
    device: str = ""
    baud: int = 0

    def asks(self) -> tuple[Question, ...]:
        """Listen to the stream: gpsd is asked to speak, all others do by themselves."""
        speaks_json = self.wanted.driver is GpsDriver.GPSD
        count = self.wanted.reports
        return (
            Listen(
                name="positions",
                place=self.place,
                transport="serial" if self.device else "tcp",
                address=self.address,
                port=self.port,
                device=self.device,
                baud=self.baud,
                say=(Say(gpsd.WATCH, gpsd.WATCHED),) if speaks_json else (),
                listen_s=5.0 + 2 * count,
                enough=gpsd.enough(count) if speaks_json else nmea.enough(count),
            ),
        )

    def judge(self, results: Mapping[str, Answer]) -> Judged:
        """Judge the stream."""
        answer = results["positions"]
        assert isinstance(answer, Transcript)  # noqa: S101 - what Listen gives
        reception = (gpsd if self.wanted.driver is GpsDriver.GPSD else nmea).read(answer)
        if answer.words and answer.trouble is None:
            # The other end hung up in between.
            reception = replace(reception, complaints=(*reception.complaints, answer.words))
        if answer.trouble is not None and not reception.reports:
            return Judged((troubled(answer.trouble, answer.words, self.wanted),), evidence(reception, self.wanted))
        return _judged(reception, self.wanted)


@dataclass(frozen=True, slots=True)
class RouterosGps:
    """The router's receiver has a fresh fix in the right place."""

    wanted: Wanted
    host: str

    def asks(self) -> tuple[Question, ...]:
        """Ask for the latest position, whether the receiver is switched on, and for the zone of its time."""
        queries = {"monitor": routeros.MONITOR, "settings": routeros.SETTINGS, "clock": routeros.CLOCK}
        return tuple(Ask(name, self.host, query) for name, query in queries.items())

    def judge(self, results: Mapping[str, Answer]) -> Judged:
        """Judge the one position."""
        monitored, settings, clock = results["monitor"], results["settings"], results["clock"]
        assert isinstance(monitored, Rows)  # noqa: S101 - what Ask gives
        assert isinstance(settings, Rows)  # noqa: S101 - what Ask gives
        assert isinstance(clock, Rows)  # noqa: S101 - what Ask gives
        if monitored.trouble is not None:
            return Judged((troubled(monitored.trouble, monitored.words, self.wanted),))
        reception = routeros.read(monitored, clock)
        unknown = settings.rows is None and settings.trouble is None
        if unknown or routeros.enabled(settings) is False:
            return Judged((self._off(settings),), evidence(reception, self.wanted))
        return _judged(reception, self.wanted)

    def _off(self, settings: Rows) -> Finding:
        if settings.rows is None:
            message = f"{self.host} does not know `/system gps`"
            return Finding(
                Verdict.FAIL, "driver-not-started", message, "install the package gps of its RouterOS version"
            )
        message = f"the receiver of {self.host} is not switched on"
        return Finding(
            Verdict.FAIL, "driver-not-started", message, "set `enabled=yes` and the receiver's `port` in `/system gps`"
        )


@dataclass(frozen=True, slots=True)
class Nowhere:
    """Nobody has declared where the receiver is."""

    name: str

    def asks(self) -> tuple[Question, ...]:
        """Ask nothing."""
        return ()

    def judge(self, results: Mapping[str, Answer]) -> Judged:
        """Say what is missing."""
        del results
        message = f"nobody has declared the address of {self.name}'s receiver"
        hint = f"declare `address:` under its `endpoints.gps`, or a DHCP reservation with the name of {self.name}'s key"
        return Judged((Finding(Verdict.INCONCLUSIVE, "no-address", message, hint),))


def _judged(reception: Reception, expected: Wanted) -> Judged:
    return Judged(judge(reception, expected), evidence(reception, expected))
