"""Do two radios find each other, as they are set? If not: the first reason, in our words.

Stricter than the device where it is cheap to be: the device lets a station of 20 MHz join a wider access point.
Sources: Manual, Wireless Interface (protocols, nv2); Manual, Wireless Station Modes (`station-bridge`); Manual, WiFi.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.radio._budget import signal_dbm
from atlantis_netcfg.emulator.routeros.radio._law import span, within
from atlantis_netcfg.emulator.routeros.radio._settings import Driver, Settings, ghz_of, standards_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.emulator.routeros.radio._spec import Air

__all__ = ["why_not", "why_silent"]


def why_not(one: Settings, other: Settings, air: Air) -> str:
    """Return why the two are not connected; empty: they agree."""
    return next(_reasons(one, other, air), "")


def _reasons(one: Settings, other: Settings, air: Air) -> Iterator[str]:
    if not (one.enabled and other.enabled):
        yield "a radio is disabled"
    if one.is_ap == other.is_ap:
        yield "both ends are access points" if one.is_ap else "no end is an access point"
        return
    ap, station = (one, other) if one.is_ap else (other, one)
    yield from _roles(ap, station)
    if silent := why_silent(ap, air):
        yield silent
    yield from _channel(ap, station)
    if station.ssid not in ("", ap.ssid):
        yield "the network names differ"
    if _key(ap, ap.speaks) != _key(station, ap.speaks) and not _same_secret(ap, station):
        yield "the keys differ"
    yield from _lists(ap, station)
    yield from _distance(ap, station, air)


def _roles(ap: Settings, station: Settings) -> Iterator[str]:
    if ap.driver is not station.driver:
        yield "station-bridge does not work between the two drivers"
    if station.mode != "station-bridge" or not ap.bridges_stations:
        yield "the station does not bridge"
    if ap.speaks not in station.understands:
        yield "the protocols differ"


def why_silent(ap: Settings, air: Air) -> str:
    """Return why an access point does not speak on its channel; empty: it does."""
    low, high = span(ap.channel_mhz, ap.width or "20mhz")
    if not (air.lowest_mhz <= low and high <= air.highest_mhz) or ap.channel_mhz // 1000 != ghz_of(ap.band):
        return "the radio does not have this channel"
    if within(ap.country, ap.channel_mhz, ap.width or "20mhz", outdoor=ap.outdoor, lawless=ap.lawless) is None:
        return "the country does not allow this channel"
    return "a radar is on this channel" if ap.channel_mhz in air.radar_mhz else ""


def _channel(ap: Settings, station: Settings) -> Iterator[str]:
    bands = standards_of(ap.band, ap.driver) & standards_of(station.band, station.driver)
    if ghz_of(ap.band) != ghz_of(station.band) or not bands:
        yield "the bands differ"
    if ap.width != station.width:
        yield "the channel widths differ"
    rule = within(
        station.country, ap.channel_mhz, ap.width or "20mhz", outdoor=station.outdoor, lawless=station.lawless
    )
    if rule is None:
        yield "the station's country does not allow this channel"
    if station.scans is not None and not any(low <= ap.channel_mhz <= high for low, high in station.scans):
        yield "the station does not look on this channel"


def _key(radio: Settings, protocol: str) -> tuple[object, ...]:
    """With nv2 the security profile is not used, but `nv2-security` (Manual, Nv2)."""
    return (radio.nv2_key,) if protocol == "nv2" else (radio.authentication, radio.passphrase)


def _same_secret(ap: Settings, station: Settings) -> bool:
    """One way of authentication in common is enough, with the same passphrase."""
    if ap.speaks == "nv2":
        return False
    return bool(ap.authentication & station.authentication) and ap.passphrase == station.passphrase


def _lists(ap: Settings, station: Settings) -> Iterator[str]:
    for here, there in ((ap, station), (station, ap)):
        if there.mac not in here.admits and here.refuses & {there.mac, "*"}:
            yield "a list turns the other end away"


def _distance(ap: Settings, station: Settings, air: Air) -> Iterator[str]:
    limits = [each.reach_km for each in (ap, station) if each.reach_km is not None]
    counts = ap.speaks == "nv2" or ap.driver is Driver.WIFI
    if counts and limits and air.distance_m > min(limits) * 1000:
        yield "ranging timeout: the ends are set to a shorter distance"
    weakest = min(signal_dbm(ap, station, ap.channel_mhz, air), signal_dbm(station, ap, ap.channel_mhz, air))
    if weakest < air.sensitivity_dbm:
        yield "the ends are too far apart"
