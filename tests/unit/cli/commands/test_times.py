"""Times for a person: the pilot's zone beside UTC, on both sides of the hour that is there twice or never."""

from datetime import UTC, datetime, timedelta, timezone

import pytest

from atlantis_netcfg.core.times import time_text

LISBON = "Europe/Lisbon"


@pytest.mark.parametrize(
    ("utc", "zone", "text"),
    [
        ("2026-11-25 15:37", LISBON, "2026-11-25 15:37 WET (15:37 UTC)"),
        ("2026-07-01 09:30", LISBON, "2026-07-01 10:30 WEST (09:30 UTC)"),
        ("2026-06-30 23:30", LISBON, "2026-07-01 00:30 WEST (2026-06-30 23:30 UTC)"),
        ("2026-12-31 23:30", "Europe/Paris", "2027-01-01 00:30 CET (2026-12-31 23:30 UTC)"),
        ("2026-01-01 00:30", "Atlantic/Azores", "2025-12-31 23:30 -01 (2026-01-01 00:30 UTC)"),
        ("2026-03-29 00:59", LISBON, "2026-03-29 00:59 WET (00:59 UTC)"),
        ("2026-03-29 01:00", LISBON, "2026-03-29 02:00 WEST (01:00 UTC)"),
        ("2026-10-25 00:30", LISBON, "2026-10-25 01:30 WEST (00:30 UTC)"),
        ("2026-10-25 01:30", LISBON, "2026-10-25 01:30 WET (01:30 UTC)"),
        ("2026-11-25 15:37", "", "2026-11-25 15:37 UTC"),
        ("2026-11-25 15:37", "UTC", "2026-11-25 15:37 UTC"),
        ("2026-11-25 15:37", "Etc/UTC", "2026-11-25 15:37 UTC"),
        ("2026-11-25 15:37", "Europe/Atlantis", "2026-11-25 15:37 UTC"),
        ("2026-11-25 15:37", "../../etc/passwd", "2026-11-25 15:37 UTC"),
        ("2026-11-25 15:37", "Europe", "2026-11-25 15:37 UTC"),
    ],
)
def test_local_and_utc_time_are_shown(utc: str, zone: str, text: str) -> None:
    assert time_text(datetime.fromisoformat(f"{utc}+00:00"), zone) == text


def test_time_of_another_zone_is_converted() -> None:
    at = datetime(2026, 11, 25, 17, 37, tzinfo=timezone(timedelta(hours=2)))
    assert time_text(at, LISBON) == time_text(at.astimezone(UTC), LISBON) == "2026-11-25 15:37 WET (15:37 UTC)"


def test_time_without_a_zone_is_marked() -> None:
    assert time_text(datetime(2026, 11, 25, 15, 37), LISBON) == "2026-11-25 15:37 (time zone unknown)"  # noqa: DTZ001
