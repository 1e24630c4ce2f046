"""Emulated acoustic modems: EvoLogics S2C and Blueprint SeaTrac, on a TCP port for one client or on a pty.

They respond to reads as in devices.md 5, and accept the one transmission that our steps can request. Out of the water
that transmission counts as damage. Everything else is not executed but counted in `forbidden`. No client or emulator of
either protocol is published (neither on PyPI nor in Debian), so that a second, small client in the tests checks them.
Inferred and not captured: the text after ERROR and BUSY, the format of each single value, the first two fields of
SeaTrac's information record, the response to its ping command, and that a modem for one client disconnects a second
client at once.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.acoustic._evologics import EvologicsSpec, RunningEvologics
from atlantis_netcfg.emulator.acoustic._seatrac import RunningSeatrac, SeatracSpec

__all__ = ["NOT_REHEARSED", "EvologicsSpec", "RunningEvologics", "RunningSeatrac", "SeatracSpec"]


NOT_REHEARSED = (
    (
        "an acoustic modem: sound in water, real travel times and retries, connections and their data, more firmware "
        "versions"
    ),
    "an acoustic modem: its error messages and its handling of a second client are inferred",
)
