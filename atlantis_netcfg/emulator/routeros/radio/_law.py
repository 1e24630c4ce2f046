"""Which channels a country allows, how strong, and whether an access point has to listen for radar first.

Europe: `/interface/wifi/radio/reg-info country=Latvia` as the manual prints it (Configuring outdoor CPE to AP links);
the countries of the CEPT share these rules (ERC/REC 70-03; EN 301 893). `no_country_set` of the older driver is "an FCC
compliant set of channels" (Manual, Wireless Interface). Of other countries the twin knows nothing, and its radios stay
silent there, where real ones would not.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

__all__ = ["Range", "span", "within"]

_CEPT = frozenset(
    (
        *("austria", "belgium", "bulgaria", "croatia", "cyprus", "denmark", "estonia", "etsi", "finland"),
        *("france", "germany", "greece", "hungary", "iceland", "ireland", "italy", "latvia", "lithuania"),
        *("luxembourg", "malta", "netherlands", "norway", "poland", "portugal", "romania", "slovakia", "slovenia"),
        *("spain", "sweden", "switzerland"),
    )
)


@dataclass(frozen=True, slots=True)
class Range:
    """Frequencies with one rule; the power is EIRP."""

    low_mhz: int
    high_mhz: int
    eirp_dbm: float
    indoor: bool = False
    dfs: bool = False


_EUROPE = (
    Range(2402, 2482, 20.0),
    Range(5170, 5250, 23.0, indoor=True),
    Range(5250, 5330, 23.0, indoor=True, dfs=True),
    Range(5490, 5730, 30.0, dfs=True),
    Range(5735, 5875, 14.0),
)
_AMERICA = (
    Range(2402, 2472, 30.0),
    Range(5170, 5250, 30.0),
    Range(5250, 5330, 24.0, dfs=True),
    Range(5490, 5730, 24.0, dfs=True),
    Range(5735, 5835, 30.0),
)
_UNLAWFUL = (Range(2192, 2732, 40.0), Range(4790, 6110, 40.0))
"""Everything that cards of 2 and 5 GHz can."""


def span(frequency_mhz: int, width: str) -> tuple[int, int]:
    """Return the lowest and highest frequency of a channel whose control channel is `frequency_mhz`.

    `C` is the control channel, each `e` 20 MHz more on its side; without letters, or with `X`, they lie above.
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


def within(country: str, frequency_mhz: int, width: str, *, outdoor: bool, lawless: bool = False) -> Range | None:
    """Return the rule under which a channel may be used; None: it may not."""
    if lawless:
        rules: tuple[Range, ...] = _UNLAWFUL
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


def _end(rules: tuple[Range, ...], rule: Range) -> int:
    """Return where the ranges that touch this one end."""
    following = next((other for other in rules if other.low_mhz == rule.high_mhz), None)
    return rule.high_mhz if following is None else _end(rules, following)
