"""An emulated GNSS receiver: behind gpsd, behind a server that passes NMEA on over TCP, or behind a serial port.

It stands for what the two protocols tell in every state of a receiver, and for servers that are not there, serve one
client only, or say nothing. It computes no positions, and time goes on with this computer's. Whatever would change a
receiver is not obeyed but counted in `forbidden`.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.gnss.running import Access, GnssSpec, RunningGpsd, RunningNmea, RunningNmeaPort, Speech

__all__ = ["NOT_REHEARSED", "Access", "GnssSpec", "RunningGpsd", "RunningNmea", "RunningNmeaPort", "Speech"]

NOT_REHEARSED = ("a GNSS receiver: the sky, its antenna and cable, how long it takes to its first fix",)
