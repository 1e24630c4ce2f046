"""A voyage whose unit is a running emulation, and whose positions may come from the real gpsd."""

import json
import subprocess
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from datetime import datetime
from functools import reduce
from operator import xor
from pathlib import Path

from gnss_stand import environment, program
from ports import held_port

from atlantis_netcfg.emulator.coverage import out_and_back, two_masts
from atlantis_netcfg.inventory import load
from atlantis_netcfg.links.qualify.session import ReflectorPeer
from atlantis_netcfg.operations import Mode, Request
from atlantis_netcfg.operations.lte.units import emulated_units
from atlantis_netcfg.records.survey.measure import LinkTester, RunningSurvey, SurveyPlan
from atlantis_netcfg.records.survey.points import SurveyPoint
from atlantis_netcfg.records.survey.radio import UnitRadio
from atlantis_netcfg.records.survey.rehearsal import KEY, START, DeclaredRate, Voyage, VoyageRadio, gpsd_reports
from atlantis_netcfg.runs import Store

PORT = (41.6864, -8.8388)
RATE = DeclaredRate(0.08, 5e6, 5e6)
DECLARATION = load(Path(__file__).parents[4] / "inventory")
UNIT = DECLARATION.hosts["te4sea-4g"]


@contextmanager
def sailing(
    folder: Path, plan: SurveyPlan, reports: Callable[[datetime, float, float], Iterable[bytes]] = gpsd_reports
) -> Iterator[tuple[Voyage, RunningSurvey, list[SurveyPoint]]]:
    """A survey whose unit is the emulated RutOS unit of te4sea, read over HTTPS by its driver."""
    points: list[SurveyPoint] = []
    with emulated_units([UNIT], folder) as units:
        unit = units[UNIT.name]
        assert unit.tune is not None
        request = Request(state=folder, mode=Mode.DRIFT, rehearsed=True, targets={UNIT.name: unit.target})
        radio = UnitRadio(DECLARATION, UNIT, request, Store(folder, is_rehearsal=True))
        voyage = Voyage(out_and_back(*PORT), two_masts(*PORT), RATE, unit.tune, reports=reports)
        tester = LinkTester(plan, voyage.link, ReflectorPeer(KEY), lambda _sample: None)
        survey = RunningSurvey(plan, "4g", voyage, VoyageRadio(voyage, radio), tester, voyage.clock, points.append)
        yield voyage, survey, points


def sentence(body: str) -> str:
    return f"${body}*{reduce(xor, body.encode(), 0):02X}"


def nmea(path: Path, seconds: int) -> Path:
    """What a receiver on the voyage would say, once a second."""
    track, lines = out_and_back(*PORT), []
    for second in range(seconds):
        latitude, longitude = track.at(second)
        at = (
            f"{(START.hour * 3600 + START.minute * 60 + second) // 3600:02}{(START.minute * 60 + second) // 60 % 60:02}"
        )
        at += f"{second % 60:02}.00"
        place = f"{_minutes(latitude, 2)},N,{_minutes(-longitude, 3)},W"
        lines += [
            sentence(f"GPGGA,{at},{place},1,09,0.9,5.0,M,54.0,M,,"),
            sentence("GPGSA,A,3,01,02,03,04,05,06,07,08,09,,,,1.6,0.9,1.3"),
            sentence(f"GPRMC,{at},A,{place},5.83,270.0,{START:%d%m%y},,,A"),
        ]
    path.write_text("\r\n".join([*lines, ""]), encoding="ascii", newline="")
    return path


def _minutes(degrees: float, digits: int) -> str:
    whole, minutes = divmod(round(degrees * 60 * 100_000), 60 * 100_000)
    return f"{whole:0{digits}}{minutes / 100_000:08.5f}"


def replayed(path: Path) -> dict[datetime, list[bytes]]:
    """What the real gpsd makes of it, by the second that it tells: gpsfake plays as quickly as gpsd takes it."""
    words = ["python3", program("gpsfake"), "-1", "-p", "-q", "-c", "0.001", str(path), "-P"]
    with held_port() as port:
        ran = subprocess.run([*words, str(port)], env=environment(), capture_output=True, check=True)
    found: dict[datetime, list[bytes]] = {}
    waiting: list[bytes] = []
    for line in ran.stdout.splitlines(keepends=True):
        if line.startswith((b'{"class":"TPV"', b'{"class":"SKY"')):
            waiting.append(line)
            told = json.loads(line).get("time")
            if told is not None and line.startswith(b'{"class":"TPV"'):
                second = datetime.fromisoformat(told).replace(microsecond=0)
                found[second] = [*found.get(second, []), *waiting]
                waiting = []
    return found
