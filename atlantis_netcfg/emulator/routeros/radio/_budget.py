"""How strong one radio hears the other: a free-space model, and no more than that.

Received power = EIRP - 20 log10(4 pi d / wavelength) + gain of the receiving antenna. EIRP is what the radio sends plus
its antenna's gain, held down to what the country allows. No reflection from the water, no rain, no cable, no
misalignment: real links are some decibels worse (`Air.loss_db`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.radio._law import within

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.radio._settings import Settings
    from atlantis_netcfg.emulator.routeros.radio._spec import Air

__all__ = ["NOISE_DBM", "free_space_loss_db", "signal_dbm"]

NOISE_DBM = -110
"""What `noise-floor` shows of a quiet 20 MHz channel (sample of the manual, Wireless Interface)."""
_LIGHT_M_S = 299_792_458.0


def free_space_loss_db(distance_m: float, frequency_mhz: float) -> float:
    """Return the loss between two isotropic antennas, never below none."""
    return max(0.0, 20 * math.log10(4 * math.pi * distance_m * frequency_mhz * 1e6 / _LIGHT_M_S))


def signal_dbm(sender: Settings, receiver: Settings, frequency_mhz: int, air: Air) -> float:
    """Return what `receiver` hears of `sender`."""
    rule = within(sender.country, frequency_mhz, "20mhz", outdoor=False, lawless=sender.lawless)
    eirp = sender.power_dbm + sender.gain_dbi
    if rule is not None:
        eirp = min(eirp, rule.eirp_dbm)
    return eirp - free_space_loss_db(air.distance_m, frequency_mhz) - air.loss_db + receiver.gain_dbi
