"""A point as on site: gpsd, the unit and our reflector behind real sockets, by this computer's clocks."""

from __future__ import annotations

import errno
import socket
import threading
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from voyage_stand import DECLARATION, UNIT

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.emulator.gnss import GnssSpec, RunningGpsd
from atlantis_netcfg.links.qualify.reflector.__main__ import answer_waiting, open_socket
from atlantis_netcfg.links.qualify.reflector.answering import Reflector
from atlantis_netcfg.operations import Mode, Request
from atlantis_netcfg.operations.lte.units import emulated_units
from atlantis_netcfg.operations.qualify.far_end import key_of
from atlantis_netcfg.records.survey.measure import SurveyPlan
from atlantis_netcfg.records.survey.positions import TrackPosition
from atlantis_netcfg.records.survey.radio import find_survey_link
from atlantis_netcfg.records.survey.site import SiteSurvey, TypedPositions
from atlantis_netcfg.runs import Store

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.links.qualify.samples import Sample
    from atlantis_netcfg.records.survey.points import SurveyPoint


@contextmanager
def far_end() -> Iterator[Inventory]:
    """The reflector in a thread, and an inventory that names it."""
    assert DECLARATION.pilot.qualify is not None
    reflector = Reflector(key_of(DECLARATION.pilot.qualify))
    end = threading.Event()
    with open_socket("127.0.0.1", 0) as opened:
        port = opened.getsockname()[1]

        def answer() -> None:
            while not end.is_set():
                opened.settimeout(0.05)
                with_data = True
                try:
                    opened.recv(1, socket.MSG_PEEK)
                except TimeoutError:
                    with_data = False
                opened.setblocking(False)
                if with_data:
                    answer_waiting(opened, reflector)

        thread = threading.Thread(target=answer)
        thread.start()
        qualify = DECLARATION.pilot.qualify.model_copy(update={"address": "127.0.0.1", "port": port})
        try:
            yield replace(DECLARATION, pilot=DECLARATION.pilot.model_copy(update={"qualify": qualify}))
        finally:
            end.set()
            thread.join()


def test_survey_point_over_real_sockets(tmp_path: Path) -> None:
    points: list[SurveyPoint] = []
    samples: list[Sample] = []
    with ExitStack() as stack:
        declaration = stack.enter_context(far_end())
        units = stack.enter_context(emulated_units([UNIT], tmp_path))
        twin = stack.enter_context(RunningGpsd(GnssSpec(every_s=0.1)))
        targets = {UNIT.name: units[UNIT.name].target}
        request = Request(state=tmp_path, mode=Mode.DRIFT, rehearsed=True, targets=targets)
        link = find_survey_link(declaration, UNIT.site, None)
        store, gps = Store(tmp_path, is_rehearsal=True), f"{twin.host}:{twin.port}"
        site = SiteSurvey(declaration, link, UNIT, request, store, SurveyPlan(max_seconds=0.6), gps=gps)
        survey = site.build_survey(stack, samples.append, points.append)
        while not isinstance(survey.positions.position(), TrackPosition):
            survey.clock.wait(0.05)
        assert survey.run() == "done"
        header = site.header(survey, "name")
    (point, *_) = points
    assert (point.latitude, point.longitude) == (41.68642, -8.83883)
    assert (point.rsrp_dbm, point.cell, point.no_radio, point.no_test) == (-94.0, "3103242", "", "")
    assert (point.sent, point.lost, point.carried_by) == (5, 0, None)
    assert point.rtt_median_s is not None
    assert 0.0 < point.rtt_median_s < 1.0
    assert point.goodput_up_bps is not None
    assert 11_000 < point.test_bytes <= SurveyPlan().test_bytes(28)
    assert samples
    assert header.far_end is not None
    assert header.far_end.startswith("127.0.0.1:")
    assert header.positions_by == f"gpsd at {gps}"
    assert not header.emulated


def test_far_end_without_a_route_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unreachable(_far_end: tuple[str, int]) -> None:
        raise OSError(errno.ENETUNREACH, "Network is unreachable")

    monkeypatch.setattr("atlantis_netcfg.records.survey.site.UdpTransport", unreachable)
    link, store = find_survey_link(DECLARATION, UNIT.site, None), Store(tmp_path, is_rehearsal=True)
    request = Request(state=tmp_path, mode=Mode.DRIFT)
    site = SiteSurvey(DECLARATION, link, UNIT, request, store, SurveyPlan())
    with ExitStack() as stack, pytest.raises(UsageError, match=r"no route to the far end .*: Network is unreachable"):
        site.build_survey(stack, lambda _sample: None, lambda _point: None)


def test_manual_position_gives_a_point_without_sending(tmp_path: Path) -> None:
    points: list[SurveyPoint] = []
    with ExitStack() as stack:
        units = stack.enter_context(emulated_units([UNIT], tmp_path))
        targets = {UNIT.name: units[UNIT.name].target}
        request = Request(state=tmp_path, mode=Mode.DRIFT, rehearsed=True, targets=targets)
        link, store = find_survey_link(DECLARATION, UNIT.site, None), Store(tmp_path, is_rehearsal=True)
        site = SiteSurvey(DECLARATION, link, UNIT, request, store, SurveyPlan(), radio_only=True, clicks=True)
        survey = site.build_survey(stack, lambda _sample: None, points.append)
        assert isinstance(survey.positions, TypedPositions)
        survey.begin()
        assert survey.positions.type("pier: 41.7, -8.9")
        survey.take()
        assert site.header(survey, "name").far_end is None
    (point,) = points
    assert (point.latitude, point.longitude, point.place) == (41.7, -8.9, "pier")
    assert (point.rsrp_dbm, point.no_test, point.test_bytes, point.sent) == (-94.0, "nothing is sent", 0, None)
