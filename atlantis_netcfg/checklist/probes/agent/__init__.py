"""The program that listens: it travels to a place, asks all questions there at once, and answers line by line.

It is Python 3.8 and the standard library, for Ubuntu 20.04 on a gateway has no more, and it leaves nothing behind: its
source goes in by the standard input together with the questions, packed. What it asks it was told; what must not be
disturbed (a serial port or a UDP port that a program of the vehicle holds) it leaves alone. One question that fails,
hangs or crashes takes no other with it.
"""

from __future__ import annotations

from atlantis_netcfg.checklist.probes.agent.bundle import BOOT, program
from atlantis_netcfg.checklist.probes.agent.protocol import Batch, batch, heard

__all__ = ["BOOT", "Batch", "batch", "heard", "program"]
