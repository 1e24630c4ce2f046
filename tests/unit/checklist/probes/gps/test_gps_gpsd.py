"""gpsd's JSON: whatever stands in it, something is said and nothing fails."""

import json
from typing import Any

import pytest
from gps_said import DEVICE, NO_FIX, PATH, SKY, VERSION, WANTED, fixes, gpsd, greeting, heard, said, tpv
from hypothesis import given, settings
from hypothesis import strategies as some

from atlantis_netcfg.checklist.probes import Place, ProbeResult, Transcript
from atlantis_netcfg.checklist.probes.gps import StreamGps
from atlantis_netcfg.checklist.probes.gps.gpsd import read
from atlantis_netcfg.checklist.probes.gps.record import Nature
from atlantis_netcfg.inventory.model import GpsDriver


def judged(transcript: Transcript) -> ProbeResult:
    return StreamGps(WANTED[GpsDriver.GPSD], Place.GATEWAY).judge({"positions": transcript})


SCALARS = (None, True, 0, 1, 2, 3, 8, -1, 41.68, -8.83, 1e308, 10**400, PATH, "", "2026-11-20T10:15:01.000Z")
VALUES: some.SearchStrategy[Any] = some.one_of(
    some.sampled_from([*SCALARS, float("nan"), float("inf"), [], [None], [{}], {}, {"path": 5}]),
    some.floats(),
    some.text(max_size=8),
)
NAMES = ("device", "mode", "time", "lat", "lon", "eph", "status", "devices", "path", "activated", "hdop", "uSat")
CLASSES = ("TPV", "SKY", "DEVICES", "DEVICE", "VERSION", "ERROR", "WATCH", "AIS")
OBJECTS = some.dictionaries(some.sampled_from((*NAMES, "satellites", "message", "release")), VALUES, max_size=6)


@settings(max_examples=60)
@given(some.lists(some.tuples(some.sampled_from(CLASSES), OBJECTS), max_size=6), some.binary(max_size=30))
def test_any_stream_gives_findings(objects: list[tuple[str, dict[str, Any]]], noise: bytes) -> None:
    pieces = [said({"class": kind, **values}) for kind, values in objects]
    transcript = heard([(0.5 * place, piece) for place, piece in enumerate([*pieces, noise])])
    found = judged(transcript)
    assert found.findings
    assert all(one.value for one in found.evidence)


def test_receiver_with_a_fix_is_judged() -> None:
    other = {**NO_FIX, "device": "/dev/ttyS9"}
    found = read(heard(gpsd(*[one for second in range(5) for one in (other, tpv(second))])))
    assert (found.device, found.others, len(found.fixes)) == (PATH, ("/dev/ttyS9",), 5)


@pytest.mark.parametrize(
    ("status", "nature"),
    [
        (None, Nature.MEASURED),
        (1, Nature.MEASURED),
        (2, Nature.MEASURED),
        (3, Nature.MEASURED),
        (4, Nature.MEASURED),
        (5, Nature.DEAD_RECKONING),
        (6, Nature.MEASURED),
        (7, Nature.MANUAL),
        (8, Nature.SIMULATED),
        (9, Nature.MEASURED),
        (77, Nature.MEASURED),
    ],
)
def test_status_gives_the_nature_of_a_position(status: int | None, nature: Nature) -> None:
    (report,) = read(heard(gpsd(tpv(0, status=status)))).reports
    assert report.nature is nature


def test_satellites_are_counted_if_not_reported() -> None:
    sky = {
        "class": "SKY",
        "satellites": [{"PRN": 1, "used": True}, {"PRN": 2, "used": False}, {"PRN": 3, "used": True}],
    }
    found = read(heard(gpsd(*fixes(1), sky=sky)))
    assert (found.satellites, found.hdop) == (2, None)


def test_errors_of_gpsd_are_kept_verbatim() -> None:
    error = {"class": "ERROR", "message": "Unrecognized request '?FOO;'"}
    found = judged(heard([(0.05, greeting(DEVICE)), (0.1, said(error))], 15.0))
    assert [one.value for one in found.evidence if one.what == "error reported by the source"] == [error["message"]]


def test_foreign_text_is_shortened_and_stripped_of_control_characters() -> None:
    error = {"class": "ERROR", "message": "\x1b[2J\n" + "x" * 100_000}
    (complaint,) = read(heard([(0.05, said(error))])).complaints
    assert complaint == "?[2J?" + "x" * 115


def test_incomplete_object_is_ignored() -> None:
    cut = json.dumps(tpv(1)).encode()[:-3]
    found = read(heard([(0.05, greeting(DEVICE)), (0.2, said(VERSION, tpv(0), SKY) + cut)]))
    assert (len(found.reports), found.bad) == (1, 0)
