import zoneinfo
from typing import get_args

import pytest

from atlantis_netcfg.emulator.routeros.radio._law import find_rule
from atlantis_netcfg.inventory.channels import (
    BANDS,
    COUNTRY_CODES,
    RANGES,
    TIME_ZONES,
    WIDTHS,
    eirp_dbm,
    is_channel,
    legal,
    name_in_routeros,
    why_illegal,
)
from atlantis_netcfg.inventory.model import Country


@pytest.mark.parametrize("country", ["portugal", "belgium", "spain", "greece", "norway"])
@pytest.mark.parametrize(
    ("width", "channels"),
    [
        (20, (5500, 5520, 5540, 5560, 5580, 5600, 5620, 5640, 5660, 5680, 5700)),
        (40, (5500, 5520, 5540, 5560, 5580, 5600, 5620, 5640, 5660, 5680)),
        (80, (5500, 5520, 5540, 5560, 5580, 5600, 5620, 5640)),
    ],
)
def test_outdoor_channels_at_5_ghz(country: str, width: int, channels: tuple[int, ...]) -> None:
    assert legal(country, "5ghz", width, outdoors=True) == channels


def test_indoor_channels_at_5_ghz() -> None:
    indoors = legal("portugal", "5ghz", 80, outdoors=False)
    assert indoors[:8] == (5180, 5200, 5220, 5240, 5260, 5280, 5300, 5320)
    assert indoors[8:] == legal("portugal", "5ghz", 80, outdoors=True)


def test_channels_at_2_4_ghz() -> None:
    assert legal("portugal", "2ghz", 20, outdoors=True) == tuple(range(2412, 2473, 5))
    assert legal("portugal", "2ghz", 40, outdoors=True) == tuple(range(2412, 2473, 5))


@pytest.mark.parametrize(
    ("frequency", "width", "rule"),
    [
        (5180, 20, "5150-5250 MHz is not for fixed outdoor antennas"),
        (5320, 20, "5250-5350 MHz is for indoor use only"),
        (5720, 20, "5725-5875 MHz is for short-range devices of 25 mW only"),
        (5700, 40, "5725-5875 MHz is for short-range devices of 25 mW only"),
        (5865, 20, "5725-5875 MHz is for short-range devices of 25 mW only"),
        (5500, 20, None),
        (5640, 80, None),
    ],
)
def test_violated_rule_is_named(frequency: int, width: int, rule: str | None) -> None:
    assert why_illegal("portugal", "5ghz", frequency, width, outdoors=True) == rule


def test_channel_beyond_the_end_of_the_band() -> None:
    said = why_illegal("belgium", "2ghz", 2472, 100, outdoors=True)
    assert said == "the channel covers 2462 to 2562 MHz, beyond the end of the band"


@pytest.mark.parametrize(
    ("band", "frequency", "known"), [("5ghz", 5510, False), ("5ghz", 5500, True), ("2ghz", 5500, False)]
)
def test_channel_grid(band: str, frequency: int, known: bool) -> None:  # noqa: FBT001
    assert is_channel(band, frequency) is known


def test_a_is_5_ghz_and_g_is_2_4_ghz() -> None:
    assert (BANDS["802.11a"], BANDS["802.11g"]) == (("5ghz",), ("2ghz",))


def test_tables_cover_the_model_values() -> None:
    assert BANDS.keys() == WIDTHS.keys()
    countries = {country for names in get_args(Country) for country in get_args(names) or (names,)}
    assert {"portugal", "belgium", "spain", "norway"} < countries
    assert RANGES.keys() == countries
    assert all(bands.keys() == {"2ghz", "5ghz"} for bands in RANGES.values())
    assert COUNTRY_CODES.keys() == TIME_ZONES.keys() == countries
    assert sorted(len(code) for code in {*COUNTRY_CODES.values()}) == [2] * len(countries)
    assert {*TIME_ZONES.values()} <= zoneinfo.available_timezones()


def test_emulated_radios_know_every_country() -> None:
    for country in COUNTRY_CODES:
        rule = find_rule(name_in_routeros(country), 5500, "20mhz", outdoor=True)
        assert rule is not None
        assert rule.eirp_dbm == eirp_dbm(country, "5ghz", 5500, 20, outdoors=True)
