"""Emulated voyages for tests, and surveys that are written by hand."""

from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any

from atlantis_netcfg.emulator.coverage import Coverage, PlaceTruth, out_and_back, two_masts
from atlantis_netcfg.links.qualify.samples import Sample
from atlantis_netcfg.links.qualify.session import ReflectorPeer
from atlantis_netcfg.records.survey.measure import LinkTester, RadioReader, RadioSample, RunningSurvey, SurveyPlan
from atlantis_netcfg.records.survey.points import Survey, SurveyEnd, SurveyHeader, SurveyPoint
from atlantis_netcfg.records.survey.rehearsal import KEY, DeclaredRate, Voyage, VoyageRadio

PORT = (41.6864, -8.8388)
"""The report's point in the port."""
RATE = DeclaredRate(0.08, 5e6, 5e6)
BEGUN = datetime(2026, 11, 20, 10, 15, tzinfo=UTC)


@dataclass
class Told:
    truth: PlaceTruth | None = None
    carries: str | None = "4g"
    reads: int = 0

    def tune(self, truth: PlaceTruth) -> None:
        self.truth = truth

    def read(self) -> RadioSample:
        self.reads += 1
        truth = self.truth
        if truth is None or not truth.has_service:
            return RadioSample(registration="searching")
        return RadioSample(
            "registered_home",
            "lte",
            cell=str(truth.cell_id),
            rsrp_dbm=truth.rsrp_dbm,
            rsrq_db=truth.rsrq_db,
            sinr_db=truth.sinr_db,
        )

    def carried_by(self) -> str | None:
        return self.carries


@dataclass
class Sailing:
    """A survey on a voyage, and what it has written."""

    voyage: Voyage
    survey: RunningSurvey
    samples: list[Sample] = field(default_factory=list)
    points: list[SurveyPoint] = field(default_factory=list)


def sailing(unit: Told | None = None, reader: RadioReader | None = None, **plan: Any) -> Sailing:  # noqa: ANN401 - fields of SurveyPlan
    told = unit or Told()
    voyage = Voyage(out_and_back(*PORT), two_masts(*PORT), RATE, told.tune)
    made = SurveyPlan(**{"max_seconds": 3600.0, **plan})
    samples: list[Sample] = []
    points: list[SurveyPoint] = []
    tester = LinkTester(made, voyage.link, ReflectorPeer(KEY), samples.append)
    radio = VoyageRadio(voyage, reader or told)
    survey = RunningSurvey(made, "4g", voyage, radio, tester, voyage.clock, points.append)
    return Sailing(voyage, survey, samples, points)


def header(**changes: Any) -> SurveyHeader:  # noqa: ANN401 - fields of SurveyHeader
    values = {
        "id": "20261120T101500Z",
        "tool": "0",
        "site": "te4sea",
        "title": "Support vessel",
        "link": "4g",
        "unit": "te4sea-4g",
        "far_end": "192.0.2.1:862",
        "positions_by": "gpsd at 127.0.0.1:2947",
        "emulated": False,
        "begun": BEGUN,
        "time_zone": "Europe/Lisbon",
        "step_m": 50.0,
        "step_s": 30.0,
        "max_age_s": 2.0,
        "max_hdop": 4.0,
        "hourly_bytes": 2_000_000,
        "test_every_s": 24.0,
        "train_packets": 5,
        "packet_size": 112,
        "message_size": 9600,
    }
    return SurveyHeader(**{**values, **changes})


def point(number: int = 1, **changes: Any) -> SurveyPoint:  # noqa: ANN401 - fields of SurveyPoint
    at_s = 30.0 * (number - 1)
    return SurveyPoint(**{"number": number, "at": BEGUN + timedelta(seconds=at_s), "at_s": at_s, **changes})


def survey(*points: SurveyPoint, reason: str | None = "done", **changes: Any) -> Survey:  # noqa: ANN401 - as above
    end = None if reason is None else SurveyEnd(at=BEGUN + timedelta(hours=1), reason=reason)
    return Survey(header(**changes), points, end)


def coverage() -> Coverage:
    return two_masts(*PORT)
