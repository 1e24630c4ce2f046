"""Emulated acoustic modems: EvoLogics S2C and Blueprint SeaTrac, on a TCP port that serves one client, or on a pty.

They answer reads as devices.md 5 has them, obey the one transmission that our steps can ask for, and count it as damage
unless they are in the water; everything else that arrives is not obeyed but counted in `forbidden`. No client and no
emulator of either language is published (neither on PyPI nor in Debian), so nobody else's program stands against them:
a second, small client in the tests does. Inferred and not captured: the words after ERROR and BUSY, the form of each
single value, the first two fields of SeaTrac's information record, the answer to its ping command, and that a modem
with one seat hangs up on the second client at once.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.acoustic._evologics import EvologicsSpec, RunningEvologics
from atlantis_netcfg.emulator.acoustic._seatrac import RunningSeatrac, SeatracSpec

__all__ = ["NOT_REHEARSED", "EvologicsSpec", "RunningEvologics", "RunningSeatrac", "SeatracSpec"]


NOT_REHEARSED = (
    "an acoustic modem: sound in water, real times of travel and retries, connections and their data, more firmware",
    "an acoustic modem: its words for errors, and what it does with a second client, are inferred",
)
