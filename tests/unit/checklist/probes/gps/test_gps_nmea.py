"""NMEA 0183: what a sentence is, what an epoch is, and that nothing whatever makes the reader fail."""

from datetime import UTC, datetime

import pytest
from gps_said import epoch, framed, gga, gsa, heard, nmea, rmc
from hypothesis import given
from hypothesis import strategies as some

from atlantis_netcfg.checklist.probes.gps.nmea import checksum, read, sentence
from atlantis_netcfg.checklist.probes.gps.record import Nature, Report

VIANA = (
    "$GPGGA,101500.00,,,,,0,00,99.99,,,,,,*63",
    "$GPRMC,101500.00,V,,,,,,,201126,,,N*7E",
    "$GPGSA,A,1,,,,,,,,,,,,,99.99,99.99,99.99*30",
    "$GPGGA,101520.00,4141.18520,N,00850.32959,W,1,09,0.9,5.0,M,54.0,M,,*7A",
    "$GPGGA,101559.00,4141.18520,N,00850.32959,W,4,09,0.9,5.0,M,54.0,M,,*71",
    "$GPRMC,101559.00,A,4141.18520,N,00850.32959,W,0.05,10.0,201126,,,R*53",
    "$GPGSA,A,3,01,02,03,04,05,06,07,08,09,,,,1.6,0.9,1.3*3F",
)
"""Made by hand, with valid checksums."""


def reports(*lines: bytes) -> tuple[Report, ...]:
    return read(heard([(0.1, b"".join(lines))])).reports


@pytest.mark.parametrize("line", VIANA)
def test_sentence_needs_a_correct_checksum(line: str) -> None:
    body, _, told = line[1:].partition("*")
    assert f"{checksum(body.encode()):02X}" == told
    assert sentence(line.encode()) == body.split(",")
    assert sentence(f"${body}".encode()) is None
    assert sentence(f"${body}*{(int(told, 16) + 1) % 256:02X}".encode()) is None


def test_three_epochs_are_three_reports() -> None:
    none, lone, fixed = reports(*[f"{line}\r\n".encode() for line in ("", *VIANA)])
    assert (none.mode, none.latitude, none.time) == (1, None, datetime(2026, 11, 20, 10, 15, tzinfo=UTC).timestamp())
    assert (lone.mode, lone.time, lone.of_day) == (3, None, 36920.0)
    assert fixed.has_fix
    assert fixed.latitude == pytest.approx(41.686420)
    assert fixed.longitude == pytest.approx(-8.8388265)
    assert fixed.time == datetime(2026, 11, 20, 10, 15, 59, tzinfo=UTC).timestamp()


@pytest.mark.parametrize("talker", ["GP", "GN", "GL", "GA", "GB", "GQ", "II"])
def test_any_talker_is_read(talker: str) -> None:
    (found,) = reports(gga(0, talker=talker), gsa(talker=talker), rmc(0, talker=talker))
    assert (found.mode, found.time is None) == (3, False)


@pytest.mark.parametrize("order", [(0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)])
def test_the_order_within_an_epoch_does_not_matter(order: tuple[int, int, int]) -> None:
    parts = (gga(0), rmc(0), gsa(3))
    found = reports(*[parts[place] for place in order])
    assert [(one.mode, one.latitude is None, one.time is None) for one in found] == [(3, False, False)]


@pytest.mark.parametrize(
    ("line", "mode"),
    [
        (gga(0), 3),
        (framed("GPGGA,101500.00,4141.18520,N,00850.32959,W,1,03,2.9,,M,,M,,"), 2),
        (rmc(0), 2),
        (rmc(0) + gsa(2), 2),
        (rmc(0) + gsa(3), 3),
        (gga(0) + gsa(1), 1),
        (gga(0, quality=0), None),
        (rmc(0, status="V"), 1),
        (gga(0) + rmc(0, status="V"), 1),
    ],
)
def test_mode_is_read_from_gsa_or_an_altitude(line: bytes, mode: int | None) -> None:
    (found,) = reports(b"\r\n", line)
    assert found.mode == (1 if mode is None else mode)


@pytest.mark.parametrize(
    ("quality", "indicator", "nature"),
    [
        (1, "A", Nature.MEASURED),
        (4, "R", Nature.MEASURED),
        (6, "E", Nature.DEAD_RECKONING),
        (7, "M", Nature.MANUAL),
        (8, "S", Nature.SIMULATED),
        (1, "E", Nature.DEAD_RECKONING),
        (8, "", Nature.SIMULATED),
    ],
)
def test_nature_of_a_position_is_read(quality: int, indicator: str, nature: Nature) -> None:
    (found,) = reports(epoch(0, quality=quality, mode=indicator))
    assert found.nature is nature


@pytest.mark.parametrize(
    ("date", "year"), [("201126", 2026), ("010180", 1980), ("311279", 2079), ("060199", 1999), ("320126", None)]
)
def test_nearer_century_is_chosen(date: str, year: int | None) -> None:
    (found,) = reports(framed(f"GPRMC,101500.00,A,4141.18520,N,00850.32959,W,0.05,10.0,{date},,,A"))
    assert (None if found.time is None else datetime.fromtimestamp(found.time, UTC).year) == year


def test_midnight_is_crossed_correctly() -> None:
    late = framed("GPRMC,235959.50,A,4141.18520,N,00850.32959,W,0.05,10.0,201126,,,A")
    early = framed("GPRMC,000000.50,A,4141.18520,N,00850.32959,W,0.05,10.0,211126,,,A")
    before, after = (found.time for found in reports(late, early))
    assert before is not None
    assert after is not None
    assert after - before == pytest.approx(1.0)


def test_cut_first_line_and_unfinished_last_line_are_ignored() -> None:
    found = read(heard([(0.1, b"185,N,1*00\r\n" + epoch(0) + gga(1)[:-9])]))
    assert (len(found.reports), found.good, found.bad) == (1, 3, 0)


def test_ais_and_proprietary_sentences_are_no_positions() -> None:
    others = framed("PUBX,00,101500.00,4141.18520,N") + b"!AIVDM,1,1,,A,14eG;o@034o8sd<L9i:a;WF>062D,0*7D\r\n"
    found = read(heard(nmea(others)))
    assert (found.reports, found.good, found.bad) == ((), 2, 0)


LINES = [gga(0), rmc(0), gsa(), epoch(1), gga(2, quality=0), framed("GPZDA,101500.00,20,11,2026,00,00"), framed("GP")]
FIELDS = some.text("0123456789.,-NSEWAVM*$", max_size=70)


@given(
    some.lists(
        some.one_of(
            some.sampled_from(LINES),
            some.binary(max_size=80),
            FIELDS.map(lambda fields: framed("GPGGA," + fields)),
            FIELDS.map(lambda fields: framed("GPRMC," + fields)),
            FIELDS.map(lambda fields: framed("GNGSA,A," + fields)),
            FIELDS.map(lambda fields: framed("GPZDA," + fields)),
        ),
        max_size=12,
    )
)
def test_no_stream_makes_the_reader_fail(pieces: list[bytes]) -> None:
    found = read(heard([(0.1 * place, piece) for place, piece in enumerate(pieces)]))
    assert found.good + found.bad <= b"".join(pieces).count(b"\n")
    assert all(report.mode in {None, 1, 2, 3} for report in found.reports)


@given(some.floats(-90, 90), some.floats(-180, 180))
def test_position_round_trips(latitude: float, longitude: float) -> None:
    def minutes(value: float, digits: int) -> str:
        whole, rest = divmod(round(abs(value) * 60 * 100_000), 60 * 100_000)
        return f"{whole:0{digits}}{rest / 100_000:08.5f}"

    north, east = "N" if latitude >= 0 else "S", "E" if longitude >= 0 else "W"
    (found,) = reports(gga(0, f"{minutes(latitude, 2)},{north},{minutes(longitude, 3)},{east}"))
    assert found.latitude == pytest.approx(latitude, abs=1e-6)
    assert found.longitude == pytest.approx(longitude, abs=1e-6)
