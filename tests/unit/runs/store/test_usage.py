"""Bytes of a month out of counters that forget: looks, restarts, resets, other ports, two processes, a torn disk."""

import json
import stat
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from atlantis_netcfg.runs import Counters, DamagedStateError, JournalError, MonthBytes, Store, Usage

NOON = datetime(2026, 11, 21, 12, tzinfo=UTC)


def look(  # noqa: PLR0913 - each is one thing that a look sees
    rx: int, tx: int, *, after_s: float = 0.0, uptime_s: float | None = None, port: str = "ether3", device: str = "r"
) -> Counters:
    at = NOON + timedelta(seconds=after_s)
    return Counters(device=device, interface=port, rx_bytes=rx, tx_bytes=tx, at=at, uptime_s=uptime_s)


@pytest.fixture
def usage(tmp_path: Path) -> Usage:
    return Store(tmp_path).usage("coastal")


def test_no_reading_means_unknown_usage(usage: Usage) -> None:
    assert usage.month("satellite", NOON) == MonthBytes(None, None, ())
    assert usage.last("satellite") is None


def test_monthly_usage_is_the_sum_of_counter_increases(usage: Usage) -> None:
    assert usage.record("satellite", look(1000, 500, uptime_s=100)) is None
    assert usage.month("satellite", NOON) == MonthBytes(0, NOON, ())
    assert usage.record("satellite", look(1700, 600, after_s=60, uptime_s=160)) == 800
    assert usage.record("satellite", look(1700, 600, after_s=90, uptime_s=190)) == 0
    assert usage.record("satellite", look(2700, 600, after_s=120, uptime_s=220)) == 1000
    assert usage.month("satellite", NOON) == MonthBytes(1800, NOON, ())
    assert usage.month("4g", NOON) == MonthBytes()


def test_restart_is_detected_and_the_gap_named(usage: Usage) -> None:
    usage.record("satellite", look(9000, 9000, uptime_s=50_000))
    assert usage.record("satellite", look(300, 200, after_s=600, uptime_s=60)) == 500
    month = usage.month("satellite", NOON)
    assert (month.bytes, month.since) == (500, NOON)
    when, what = month.gaps[0].split(" UTC the ")
    assert when == "between 2026-11-21 12:00 UTC and 2026-11-21 12:10"
    assert what == "router restarted: traffic before that is not counted"
    assert len(month.gaps) == 1


def test_early_restart_is_detected_despite_a_longer_uptime(usage: Usage) -> None:
    usage.record("satellite", look(9000, 9000, uptime_s=60))
    assert usage.record("satellite", look(300, 20_000, after_s=7200, uptime_s=3600)) == 20_300
    assert "the router restarted: " in usage.month("satellite", NOON).gaps[0]


def test_restart_or_clock_change_counts_the_smaller_amount(usage: Usage) -> None:
    usage.record("satellite", look(9000, 9000, uptime_s=60))
    assert usage.record("satellite", look(10_000, 20_000, after_s=7200, uptime_s=3600)) == 12_000
    assert "or the clock of this computer was set" in usage.month("satellite", NOON).gaps[0]


def test_late_response_is_not_taken_for_a_restart(usage: Usage) -> None:
    usage.record("satellite", look(9000, 9000, uptime_s=1000))
    assert usage.record("satellite", look(9100, 9000, after_s=100, uptime_s=1020)) == 100
    assert usage.month("satellite", NOON).gaps == ()


@pytest.mark.parametrize("uptimes", [(1000, 1060), (None, 1060), (1000, None)])
def test_counters_that_were_reset_are_noticed(usage: Usage, uptimes: tuple[float | None, float | None]) -> None:
    usage.record("satellite", look(9000, 9000, uptime_s=uptimes[0]))
    assert usage.record("satellite", look(9500, 10, after_s=60, uptime_s=uptimes[1])) == 9510
    assert "the counters were reset or overflowed" in usage.month("satellite", NOON).gaps[0]


def test_new_port_or_router_starts_counting_from_its_own_reading(usage: Usage) -> None:
    usage.record("satellite", look(9000, 9000))
    assert usage.record("satellite", look(9500, 9500, after_s=60, port="ether4")) is None
    assert usage.record("satellite", look(9600, 9500, after_s=90, port="ether4")) == 100
    assert usage.record("satellite", look(9900, 9900, after_s=99, port="ether4", device="spare")) is None
    month = usage.month("satellite", NOON)
    assert month.bytes == 100
    assert [gap.split(": ")[0].split("the link ")[1] for gap in month.gaps] == [
        "moved from ether3 of r to ether4 of r",
        "moved from ether4 of r to ether4 of spare",
    ]


def test_months_are_utc_and_a_spanning_increase_counts_in_the_later_one(usage: Usage) -> None:
    until_december = (datetime(2026, 12, 1, tzinfo=UTC) - NOON).total_seconds()
    usage.record("satellite", look(1000, 0))
    usage.record("satellite", look(1500, 0, after_s=until_december - 1))
    usage.record("satellite", look(1800, 0, after_s=until_december))
    last_second = NOON + timedelta(seconds=until_december - 1)
    assert usage.month("satellite", NOON) == MonthBytes(500, NOON, ())
    assert usage.month("satellite", last_second + timedelta(seconds=1)) == MonthBytes(300, last_second, ())


def test_old_months_are_removed(usage: Usage, tmp_path: Path) -> None:
    for number in range(20):
        usage.record("satellite", look(number, 0, after_s=number * 31 * 86400))
    kept = json.loads((tmp_path / "real" / "coastal" / "usage.json").read_text())["bearers"]["satellite"]["months"]
    assert len(kept) == 13
    assert max(kept) == f"{NOON + timedelta(days=19 * 31):%Y-%m}"


def test_rehearsals_have_separate_usage(tmp_path: Path) -> None:
    real, rehearsed = Store(tmp_path).usage("coastal"), Store(tmp_path, is_rehearsal=True).usage("coastal")
    real.record("satellite", look(1, 1))
    rehearsed.record("satellite", look(5, 5))
    assert rehearsed.record("satellite", look(9, 9, after_s=1)) == 8
    assert real.month("satellite", NOON).bytes == 0


def test_usage_file_is_private(usage: Usage, tmp_path: Path) -> None:
    usage.record("satellite", look(1, 1))
    assert stat.S_IMODE((tmp_path / "real" / "coastal" / "usage.json").stat().st_mode) == 0o600


@pytest.mark.parametrize("text", ["", "{", "[]", '{"bearers": {"satellite": {"months": {}}}}', '{"bearers": 1}'])
def test_damaged_file_is_reported_and_left_unchanged(usage: Usage, tmp_path: Path, text: str) -> None:
    path = tmp_path / "real" / "coastal" / "usage.json"
    path.parent.mkdir(parents=True)
    path.write_text(text)
    with pytest.raises(DamagedStateError, match="the data usage of this month cannot be read"):
        usage.record("satellite", look(1, 1))
    with pytest.raises(DamagedStateError):
        usage.month("satellite", NOON)
    assert path.read_text() == text


def test_unwritable_folder_is_reported(tmp_path: Path) -> None:
    (tmp_path / "real").write_text("a file")
    with pytest.raises(JournalError, match="the data usage of this month cannot be written"):
        Store(tmp_path).usage("coastal").record("satellite", look(1, 1))


WRITER = """
import sys
from datetime import UTC, datetime
from pathlib import Path
from atlantis_netcfg.runs import Counters, Store

usage = Store(Path(sys.argv[1])).usage("coastal")
for number in range(20):
    at = datetime(2026, 11, 21, 12, tzinfo=UTC)
    usage.record(sys.argv[2], Counters(device="r", interface="p", rx_bytes=number, tx_bytes=0, at=at))
"""


def test_concurrent_processes_lose_no_usage(tmp_path: Path) -> None:
    names = ("satellite", "4g")
    commands = [[sys.executable, "-c", WRITER, str(tmp_path), name] for name in names]
    processes = [subprocess.Popen(command) for command in commands]
    assert [process.wait() for process in processes] == [0, 0]
    usage = Store(tmp_path).usage("coastal")
    assert [usage.month(name, NOON).bytes for name in names] == [19, 19]


@given(st.lists(st.tuples(st.integers(0, 10**9), st.integers(0, 10**9)), min_size=2, max_size=8))
def test_counters_that_only_rise_are_counted_to_the_byte(
    tmp_path_factory: pytest.TempPathFactory, rises: list[tuple[int, int]]
) -> None:
    usage = Store(tmp_path_factory.mktemp("usage")).usage("coastal")
    rx = tx = 0
    for number, (more_rx, more_tx) in enumerate(rises):
        rx, tx = rx + more_rx, tx + more_tx
        usage.record("satellite", look(rx, tx, after_s=number, uptime_s=100 + number))
    assert usage.month("satellite", NOON) == MonthBytes(sum(map(sum, rises[1:])), NOON, ())
