"""Acceptance 4 of issue 21: an hour with the emulated unit over HTTPS, and positions by the real gpsd."""

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest
from gnss_stand import gpsd
from voyage_stand import nmea, replayed, sailing
from waiting import HANG_S, wait_until

from atlantis_netcfg.checklist.probes.gps.judge import distance_m
from atlantis_netcfg.emulator.gnss import GnssSpec, RunningGpsd, RunningNmea
from atlantis_netcfg.records.survey.measure import SurveyPlan
from atlantis_netcfg.records.survey.points import SurveyPoint
from atlantis_netcfg.records.survey.positions import GpsdSource, NoPosition, TrackPosition
from atlantis_netcfg.records.survey.rehearsal import Voyage

NEAR_M, AGREE, LIMIT = 10.0, 0.99, 2_000_000


def agreeing(voyage: Voyage, points: list[SurveyPoint]) -> int:
    """How many points tell what is on the air where they are."""
    good = 0
    for point in points:
        truth = voyage.coverage.at(*voyage.track.at(point.at_s))
        told = (point.cell, point.rsrp_dbm, point.rsrq_db, point.sinr_db)
        air = (str(truth.cell_id), truth.rsrp_dbm, truth.rsrq_db, truth.sinr_db)
        good += told == (air if truth.has_service else (None,) * 4)
    return good


def check(voyage: Voyage, points: list[SurveyPoint]) -> None:
    off = [distance_m(*point.position, *voyage.track.at(point.at_s)) for point in points if point.position]
    assert len(off) >= AGREE * len(points)
    assert max(off) <= NEAR_M
    assert agreeing(voyage, points) >= AGREE * len(points)
    assert {point.cell for point in points} >= {"3103242", "3103499", None}, "two cells, and none"
    assert 0.3 * LIMIT < voyage.link.wire_bytes <= LIMIT
    assert voyage.link.wire_bytes == sum(point.test_bytes for point in points)


def test_an_hour_over_the_units_own_interface(tmp_path: Path) -> None:
    """A point whenever the budget allows a test: 140 readings over HTTPS."""
    plan = SurveyPlan(step_m=None, step_s=60.0, max_seconds=3600.0)
    with sailing(tmp_path, plan) as (voyage, survey, points):
        survey.run()
    check(voyage, points)
    assert len(points) > 100


def test_real_gpsd_reports_the_position_of_the_voyage(tmp_path: Path) -> None:
    seconds = replayed(nmea(tmp_path / "voyage.nmea", 12))
    plan = SurveyPlan(step_m=None, step_s=2.0, max_seconds=10.0)
    with sailing(tmp_path, plan, lambda at, _latitude, _longitude: seconds[at]) as (voyage, survey, points):
        survey.tester = None
        survey.run()
    off = [distance_m(*point.position, *voyage.track.at(point.at_s)) for point in points if point.position]
    assert len(off) == len(points) >= 4
    assert max(off) <= NEAR_M


@pytest.mark.campaign
@pytest.mark.timeout(1800)
def test_an_hour_with_the_real_gpsd(tmp_path: Path) -> None:
    seconds = replayed(nmea(tmp_path / "voyage.nmea", 3610))
    plan = replace(SurveyPlan(), max_seconds=3600.0)
    with sailing(tmp_path, plan, lambda at, _latitude, _longitude: seconds[at]) as (voyage, survey, points):
        survey.run()
    check(voyage, points)
    assert len(points) > 200


def until(source: GpsdSource, holds: Callable[[TrackPosition | NoPosition], bool]) -> TrackPosition | NoPosition:
    """Wait for a position or a reason."""

    end = time.monotonic() + HANG_S
    while not holds(found := source.position()):
        assert time.monotonic() < end, found
        time.sleep(0.02)
    return found


def test_gpsd_is_read_over_its_socket_and_through_a_program() -> None:
    with RunningNmea(GnssSpec(every_s=0.1)) as receiver, gpsd(f"tcp://127.0.0.1:{receiver.port}") as port:
        with GpsdSource("real", ("127.0.0.1", port)) as source:
            found = until(source, lambda found: isinstance(found, TrackPosition))
        relay = "import socket,sys,threading as t,os\ns=socket.create_connection(('127.0.0.1',int(sys.argv[1])))\n"
        relay += "t.Thread(target=lambda:[s.sendall(d) for d in iter(lambda:os.read(0,999),b'')],daemon=True).start()\n"
        relay += "[os.write(1,d) for d in iter(lambda:s.recv(9999),b'')]"
        with GpsdSource("through", command=["python3", "-c", relay, str(port)]) as source:
            through = until(source, lambda found: isinstance(found, TrackPosition))
        assert receiver.forbidden == []
    for each in (found, through):
        assert isinstance(each, TrackPosition)
        assert distance_m(each.latitude, each.longitude, 41.68642, -8.83883) < 1.0


def test_lost_gpsd_is_reported() -> None:
    with ExitStack() as stack:
        twin = stack.enter_context(RunningGpsd(GnssSpec(every_s=0.05)))
        with GpsdSource("twin", (twin.host, twin.port)) as source:
            until(source, lambda found: isinstance(found, TrackPosition))
            stack.close()
            until(source, lambda found: found is NoPosition.NO_GPSD)


def test_error_output_of_the_program_is_stored() -> None:
    words = ["sh", "-c", "echo first >&2; echo Host key verification failed. >&2; exit 255"]
    with GpsdSource("gpsd of a gateway", command=words) as source:
        wait_until(lambda: source.trouble)
        assert source.position() is NoPosition.NO_GPSD
    assert source.trouble == "Host key verification failed."


def test_gpsd_without_a_fix_is_reported() -> None:
    with RunningGpsd(GnssSpec(every_s=0.05, mode=1)) as twin, GpsdSource("twin", (twin.host, twin.port)) as source:
        until(source, lambda found: found is NoPosition.NO_FIX)
