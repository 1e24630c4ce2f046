"""What `iw` prints of a station, in one record, and whether its channel and country are allowed.

`iw` prints text for people only, and says so (iw(8): "do not screenscrape"), but nothing else on a gateway tells the
level. Forms read: iw 4.14 to 6.7 (`link.c`, `station.c`, `interface.c`, `reg.c`); a line that is not understood is left
out, and what is missing is None.

The report agreed on 802.11a and 802.11g, which are 5 GHz and 2.4 GHz (2.4.1 swaps them). What may be used outdoors is
`site.channels`, from the decisions that hold in both countries of the pilot.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.core.verdicts import Verdict
from atlantis_netcfg.declaration import channels

if TYPE_CHECKING:
    from collections.abc import Iterator


_CONNECTED = re.compile(r"^Connected to ((?:[0-9a-f]{2}:){5}[0-9a-f]{2})\b", re.IGNORECASE | re.MULTILINE)
_FIELD = re.compile(r"^\s*([A-Za-z][A-Za-z ]*?):[ \t]*(.*?)[ \t]*$", re.MULTILINE)
_STATION = re.compile(r"^Station ((?:[0-9a-f]{2}:){5}[0-9a-f]{2})\b.*$", re.IGNORECASE | re.MULTILINE)
_LEVEL = re.compile(r"(-\d+)(?: \[([-\d, ]+)\])? dBm")
_RATE = re.compile(r"(\d+(?:\.\d+)?) MBit/s")
_MHZ = re.compile(r"(\d{4})(?:\.\d+)?")
_ESCAPED = re.compile(r"\\x([0-9a-fA-F]{2})")
_TYPE = re.compile(r"^\s*type (\S+)", re.MULTILINE)
_WIDTH = re.compile(r"width: (\d+) MHz")
_COUNTRY = re.compile(r"^country ([A-Z0-9]{2}):", re.MULTILINE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Link:
    """Answer of `iw dev INTERFACE link`."""

    bssid: str | None = None
    """Upper case; None: not associated."""
    ssid: str | None = None
    frequency_mhz: int | None = None
    signal_dbm: float | None = None
    rx_mbps: float | None = None
    tx_mbps: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Station:
    """What `iw dev INTERFACE station dump` says of one that is heard: for a client, its access point."""

    signal_dbm: float | None = None
    """Mean of the latest frames where the driver keeps one."""
    chains_dbm: tuple[float, ...] = ()
    rx_mbps: float | None = None
    tx_mbps: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Rules:
    """Answer of `iw reg get`: countries whose rules the radios obey, the system's own first; `00` is the world's."""

    countries: tuple[str, ...] = ()


def read_link(out: str) -> Link | None:
    """Read an association; None: the words are not understood."""
    if out.strip().startswith("Not connected"):
        return Link()
    found = _CONNECTED.search(out)
    if found is None:
        return None
    fields = dict(_fields(out))
    mhz = _MHZ.match(fields.get("freq", ""))
    return Link(
        bssid=found[1].upper(),
        ssid=_plain(fields["SSID"]) if "SSID" in fields else None,
        frequency_mhz=int(mhz[1]) if mhz else None,
        signal_dbm=_levels(fields.get("signal", ""))[0],
        rx_mbps=_rate(fields.get("rx bitrate", "")),
        tx_mbps=_rate(fields.get("tx bitrate", "")),
    )


def read_station(out: str, bssid: str) -> Station | None:
    """Read what is said of one; None: it is not in the list."""
    starts = [*_STATION.finditer(out)]
    for number, start in enumerate(starts):
        if start[1].upper() != bssid:
            continue
        end = starts[number + 1].start() if number + 1 < len(starts) else len(out)
        fields = dict(_fields(out[start.end() : end]))
        level, chains = _levels(fields.get("signal", ""))
        mean, _ = _levels(fields.get("signal avg", ""))
        return Station(
            signal_dbm=level if mean is None else mean,
            chains_dbm=chains,
            rx_mbps=_rate(fields.get("rx bitrate", "")),
            tx_mbps=_rate(fields.get("tx bitrate", "")),
        )
    return None


def read_type(out: str) -> str | None:
    """Read from `iw dev INTERFACE info` what the interface is: `managed`, `AP`, `monitor`."""
    found = _TYPE.search(out)
    return found[1] if found else None


def read_width(out: str) -> int | None:
    """Read the channel's width in MHz from `iw dev INTERFACE info`."""
    found = _WIDTH.search(out)
    return int(found[1]) if found else None


def read_rules(out: str) -> Rules:
    """Read the countries of the system and of each radio."""
    return Rules(countries=tuple(_COUNTRY.findall(out)))


def _fields(text: str) -> Iterator[tuple[str, str]]:
    """Yield what stands in a line of its own, the first of each name."""
    seen = set()
    for name, value in _FIELD.findall(text):
        if name not in seen:
            seen.add(name)
            yield name, value


def _levels(text: str) -> tuple[float | None, tuple[float, ...]]:
    """Read `-52 [-54, -57] dBm`; a level of 0 is what a driver writes that has none."""
    found = _LEVEL.match(text)
    if found is None:
        return None, ()
    chains = tuple(float(item) for item in re.findall(r"-\d+", found[2] or ""))
    return float(found[1]), chains


def _rate(text: str) -> float | None:
    found = _RATE.match(text)
    return float(found[1]) or None if found else None


def _plain(ssid: str) -> str:
    r"""Give a name as its owner wrote it: iw writes bytes that are not plain ASCII as `\xc3\xa9`."""
    raw = _ESCAPED.sub(lambda found: chr(int(found[1], 16)), ssid)
    return raw.encode("latin-1", "replace").decode("utf-8", "replace")


COUNTRIES = {"portugal": "PT", "belgium": "BE"}
"""RouterOS' word of a country to that of ISO 3166-1, which Linux has."""
_NO_COUNTRY = frozenset({"00", "98", "99"})
"""Of the whole world, the common part of several countries' rules, those of a driver's own (Linux, regulatory.c)."""
_BANDS = {"2ghz": (2400, 2500), "5ghz": (5150, 5900)}


def band_of(frequency_mhz: int) -> str | None:
    """Give the band in the words of `site.channels`; None: neither of the two."""
    return next((name for name, (low, high) in _BANDS.items() if low <= frequency_mhz < high), None)


def judge_channel(country: str, frequency_mhz: int | None, width_mhz: int | None, who: str) -> Iterator[Finding]:
    """Compare the channel with what may be used outdoors in the pilot's country."""
    if frequency_mhz is None:
        return
    band = band_of(frequency_mhz)
    if band is None:
        message = f"{who} is on {frequency_mhz} MHz, which is neither 2.4 nor 5 GHz"
        hint = "the pilot agreed on 802.11a and g: not every radio of it hears this band"
        yield Finding(Verdict.WARN, "band", message, hint)
    elif why := channels.why_illegal(country, band, frequency_mhz, width_mhz or 20, outdoors=True):
        message = f"{who} is on {frequency_mhz} MHz: {why}"
        hint = "set another channel at the vehicle before it goes outside: 5500 to 5700 MHz, or 2.4 GHz"
        yield Finding(Verdict.WARN, "channel-indoors", message, hint)


def judge_country(country: str, rules: Rules, where: str) -> Iterator[Finding]:
    """Compare the country that the computer's radios obey with the pilot's; who does not say is not judged."""
    expected = COUNTRIES[country]
    others = [item for item in rules.countries if item not in {expected, *_NO_COUNTRY}]
    hint = f"on it: sudo iw reg set {expected}, and `REGDOMAIN={expected}` in /etc/default/crda so that it stays"
    if others:
        message = f"the radio of {where} obeys the rules of {others[0]}, and the pilot is in {expected}"
        yield Finding(Verdict.WARN, "country-differs", message, hint)
    elif rules.countries and expected not in rules.countries:
        message = f"the radio of {where} obeys the rules of no single country, and the pilot is in {expected}"
        yield Finding(Verdict.WARN, "country-unset", message, hint)
