"""A RouterOS device's receiver: what is asked exists in every version, and what is said of each answer."""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest
import trees
import yaml
from gps_said import FENCE
from row_subtests import for_each_row

from atlantis_netcfg.checklist.probes import ProbeResult, RouterOsQuery, Rows, Trouble, gps
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.inventory.model import Geofence, GpsDriver
from atlantis_netcfg.links.status import Query

WANTED = gps.GpsExpectation("Offshore", GpsDriver.ROUTEROS, "GPS of off-router", "off-router", "off-router", FENCE)
PROBE = gps.RouterosGps(WANTED, "off-router")
HEARD = datetime(2026, 11, 20, 10, 15, 0, 500_000, tzinfo=UTC).timestamp()
ON = Rows(None, rows=({"enabled": "true", "port": "usb1", "coordinate-format": "dd"},), response_time=HEARD)
ROW = {
    "date-and-time": "2026-11-20 10:14:59",
    "latitude": "41.686420",
    "longitude": "-8.838826",
    "altitude": "5.000000 m",
    "speed": "0.759320 km/h",
    "valid": "yes",
    "satellites": "6",
    "fix-quality": "1",
    "horizontal-dilution": "1.3",
    "data-age": "1s",
}
SAMPLE = {**ROW, "date-and-time": "2021-09-07 08:26:26", "latitude": "56.969689", "longitude": "24.162471"}
"""Positions as in the manual's sample."""


CLOCK = Rows(None, rows=({"gmt-offset": "+01:00", "time-zone-name": "Europe/Lisbon"},), response_time=HEARD)
"""In summer."""


def judged(
    row: dict[str, str] | None, settings: Rows = ON, wanted: gps.GpsExpectation = WANTED, clock: Rows = CLOCK
) -> ProbeResult:
    monitored = Rows(None, rows=None if row is None else (row,) if row else (), response_time=HEARD)
    return replace(PROBE, expectation=wanted).judge({"monitor": monitored, "settings": settings, "clock": clock})


def told(found: ProbeResult) -> list[str]:
    assert all(one.hint for one in found.findings if one.verdict is not Verdict.PASS)
    return [f"{one.verdict} {one.code}: {one.message}" for one in found.findings]


@pytest.mark.parametrize(
    "query", [gps.GPS_MONITOR, gps.GPS_SETTINGS, gps.CLOCK_QUERY], ids=["monitor", "settings", "clock"]
)
@pytest.mark.parametrize("tree", trees.TREES, ids=trees.VERSIONS)
def test_every_version_has_the_queried_commands(tree: trees.Tree, query: Query) -> None:
    assert tree.has_command(query.menu, query.command)
    assert {name for name, _ in query.arguments} <= tree.arguments(query.menu, query.command)


def test_router_is_asked_for_monitor_settings_and_clock() -> None:
    asked = {"monitor": gps.GPS_MONITOR, "settings": gps.GPS_SETTINGS, "clock": gps.CLOCK_QUERY}
    assert PROBE.asks() == tuple(RouterOsQuery(name, "off-router", query) for name, query in asked.items())


LISTED: dict[str, list[str]] = yaml.safe_load(Path(__file__).with_name("gps_routeros.yml").read_text(encoding="utf-8"))
CASES: dict[str, dict[str, str] | None] = {
    "healthy": ROW,
    "healthy, before 7.1": {name: value for name, value in ROW.items() if name != "data-age"}
    | {"date-and-time": "nov/20/2026 10:15:00"},
    "healthy, in the time zone of the router": {**ROW, "date-and-time": "2026-11-20 11:14:59"},
    "the manual's sample": SAMPLE,
    "no fix": {"valid": "no", "satellites": "0", "latitude": "none", "longitude": "none", "data-age": "1s"},
    "no fix, and an unknown word": {**ROW, "valid": "perhaps"},
    "stale": {**ROW, "data-age": "1m4s"},
    "clock": {**ROW, "date-and-time": "2026-11-20 10:14:19"},
    "valid without a position": {**ROW, "latitude": "none", "longitude": "none"},
    "simulated": {**ROW, "fix-quality": "8"},
    "set by hand": {**ROW, "fix-quality": "7"},
    "no satellites": {**ROW, "satellites": "0"},
    "valid of no quality": {**ROW, "fix-quality": "0"},
    "swapped": {**ROW, "latitude": ROW["longitude"], "longitude": ROW["latitude"]},
    "in another time zone than the router": {**ROW, "date-and-time": "2026-11-20 09:14:59"},
    "of two hours ago": {**ROW, "date-and-time": "2026-11-20 08:04:59"},
    "no estimate worth the name": {**ROW, "horizontal-dilution": "99.9"},
    "dilution": {**ROW, "horizontal-dilution": "9.9"},
    "nothing": {},
    "garbage": {
        "latitude": "\x00",
        "longitude": "-",
        "valid": "yes",
        "satellites": "many",
        "date-and-time": "x",
        "data-age": "?",
    },
}


@for_each_row("case", CASES)
def test_findings_match_the_case(case: str) -> None:
    assert told(judged(CASES[case])) == LISTED[case]


def test_every_case_is_listed() -> None:
    assert list(LISTED) == list(CASES)


def test_missing_gps_package_is_reported() -> None:
    found = judged(None, Rows(None, rows=None))
    assert told(found) == ["FAIL driver-not-started: off-router has no menu `/system gps`"]
    assert found.findings[0].hint == "install the package gps for its RouterOS version"


def test_disabled_receiver_is_reported() -> None:
    found = judged({}, Rows(None, rows=({"enabled": "false"},)))
    assert told(found) == ["FAIL driver-not-started: the receiver of off-router is not switched on"]


def test_position_counts_without_settings() -> None:
    assert [one.code for one in judged(ROW, Rows(Trouble.SILENT, "no response")).findings] == ["fix"]


@pytest.mark.parametrize(
    ("trouble", "expected"),
    [
        (
            Trouble.NO_PLACE,
            ("INCONCLUSIVE place-not-reached: GPS of off-router was not read: off-router was not reached: no route"),
        ),
        (
            Trouble.SILENT,
            "INCONCLUSIVE no-answer: no response at off-router: Offshore is off, or not in the network",
        ),
    ],
)
def test_unreachable_router_is_reported(trouble: Trouble, expected: str) -> None:
    answer = Rows(trouble, "no route")
    assert told(PROBE.judge({"monitor": answer, "settings": answer, "clock": answer})) == [expected]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("41.686420", 41.68642),
        ("-8.838826", -8.838826),
        ("N 41 41' 11.112''", 41.68642),
        ("W 8 50' 19.7754''", -8.8388265),
        ("N 41 41.18520'", 41.68642),
        ("none", None),
        ("", None),
        ("41,686420", None),
        ("4 1 2 3", None),
    ],
)
def test_all_coordinate_formats_are_read(text: str, value: float | None) -> None:
    (report,) = gps.read_monitor(Rows(None, rows=({**ROW, "latitude": text},))).reports
    assert report.latitude == (None if value is None else pytest.approx(value, abs=1e-6))


def test_only_the_latest_position_is_available() -> None:
    found = judged(ROW, wanted=replace(WANTED, fence=Geofence(latitude=41.6864, longitude=-8.8388, radius_m=50.0)))
    assert {one.what: one.value for one in found.evidence}[
        "reports"
    ] == "1: a RouterOS device reports only its latest position"
    assert {one.what: one.value for one in found.evidence}["age of the last position"] == "1.0 s"


def test_time_zone_counts_only_if_the_router_reports_it() -> None:
    row = {**ROW, "date-and-time": "2026-11-20 11:14:59"}
    for clock in (Rows(None, rows=({"gmt-offset": "+00:00"},)), Rows(Trouble.SILENT), Rows(None, rows=())):
        assert told(judged(row, clock=clock)) == [
            "INCONCLUSIVE clock-differs: Offshore's receiver is 60 min ahead of the clock of this computer"
        ]


def test_position_without_a_compared_clock_does_not_pass() -> None:
    unheard = replace(ON, response_time=0.0, rows=(ROW,))
    found = PROBE.judge({"monitor": unheard, "settings": ON, "clock": CLOCK})
    assert told(found) == [
        "INCONCLUSIVE clock-unknown: the time of the receiver of Offshore was not compared with a clock"
    ]
