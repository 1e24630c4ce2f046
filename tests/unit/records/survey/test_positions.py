"""What counts as a position, and the words for what does not."""

from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.emulator.gnss import encode_reports
from atlantis_netcfg.records.survey.measure import parse_hourly_budget, parse_steps
from atlantis_netcfg.records.survey.positions import (
    GpsdStream,
    NoPosition,
    TrackPosition,
    parse_gpsd_address,
    parse_position,
)
from atlantis_netcfg.records.survey.site import TypedPositions

START = datetime(2026, 11, 20, 10, 15, tzinfo=UTC)
DEVICE = "/dev/ttyACM0"


def tpv(second: float = 0.0, **changes: Any) -> bytes:  # noqa: ANN401 - values of gpsd's JSON
    at = f"{START + timedelta(seconds=second):%Y-%m-%dT%H:%M:%S.%f}"[:-3] + "Z"
    report = {"class": "TPV", "device": DEVICE, "mode": 3, "time": at, "lat": 41.6864, "lon": -8.8388, "eph": 17.1}
    return encode_reports({name: value for name, value in {**report, **changes}.items() if value is not None})


def sky(hdop: float, device: str = DEVICE) -> bytes:
    return encode_reports({"class": "SKY", "device": device, "hdop": hdop, "uSat": 9, "nSat": 11})


def heard(*pieces: bytes, now_s: float = 0.0) -> TrackPosition | NoPosition:
    stream = GpsdStream()
    for piece in pieces:
        stream.feed(0.0, piece)
    return stream.position(now_s)


CASES: dict[str, tuple[tuple[bytes, ...], float, NoPosition | None]] = {
    "a fix": ((sky(0.9), tpv()), 0.5, None),
    "two dimensions": ((tpv(mode=2),), 0.5, None),
    "nothing": ((), 0.0, NoPosition.NO_REPORT),
    "no fix": ((tpv(mode=1, time=None, lat=None, lon=None),), 0.5, NoPosition.NO_FIX),
    "no fix, and then silence": ((tpv(mode=1, time=None, lat=None, lon=None),), 3.0, NoPosition.NO_REPORT),
    "a fix that is lost": ((tpv(), tpv(mode=1, time=None, lat=None, lon=None)), 0.5, NoPosition.NO_FIX),
    "a fix, and then silence": ((tpv(),), 2.5, NoPosition.OLD),
    "GGA alone has no time": ((tpv(time=None),), 0.5, NoPosition.NO_TIME),
    "bad geometry": ((sky(4.5), tpv()), 0.5, NoPosition.POOR),
    "a great error": ((tpv(eph=60.0),), 0.5, NoPosition.POOR),
    "the geometry of another receiver": ((sky(9.0, "/dev/ttyUSB0"), tpv()), 0.5, None),
    "simulated": ((tpv(status=8),), 0.5, NoPosition.NOT_MEASURED),
    "dead reckoning": ((tpv(status=5),), 0.5, NoPosition.NOT_MEASURED),
    "0, 0": ((tpv(lat=0.0, lon=0.0),), 0.5, NoPosition.NULL),
    "an impossible latitude": ((tpv(lat=141.0),), 0.5, NoPosition.NULL),
    "garbage": ((b"\xff\xfe\x00\n", b'{"class":"TPV"\n', b"[]\n"), 0.5, NoPosition.NO_REPORT),
}


@pytest.mark.parametrize("case", CASES)
def test_position_cases(case: str) -> None:
    pieces, now_s, reason = CASES[case]
    found = heard(*pieces, now_s=now_s)
    if reason is None:
        assert isinstance(found, TrackPosition)
        assert (found.latitude, found.longitude, found.age_s) == (41.6864, -8.8388, 0.5)
    else:
        assert found is reason


def test_repeated_position_becomes_old() -> None:
    stream = GpsdStream()
    for second in range(5):
        stream.feed(float(second), tpv(0.0))
    assert stream.position(2.0) != NoPosition.OLD
    assert stream.position(4.0) is NoPosition.OLD


def test_position_without_time_does_not_replace_a_complete_one() -> None:
    """Within an epoch gpsd tells the position of GGA first, without a time (seen with gpsd 3.22)."""
    stream = GpsdStream()
    stream.feed(0.0, tpv(0.0))
    stream.feed(1.0, tpv(1.0, time=None, lat=41.7))
    found = stream.position(1.0)
    assert isinstance(found, TrackPosition)
    assert (found.latitude, found.age_s) == (41.6864, 1.0)


def test_a_second_receiver_counts_once_the_first_is_silent() -> None:
    stream = GpsdStream()
    stream.feed(0.0, tpv(0.0))
    stream.feed(1.0, tpv(1.0, device="/dev/ttyUSB0", lat=41.7))
    first = stream.position(1.0)
    stream.feed(11.0, tpv(11.0, device="/dev/ttyUSB0", lat=41.7))
    second = stream.position(11.0)
    assert isinstance(first, TrackPosition)
    assert isinstance(second, TrackPosition)
    assert (first.latitude, second.latitude) == (41.6864, 41.7)


def test_stream_can_arrive_byte_by_byte() -> None:
    stream = GpsdStream()
    for byte in sky(0.9) + tpv():
        stream.feed(0.0, bytes([byte]))
    assert stream.position(0.0) == TrackPosition(41.6864, -8.8388, 0.0, 0.9)


def test_typed_positions_and_named_places() -> None:
    typed = TypedPositions()
    assert typed.position() is NoPosition.NOT_TYPED
    assert not typed.type("")
    assert typed.type("pier end: 41.6864, -8.8388")
    assert typed.type("41.7 -8.9")
    assert typed.position() == TrackPosition(41.7, -8.9)
    assert typed.type("pier end")
    assert typed.position() == TrackPosition(41.6864, -8.8388, place="pier end")
    assert typed.type("")
    assert not typed.type("quay")
    assert typed.position() == TrackPosition(41.6864, -8.8388, place="pier end")


@pytest.mark.parametrize("text", ["91, 0", "0, 181", "41.6864", "north", "41,6864, -8,8388", "1e3, 2"])
def test_invalid_position_text_is_rejected(text: str) -> None:
    assert parse_position(text, {}) is None


def test_gpsd_addresses_are_parsed() -> None:
    assert parse_gpsd_address("192.0.2.7") == ("192.0.2.7", 2947)
    assert parse_gpsd_address("gps.example.org:2948") == ("gps.example.org", 2948)
    assert parse_gpsd_address("[2001:db8::7]:2948") == ("2001:db8::7", 2948)
    for text in ("", "a b", "192.0.2.7:0", "192.0.2.7:65536", "192.0.2.7:x"):
        with pytest.raises(UsageError, match="` is not a gpsd address"):
            parse_gpsd_address(text)


def test_steps_are_parsed() -> None:
    assert parse_steps(None) == (50.0, 30.0)
    assert parse_steps("10s") == (None, 10.0)
    assert parse_steps("20m") == (20.0, 30.0)
    assert parse_steps("20m,5s") == (20.0, 5.0)
    for text in ("", "50", "50m,20m", "1s", "0.5m", "x"):
        with pytest.raises(UsageError, match=r"is not a valid interval|is too frequent"):
            parse_steps(text)


def test_hourly_budgets_are_parsed() -> None:
    assert parse_hourly_budget("0.5") == 500_000
    for text in ("0", "-1", "2.1", "x", "1e-1"):
        with pytest.raises(UsageError, match="is not a valid budget"):
            parse_hourly_budget(text)
