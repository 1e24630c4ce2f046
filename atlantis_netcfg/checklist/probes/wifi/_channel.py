"""On which channel an association is, and by whose rules: band, indoors only, the country of the computer's radio.

The report agreed on 802.11a and 802.11g, which are 5 GHz and 2.4 GHz (2.4.1 swaps them). What may be used outdoors is
`site.channels`, from the decisions that hold in both countries of the pilot.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.core.verdicts import Verdict
from atlantis_netcfg.declaration import channels

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.checklist.probes.wifi._iw import Rules

__all__ = ["COUNTRIES", "band_of", "judge_channel", "judge_country"]

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
