"""Radio regulation: allowed channels, power and radar checks of a country; and why two radios do not connect.

Europe: `/interface/wifi/radio/reg-info country=Latvia` as the manual prints it (Configuring outdoor CPE to AP links);
the countries of the CEPT share these rules (ERC/REC 70-03; EN 301 893). `no_country_set` of the older driver is "an FCC
compliant set of channels" (Manual, Wireless Interface). Other countries are unknown: there emulated radios stay silent,
unlike real ones.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.radio import _settings

if TYPE_CHECKING:
    from collections.abc import Iterator


_CEPT = frozenset(
    (
        *("austria", "belgium", "bulgaria", "croatia", "cyprus", "denmark", "estonia", "etsi", "finland"),
        *("france", "germany", "greece", "hungary", "iceland", "ireland", "italy", "latvia", "lithuania"),
        *("luxembourg", "malta", "netherlands", "norway", "poland", "portugal", "romania", "slovakia", "slovenia"),
        *("spain", "sweden", "switzerland"),
    )
)


@dataclass(frozen=True, slots=True)
class RadioRange:
    """A frequency range with one rule; the power is EIRP."""

    low_mhz: int
    high_mhz: int
    eirp_dbm: float
    indoor: bool = False
    dfs: bool = False


_EUROPE = (
    RadioRange(2402, 2482, 20.0),
    RadioRange(5170, 5250, 23.0, indoor=True),
    RadioRange(5250, 5330, 23.0, indoor=True, dfs=True),
    RadioRange(5490, 5730, 30.0, dfs=True),
    RadioRange(5735, 5875, 14.0),
)
_AMERICA = (
    RadioRange(2402, 2472, 30.0),
    RadioRange(5170, 5250, 30.0),
    RadioRange(5250, 5330, 24.0, dfs=True),
    RadioRange(5490, 5730, 24.0, dfs=True),
    RadioRange(5735, 5835, 30.0),
)
_UNLAWFUL = (RadioRange(2192, 2732, 40.0), RadioRange(4790, 6110, 40.0))
"""All frequencies supported by cards for 2 and 5 GHz."""


def span(frequency_mhz: int, width: str) -> tuple[int, int]:
    """Return the lowest and highest frequency of a channel whose control channel is `frequency_mhz`.

    `C` is the control channel, each `e` 20 MHz more on its side; without letters, or with `X`, they are above it.
    """
    narrow = re.fullmatch(r"(5|10|20)mhz", width)
    if narrow is not None:
        half = int(narrow[1]) // 2
        return frequency_mhz - half, frequency_mhz + half
    sizes, _, letters = width.partition("mhz-")
    below = letters.index("C") if "C" in letters else 0
    number = int(sizes.removesuffix("mhz").split("/")[-1].split("+")[0]) // 20
    low = frequency_mhz - 10 - 20 * below
    return low, low + 20 * number


def find_rule(
    country: str, frequency_mhz: int, width: str, *, outdoor: bool, lawless: bool = False
) -> RadioRange | None:
    """Return the rule that allows a channel, or None."""
    if lawless:
        rules: tuple[RadioRange, ...] = _UNLAWFUL
    elif country.lower() in _CEPT:
        rules = _EUROPE
    else:
        rules = _AMERICA if country == "no_country_set" else ()
    low, high = span(frequency_mhz, width)
    # A channel of 80 or 160 MHz may lie over two ranges that touch; the stricter rule holds, which is the one below.
    return next(
        (
            rule
            for rule in rules
            if rule.low_mhz <= low
            and _end(rules, rule) >= high
            and low < rule.high_mhz
            and not (outdoor and rule.indoor)
        ),
        None,
    )


def _end(rules: tuple[RadioRange, ...], rule: RadioRange) -> int:
    """Return the end of the adjacent ranges."""
    following = next((other for other in rules if other.low_mhz == rule.high_mhz), None)
    return rule.high_mhz if following is None else _end(rules, following)


_LIGHT_M_S = 299_792_458.0


def free_space_loss_db(distance_m: float, frequency_mhz: float) -> float:
    """Return the loss between two isotropic antennas in dB, at least 0."""
    return max(0.0, 20 * math.log10(4 * math.pi * distance_m * frequency_mhz * 1e6 / _LIGHT_M_S))


def signal_dbm(
    sender: _settings.RadioSettings, receiver: _settings.RadioSettings, frequency_mhz: int, air: _settings.Air
) -> float:
    """Return the level at which `receiver` receives `sender`."""
    rule = find_rule(sender.country, frequency_mhz, "20mhz", outdoor=False, lawless=sender.lawless)
    eirp = sender.power_dbm + sender.gain_dbi
    if rule is not None:
        eirp = min(eirp, rule.eirp_dbm)
    return eirp - free_space_loss_db(air.distance_m, frequency_mhz) - air.loss_db + receiver.gain_dbi


def why_not(settings: _settings.RadioSettings, other: _settings.RadioSettings, air: _settings.Air) -> str:
    """Return why two radios are not connected; empty if they can connect."""
    return next(_refusal_reasons(settings, other, air), "")


def _refusal_reasons(
    settings: _settings.RadioSettings, other: _settings.RadioSettings, air: _settings.Air
) -> Iterator[str]:
    if not (settings.is_enabled and other.is_enabled):
        yield "a radio is disabled"
    if settings.is_ap == other.is_ap:
        yield "both ends are access points" if settings.is_ap else "no end is an access point"
        return
    ap, station = (settings, other) if settings.is_ap else (other, settings)
    yield from _role_reasons(ap, station)
    if silent := why_silent(ap, air):
        yield silent
    yield from _channel_reasons(ap, station)
    if station.ssid not in ("", ap.ssid):
        yield "the network names differ"
    if _key(ap, ap.speaks) != _key(station, ap.speaks) and not _same_secret(ap, station):
        yield "the keys differ"
    yield from _list_reasons(ap, station)
    yield from _distance_reasons(ap, station, air)


def _role_reasons(ap: _settings.RadioSettings, station: _settings.RadioSettings) -> Iterator[str]:
    if ap.driver is not station.driver:
        yield "station-bridge does not work between the two drivers"
    if station.mode != "station-bridge" or not ap.bridges_stations:
        yield "the station does not bridge"
    if ap.speaks not in station.understands:
        yield "the protocols differ"


def why_silent(ap: _settings.RadioSettings, air: _settings.Air) -> str:
    """Return why an access point does not transmit on its channel; empty if it does."""
    low, high = span(ap.channel_mhz, ap.width or "20mhz")
    if not (air.lowest_mhz <= low and high <= air.highest_mhz) or ap.channel_mhz // 1000 != _settings.ghz_of(ap.band):
        return "the radio does not have this channel"
    if find_rule(ap.country, ap.channel_mhz, ap.width or "20mhz", outdoor=ap.outdoor, lawless=ap.lawless) is None:
        return "the country does not allow this channel"
    return "a radar is on this channel" if ap.channel_mhz in air.radar_mhz else ""


def _channel_reasons(ap: _settings.RadioSettings, station: _settings.RadioSettings) -> Iterator[str]:
    bands = _settings.standards_of(ap.band, ap.driver) & _settings.standards_of(station.band, station.driver)
    if _settings.ghz_of(ap.band) != _settings.ghz_of(station.band) or not bands:
        yield "the bands differ"
    if ap.width != station.width:
        yield "the channel widths differ"
    rule = find_rule(
        station.country, ap.channel_mhz, ap.width or "20mhz", outdoor=station.outdoor, lawless=station.lawless
    )
    if rule is None:
        yield "the station's country does not allow this channel"
    if station.scans is not None and not any(low <= ap.channel_mhz <= high for low, high in station.scans):
        yield "the station does not look on this channel"


def _key(radio: _settings.RadioSettings, protocol: str) -> tuple[object, ...]:
    """Return the credentials; nv2 uses `nv2-security` instead of the security profile (Manual, Nv2)."""
    return (radio.nv2_key,) if protocol == "nv2" else (radio.authentication, radio.passphrase)


def _same_secret(ap: _settings.RadioSettings, station: _settings.RadioSettings) -> bool:
    """Return whether both have a common authentication type and the same passphrase."""
    if ap.speaks == "nv2":
        return False
    return bool(ap.authentication & station.authentication) and ap.passphrase == station.passphrase


def _list_reasons(ap: _settings.RadioSettings, station: _settings.RadioSettings) -> Iterator[str]:
    for here, there in ((ap, station), (station, ap)):
        if there.mac not in here.admits and here.refuses & {there.mac, "*"}:
            yield "a list turns the other end away"


def _distance_reasons(
    ap: _settings.RadioSettings, station: _settings.RadioSettings, air: _settings.Air
) -> Iterator[str]:
    limits = [each.reach_km for each in (ap, station) if each.reach_km is not None]
    counts = ap.speaks == "nv2" or ap.driver is _settings.Driver.WIFI
    if counts and limits and air.distance_m > min(limits) * 1000:
        yield "ranging timeout: the ends are set to a shorter distance"
    weakest = min(signal_dbm(ap, station, ap.channel_mhz, air), signal_dbm(station, ap, ap.channel_mhz, air))
    if weakest < air.sensitivity_dbm:
        yield "the ends are too far apart"
