"""Every case lists all that is said; streams are judged whole, and one byte at a time."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from gps_cases import CASES, Case
from gps_said import WANTED, bytewise, epoch, fixes, gpsd, heard, nmea, tpv
from row_subtests import for_each_row

from atlantis_netcfg.checklist.probes import Listen, Place, ProbeResult, Transcript
from atlantis_netcfg.checklist.probes.gps import StreamGps
from atlantis_netcfg.checklist.probes.gps import gpsd as gpsd_reader
from atlantis_netcfg.checklist.probes.gps import nmea as nmea_reader
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.inventory.model import GpsDriver
from atlantis_netcfg.links import LinkFinding

LISTED: dict[str, list[str]] = yaml.safe_load(Path(__file__).with_name("gps_cases.yml").read_text(encoding="utf-8"))


def judged(case: Case, transcript: Transcript) -> ProbeResult:
    return probe(case).judge({"positions": transcript})


def probe(case: Case) -> StreamGps:
    return StreamGps(replace(WANTED[case.driver], **case.wanted), Place.GATEWAY)


def told(findings: tuple[LinkFinding, ...]) -> list[str]:
    return [f"{one.verdict} {one.code}: {one.message}" for one in findings]


@for_each_row("name", CASES, ids=str)
def test_findings_match_the_case(name: str) -> None:
    case = CASES[name]
    found = judged(case, case.transcript).findings
    assert told(found) == LISTED[name]
    assert all(one.hint for one in found if one.verdict is not Verdict.PASS)


@for_each_row("name", CASES, ids=str)
def test_byte_by_byte_arrival_gives_the_same_findings(name: str) -> None:
    case = CASES[name]
    assert judged(case, bytewise(case.transcript)) == judged(case, case.transcript)


@for_each_row("name", CASES, ids=str)
def test_arrival_in_one_piece_gives_the_same_reports(name: str) -> None:
    case = CASES[name]
    reader = gpsd_reader if case.driver.value == "gpsd" else nmea_reader
    one = (case.transcript.chunks[-1][0] if case.transcript.chunks else 0.0, case.transcript.data)
    at_once = reader.read(heard([one]))
    apart = reader.read(case.transcript)
    assert [replace(report, at_s=0.0) for report in at_once.reports].__repr__() == [
        replace(report, at_s=0.0) for report in apart.reports
    ].__repr__()
    assert (at_once.good, at_once.bad, at_once.devices) == (apart.good, apart.bad, apart.devices)


def test_every_code_of_a_stream_has_its_case() -> None:
    assert list(LISTED) == list(CASES)
    codes = {line.split(" ")[1].rstrip(":") for lines in LISTED.values() for line in lines}
    assert codes == {
        *("clock-differs", "damaged", "device-missing", "driver-not-started", "few-reports", "fix", "fix-2d"),
        *("fix-lost", "fix-stale", "fix-unsteady", "in-use", "no-answer", "no-data", "clock-unknown"),
        *("no-date", "no-satellites", "no-fix", "no-geofence", "no-route", "no-time", "not-allowed"),
        *("not-gpsd", "not-nmea", "outside-geofence", "position-frozen", "positions-differ", "time-goes-back"),
        *("time-uneven", "place-not-reached", "position-dead-reckoning", "position-impossible"),
        *("position-jumps", "position-manual", "position-null", "position-simulated", "position-swapped"),
        *("position-uncertain", "refused"),
    }


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("gpsd, not started", "option -G"),
        ("gpsd, no receiver", "/etc/default/gpsd"),
        ("gpsd, sign of the longitude lost", "west is negative"),
        ("gpsd, sign of the latitude lost", "south is negative"),
        ("gpsd, week rolled over", "after a week-number rollover"),
        ("gpsd, clock ahead by a time zone", "time zone"),
        ("gpsd, a replayed log", "recorded log is replayed"),
        ("gpsd, clock behind", "third clock"),
        ("NMEA, wrong baud rate", "`baud:`"),
    ],
)
def test_the_hint_names_the_cause(name: str, words: str) -> None:
    case = CASES[name]
    assert words in (judged(case, case.transcript).findings[0].hint or "")


def test_evidence_is_listed() -> None:
    case = CASES["gpsd, healthy"]
    assert {one.what: one.value for one in judged(case, case.transcript).evidence} == {
        "source": "gpsd 3.22 at 10.64.1.22:2947, /dev/ttyACM0",
        "position": "41.68642, -8.83883",
        "fix": "3D, 9 satellites, HDOP 0.9",
        "age of the last position": "0.1 s",
        "receiver time": "0.2 s behind the clock of coastal-gateway",
        "reports": "5 fixes in a row at the end of 5 reports in 4 s",
        "geofence": "41.68640, -8.83880, radius 1000 m; the position is 3 m from its centre",
    }


def asked(case: Case) -> Listen:
    (question,) = probe(case).asks()
    assert isinstance(question, Listen)
    return question


ENOUGH = (
    gpsd(*fixes(5)),
    gpsd(*fixes(5), sky=None),
    gpsd(*[tpv(0)] * 10),
    gpsd(*fixes(4), tpv(4, mode=1), *[tpv(5 + second) for second in range(5)]),
    nmea(*[epoch(second) for second in range(5)]),
    nmea(*[epoch(0)] * 10),
)
TOO_LITTLE = (
    gpsd(*fixes(4)),
    gpsd(*[tpv(0)] * 9),
    gpsd(*fixes(5, time=None)),
    gpsd(*fixes(5, mode=1)),
    gpsd(*fixes(4), tpv(4, mode=1), tpv(5)),
    nmea(*[epoch(second) for second in range(4)]),
    nmea(*[epoch(0)] * 9),
)


def is_enough(chunks: tuple[tuple[float, bytes], ...]) -> bool:
    kind = "gpsd" if b"TPV" in heard(chunks).data else "nmea_tcp"
    question = asked(next(case for case in CASES.values() if case.driver.value == kind))
    return bool(re.search(question.enough, heard(chunks).data))


@pytest.mark.parametrize("chunks", ENOUGH)
def test_listening_ends_when_enough_is_received(chunks: tuple[tuple[float, bytes], ...]) -> None:
    assert is_enough(chunks)


@pytest.mark.parametrize("chunks", TOO_LITTLE)
def test_listening_continues_until_enough_is_received(chunks: tuple[tuple[float, bytes], ...]) -> None:
    assert not is_enough(chunks)


def test_long_insufficient_stream_is_searched_quickly() -> None:
    wanted = replace(WANTED[GpsDriver.GPSD], reports=100)
    (question,) = StreamGps(wanted, Place.GATEWAY).asks()
    assert isinstance(question, Listen)
    many = gpsd(*[tpv(second % 50 * 1.0, mode=3 if second % 50 else 1) for second in range(190)])
    assert not re.search(question.enough, heard(many).data)
