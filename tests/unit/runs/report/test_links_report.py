"""Links as text, JSON and exit code: all of it from the same data."""

from typing import Any

import pytest

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.runs.report.links import LinksReport


def bearer(**more: Any) -> dict[str, Any]:  # noqa: ANN401 - any field
    return {
        "kind": "lte",
        "state": "up",
        "active": False,
        "metered": False,
        "quality": {},
        "month_bytes": None,
        "findings": [],
        "box": "",
        "probe_bytes": 0,
        "month_since": None,
        "month_gaps": [],
        "standing": {"words": []},
        **more,
    }


def finding(verdict: str, hint: str | None = None) -> dict[str, Any]:
    return {"verdict": verdict, "code": "code", "message": "something is so", "hint": hint}


def report(*bearers: dict[str, Any], **more: Any) -> LinksReport:  # noqa: ANN401 - any field
    named = {f"link{number}": one for number, one in enumerate(bearers, start=1)}
    return LinksReport(
        **{
            "site": "quay",
            "title": "A quay",
            "is_rehearsal": False,
            "bearers": named,
            "queried_devices": ("r",),
            **more,
        }
    )


@pytest.mark.parametrize(
    ("verdicts", "code"),
    [
        ([], ExitCode.DONE),
        (["PASS", "WARN"], ExitCode.DONE),
        (["INCONCLUSIVE"], ExitCode.CHECKS_FAILED),
        (["WARN", "FAIL"], ExitCode.CHECKS_FAILED),
        (["ERROR"], ExitCode.CHECKS_FAILED),
    ],
)
def test_worst_finding_determines_the_exit_code(verdicts: list[str], code: ExitCode) -> None:
    assert report(bearer(), bearer(findings=[finding(one) for one in verdicts])).exit is code


def test_unreachable_device_fails_the_check() -> None:
    silent = {"device": "box", "message": "no response", "hint": None}
    assert report(bearer(), unreachable=[silent]).exit is ExitCode.CHECKS_FAILED


def test_report_without_any_queried_device_does_not_pass() -> None:
    nothing = report(bearer(active=True), queried_devices=())
    assert nothing.exit is ExitCode.NOTHING
    assert nothing.as_text().endswith("No device was queried, so nothing is known about quay")
    assert nothing.as_json()["exit"] == 7


@pytest.mark.parametrize(
    ("active", "metered", "said"),
    [
        ((True, False), True, "link1 carries the traffic of quay: it is the preferred link"),
        (
            (False, True),
            True,
            "link2 carries the traffic of quay: it is NOT the preferred link, which is link1; it is metered",
        ),
        ((False, True), False, "link2 carries the traffic of quay: it is NOT the preferred link, which is link1"),
        ((True, True), False, "link1 and link2 share the traffic of quay"),
        ((False, False), False, "NO LINK carries the traffic of quay"),
        ((None, None), False, "Which link carries the traffic of quay is not known: the router was not read"),
    ],
)
def test_last_line_names_the_active_link(active: tuple[bool | None, ...], metered: bool, said: str) -> None:  # noqa: FBT001 - a column of the table
    told = report(*(bearer(active=one, metered=metered) for one in active)).as_text()
    assert told.splitlines()[-1] == said


@pytest.mark.parametrize(
    ("month", "said"),
    [
        ({}, "not counted yet"),
        ({"month_bytes": 0, "month_since": "T"}, "0 B, counted since T"),
        ({"month_bytes": 999, "month_since": "T"}, "999 B, counted since T"),
        ({"month_bytes": 1000, "month_since": "T"}, "1.0 kB, counted since T"),
        ({"month_bytes": 10_000, "month_since": "T"}, "10 kB, counted since T"),
        ({"month_bytes": 999_499, "month_since": "T"}, "999 kB, counted since T"),
        ({"month_bytes": 999_500, "month_since": "T"}, "1.0 MB, counted since T"),
        (
            {"month_bytes": 61_400, "month_since": "T", "month_gaps": ["a"]},
            "61 kB, counted since T; at least: one gap in the count",
        ),
        (
            {"month_bytes": 12_400_000, "month_since": "T", "month_gaps": ["a", "b"]},
            "12.4 MB, counted since T; at least: 2 gaps in the count",
        ),
    ],
)
def test_monthly_bytes_are_shown(month: dict[str, Any], said: str) -> None:
    assert f"   this month    {said}" in report(bearer(**month)).as_text().splitlines()


def test_text_shows_local_time_and_json_utc() -> None:
    counted = report(bearer(month_bytes=999, month_since="2026-06-30 23:30 UTC"), time_zone="Europe/Lisbon")
    said = "   this month    999 B, counted since 2026-07-01 00:30 WEST (2026-06-30 23:30 UTC)"
    assert said in counted.as_text().splitlines()
    assert counted.as_json()["bearers"]["link1"]["month_since"] == "2026-06-30 23:30 UTC"


@pytest.mark.parametrize(
    ("kind", "quality", "lines"),
    [
        (
            "wifi_ptp",
            {"signal_dbm": -48.0, "signal_chain0_dbm": -50.0, "signal_chain1_dbm": None},
            ["signal        good, -48 dBm (chains -50)"],
        ),
        ("wifi_ptp", {"signal_dbm": -27.0}, ["signal        too strong, -27 dBm"]),
        (
            "wifi_ptp",
            {"signal_dbm": -70.0, "far_signal_dbm": -80.0},
            ["signal        fair, -70 dBm; the other end receives -80 dBm"],
        ),
        (
            "wifi_ptp",
            {"tx_rate_mbps": 54.0, "tx_ccq_percent": 34.0, "rx_ccq_percent": 36.0},
            ["rates         54 Mbit/s, CCQ 34/36 % sent/received"],
        ),
        ("lte", {"rsrp_dbm": -110.0, "sinr_db": 20.0}, ["signal        RSRP -110 dBm (poor), SINR 20 dB (good)"]),
        ("lte", {"registration": "sim_missing"}, ["network       sim missing"]),
        (
            "satellite",
            {"next_hop_seen": "no", "firmware": "1.2", "seen_by": "Ana", "seen_on": "2026-11-01"},
            ["terminal      has not responded to the router recently, firmware 1.2, seen by Ana on 2026-11-01"],
        ),
        ("satellite", {"next_hop_seen": "yes"}, ["terminal      responds to the router"]),
        (
            "satellite",
            {"kept_off_packets": 7, "kept_off_bytes": 4200},
            ["blocked       7 packets (4.2 kB) outside the allow-list"],
        ),
        ("ethernet", {"port": "ether1", "port_link": "down"}, ["port          ether1, link down"]),
        ("lte", {}, []),
    ],
)
def test_link_readings_are_shown_as_text(kind: str, quality: dict[str, Any], lines: list[str]) -> None:
    told = report(bearer(kind=kind, quality=quality)).as_text().splitlines()
    month = next(number for number, line in enumerate(told) if line.startswith("   this month"))
    assert [line.strip() for line in told[4:month]] == lines


def test_long_text_is_wrapped_at_console_width() -> None:
    told = report(bearer(findings=[finding("WARN", "do this " * 40)])).as_text()
    assert max(map(len, told.splitlines())) <= 120
    assert told.count("do this") == 40
