"""Radio channels allowed for a directional outdoor Wi-Fi bridge, as data.

5 GHz, all countries alike, because all follow the same harmonised decisions:

- 5150-5250 MHz: indoors; outdoors only without a fixed outdoor antenna, so never for a bridge.
- 5250-5350 MHz: indoors only.
- 5470-5725 MHz: indoors and outdoors, 1 W EIRP with transmit power control and 500 mW without, radar detection (DFS).
- 5725-5875 MHz: short-range devices, 25 mW EIRP, too little for a bridge.

2.4 GHz: 2400-2483.5 MHz, 100 mW EIRP, indoors and outdoors.

Sources: ECC Decision (04)08 and Commission Implementing Decision (EU) 2022/179 (it replaced 2005/513/EC) for RLANs at
5 GHz, ETSI EN 301 893; Decision 2006/771/EC and ETSI EN 300 440 for short-range devices; ETSI EN 300 328 for 2.4 GHz;
the entries PT and BE of wireless-regdb (`db.txt`), which agree with each other and with the above. The other countries
of the EU and EFTA apply the same decisions (ERC/REC 70-03, annex 3); their national deviations were not compared, so
their users are told to ask the authority. Channel blocks: IEEE 802.11, annex E. `frequency` is that of the control
channel, as in RouterOS.
"""

from __future__ import annotations

from dataclasses import dataclass

from atlantis_netcfg.core.messages import arg, msg


@dataclass(frozen=True, slots=True)
class Range:
    """A frequency range and its rule; bounds in MHz."""

    low: float
    high: float
    outdoors: bool
    indoors: bool
    eirp_dbm: float
    """Maximum radiated power, including antenna gain."""
    rule: str


_CEPT_5GHZ = (
    Range(5150, 5250, False, True, 23.0, "5150-5250 MHz is not for fixed outdoor antennas"),
    Range(5250, 5350, False, True, 23.0, "5250-5350 MHz is for indoor use only"),
    Range(5470, 5725, True, True, 30.0, "5470-5725 MHz"),
    Range(5725, 5875, False, False, 14.0, "5725-5875 MHz is for short-range devices of 25 mW only"),
)
_CEPT_2GHZ = (Range(2400, 2483.5, True, True, 20.0, "2400-2483.5 MHz"),)
UNKNOWN = "later"
"""Country whose rules are not known here: rehearsals use the European ones, real radios are refused."""
_COUNTRIES = (
    ("portugal", "PT", "Europe/Lisbon"),
    ("belgium", "BE", "Europe/Brussels"),
    ("austria", "AT", "Europe/Vienna"),
    ("bulgaria", "BG", "Europe/Sofia"),
    ("croatia", "HR", "Europe/Zagreb"),
    ("cyprus", "CY", "Asia/Nicosia"),
    ("denmark", "DK", "Europe/Copenhagen"),
    ("estonia", "EE", "Europe/Tallinn"),
    ("finland", "FI", "Europe/Helsinki"),
    ("france", "FR", "Europe/Paris"),
    ("germany", "DE", "Europe/Berlin"),
    ("greece", "GR", "Europe/Athens"),
    ("hungary", "HU", "Europe/Budapest"),
    ("iceland", "IS", "Atlantic/Reykjavik"),
    ("ireland", "IE", "Europe/Dublin"),
    ("italy", "IT", "Europe/Rome"),
    ("latvia", "LV", "Europe/Riga"),
    ("lithuania", "LT", "Europe/Vilnius"),
    ("luxembourg", "LU", "Europe/Luxembourg"),
    ("malta", "MT", "Europe/Malta"),
    ("netherlands", "NL", "Europe/Amsterdam"),
    ("norway", "NO", "Europe/Oslo"),
    ("poland", "PL", "Europe/Warsaw"),
    ("romania", "RO", "Europe/Bucharest"),
    ("slovakia", "SK", "Europe/Bratislava"),
    ("slovenia", "SI", "Europe/Ljubljana"),
    ("spain", "ES", "Europe/Madrid"),
    ("sweden", "SE", "Europe/Stockholm"),
    ("switzerland", "CH", "Europe/Zurich"),
    (UNKNOWN, "00", "UTC"),
)
COUNTRY_CODES: dict[str, str] = {name: code for name, code, _ in _COUNTRIES}
"""Country name in RouterOS to its ISO 3166-1 code, as used by Linux; 00 is the whole world."""
TIME_ZONES: dict[str, str] = {name: zone for name, _, zone in _COUNTRIES}
"""Country name in RouterOS to the time zone of its capital."""
RANGES: dict[str, dict[str, tuple[Range, ...]]] = {
    country: {"5ghz": _CEPT_5GHZ, "2ghz": _CEPT_2GHZ} for country in COUNTRY_CODES
}
"""Country name in RouterOS to ranges by band."""
CHANNELS: dict[str, tuple[int, ...]] = {
    "2ghz": tuple(range(2412, 2473, 5)),
    "5ghz": (*range(5180, 5321, 20), *range(5500, 5721, 20), *range(5745, 5866, 20)),
}
"""Control channels of 20 MHz by band: 1-13; 36-64, 100-144, 149-173."""
_ORIGINS = (5735, 5490, 5170)
"""Lower edges in MHz from which wider channels are counted."""
BANDS: dict[str, tuple[str, ...]] = {
    "802.11a": ("5ghz",),
    "802.11g": ("2ghz",),
    "802.11n": ("2ghz", "5ghz"),
    "802.11ac": ("5ghz",),
    "802.11ax": ("2ghz", "5ghz"),
}
"""Standard to its bands. The pilot's report (section 2.4.1) has a and g the wrong way round."""
WIDTHS: dict[str, tuple[int, ...]] = {
    "802.11a": (20,),
    "802.11g": (20,),
    "802.11n": (20, 40),
    "802.11ac": (20, 40, 80),
    "802.11ax": (20, 40, 80),
}
"""Standard to its channel widths in MHz, as far as the inventory supports them."""


def name_in_routeros(country: str) -> str:
    """Return the country whose rules a router applies: in a rehearsal with unknown rules, the default of RouterOS."""
    return "latvia" if country == UNKNOWN else country


def is_channel(band: str, frequency: int) -> bool:
    """Return whether a frequency is the centre of a control channel of the band."""
    return frequency in CHANNELS[band]


def legal(country: str, band: str, width: int, *, outdoors: bool) -> tuple[int, ...]:
    """Return the control channels allowed at a width."""
    return tuple(
        frequency
        for frequency in CHANNELS[band]
        if why_illegal(country, band, frequency, width, outdoors=outdoors) is None
    )


def why_illegal(country: str, band: str, frequency: int, width: int, *, outdoors: bool) -> str | None:
    """Return the rule that forbids a channel, or None; one allowed extension of the channel is enough."""
    reasons = [
        _explain_forbidden_channel(country, band, low, low + width, outdoors=outdoors)
        for low in _lower_edges(frequency, width)
    ]
    return None if None in reasons else reasons[0]


def lower_edge(country: str, band: str, frequency: int, width: int, *, outdoors: bool) -> float:
    """Return a channel's lower edge in MHz: of its possible extensions, the first that is allowed."""
    edges = _lower_edges(frequency, width)
    good = (
        edge
        for edge in edges
        if _explain_forbidden_channel(country, band, edge, edge + width, outdoors=outdoors) is None
    )
    return next(good, edges[0])


def eirp_dbm(country: str, band: str, frequency: int, width: int, *, outdoors: bool) -> float | None:
    """Return a channel's highest EIRP, antenna included; None if the channel is not allowed."""
    if why_illegal(country, band, frequency, width, outdoors=outdoors) is not None:
        return None
    low = lower_edge(country, band, frequency, width, outdoors=outdoors)
    return min(item.eirp_dbm for item in RANGES[country][band] if item.low < low + width and low < item.high)


def _explain_forbidden_channel(country: str, band: str, low: float, high: float, *, outdoors: bool) -> str | None:
    ranges = [item for item in RANGES[country][band] if item.low < high and low < item.high]
    for entry in ranges:
        if not (entry.outdoors if outdoors else entry.indoors):
            return entry.rule
    if not ranges or low < ranges[0].low or high > ranges[-1].high:
        return msg(f"the channel covers {arg(low):g} to {arg(high):g} MHz, beyond the end of the band")
    return None


def _lower_edges(frequency: int, width: int) -> tuple[float, ...]:
    """Return the lower edges of the blocks to which the control channel may belong."""
    first = frequency - 10
    origin = next((edge for edge in _ORIGINS if edge <= first), None)
    if origin is not None:
        return (origin + (first - origin) // width * width,)
    return (first, first - (width - 20)) if width > 20 else (first,)  # noqa: PLR2004 - one 20 MHz channel
