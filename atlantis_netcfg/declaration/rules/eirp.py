"""How strong the radios of a bridge are: within the law, and neither too weak nor too strong for the other end.

Levels are those of free space, where a real link is some decibels weaker: 20 log10(4 pi d / wavelength) is lost between
the antennas (ITU-R P.525). Receivers are also spoilt by too much: on a link of 150 m full power overdrives them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from atlantis_netcfg.declaration import channels
from atlantis_netcfg.declaration._draft import Draft, Part, Rule
from atlantis_netcfg.declaration.model import Cpe, Ptp

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.declaration.findings import Finding

__all__ = ["RULES"]

_SHORT_M = 500
_LIGHT_M_S = 299_792_458.0
_AIM_DBM = -50
"""In the middle of what is healthy, for the power that a hint names."""


def _radios(draft: Draft) -> Iterator[tuple[str, Part, Ptp]]:
    for host, _, cpe in draft.boxes(Cpe):
        yield host, Part("device", host), cpe.ptp


def _lost_db(ptp: Ptp, distance_m: int) -> float:
    return 20 * math.log10(4 * math.pi * distance_m * ptp.frequency_mhz * 1e6 / _LIGHT_M_S)


def bounds(draft: Draft) -> Iterator[Finding]:
    """The weakest level is below the strongest."""
    for _, part, ptp in _radios(draft):
        if ptp.signal.weakest_dbm >= ptp.signal.strongest_dbm:
            message = f"the weakest level, {ptp.signal.weakest_dbm} dBm, is not below the strongest"
            message += f", {ptp.signal.strongest_dbm} dBm"
            yield draft.wrong(part, ("ptp", "signal"), message, "exchange them: -75 dBm is weaker than -35 dBm")


def eirp(draft: Draft) -> Iterator[Finding]:
    """What is radiated (EIRP: power and antenna gain together) is within the country's limit for the channel."""
    for _, part, ptp in _radios(draft):
        if ptp.tx_power_dbm is None or ptp.antenna_gain_dbi is None:
            continue
        limit = channels.eirp_dbm(ptp.country, ptp.band, ptp.frequency_mhz, ptp.width_mhz, outdoors=ptp.outdoor)
        if limit is not None and ptp.tx_power_dbm + ptp.antenna_gain_dbi > limit:
            message = f"{ptp.tx_power_dbm} dBm with an antenna of {ptp.antenna_gain_dbi} dBi radiates"
            message += f" {ptp.tx_power_dbm + ptp.antenna_gain_dbi} dBm; {ptp.country} allows {limit:g} dBm"
            message += f" at {ptp.frequency_mhz} MHz"
            most = int(limit) - ptp.antenna_gain_dbi
            hint = f"write `tx_power_dbm: {most}` or less" if most >= 0 else "take an antenna with less gain"
            yield draft.wrong(part, ("ptp", "tx_power_dbm"), message, hint)


def short_link(draft: Draft) -> Iterator[Finding]:
    """On a short link the power is declared: left to the country's limit it overdrives the other receiver."""
    for _, part, ptp in _radios(draft):
        if ptp.distance_m is None or ptp.distance_m >= _SHORT_M or ptp.tx_power_dbm is not None:
            continue
        message = f"over {ptp.distance_m} m full power overdrives the other receiver: `tx_power_dbm` has to be declared"
        yield draft.wrong(part, ("ptp", "distance_m"), message, _power(ptp, ptp.distance_m))


def _power(ptp: Ptp, distance_m: int) -> str:
    """Name the power that would be heard well, should both ends have this antenna, as far as the law allows it."""
    gain = ptp.antenna_gain_dbi
    if gain is None:
        return "write the antenna's gain as `antenna_gain_dbi`, and `tx_power_dbm`: start low, like 5"
    between = 2 * gain - _lost_db(ptp, distance_m)
    limit = channels.eirp_dbm(ptp.country, ptp.band, ptp.frequency_mhz, ptp.width_mhz, outdoors=ptp.outdoor)
    power = max(0, round(_AIM_DBM - between))
    if limit is not None and power + gain > limit:
        most = max(0, int(limit) - gain)
        return f"the law allows `tx_power_dbm: {most}`, heard at about {most + between:.0f} dBm: take larger antennas"
    return f"write `tx_power_dbm: {power}`, which the other end hears at about {power + between:.0f} dBm in free space"


def level(draft: Draft) -> Iterator[Finding]:
    """In free space the other end hears a level within the bounds that it declares."""
    for host, part, ptp in _radios(draft):
        other = draft.devices.get(ptp.peer)
        distance_m = ptp.distance_m
        if not isinstance(other, Cpe) or other.ptp.peer != host or distance_m is None:
            continue
        gains = (ptp.antenna_gain_dbi, other.ptp.antenna_gain_dbi)
        if ptp.tx_power_dbm is None or gains[0] is None or gains[1] is None:
            continue
        received = ptp.tx_power_dbm + gains[0] + gains[1] - _lost_db(ptp, distance_m)
        signal = other.ptp.signal
        if signal.weakest_dbm >= signal.strongest_dbm:
            continue  # told by `bounds`
        if received > signal.strongest_dbm:
            what, bound = "above the strongest level", signal.strongest_dbm
        elif received < signal.weakest_dbm:
            what, bound = "below the weakest level", signal.weakest_dbm
        else:
            continue
        where = draft.where(Part("device", ptp.peer), "ptp", "signal")
        message = f"`{ptp.peer}` would hear {received:.0f} dBm over {distance_m} m, {what} that it declares"
        yield draft.wrong(part, ("ptp", "tx_power_dbm"), f"{message}, {bound} dBm ({where})", _power(ptp, distance_m))


RULES: tuple[Rule, ...] = (bounds, eirp, short_link, level)
