"""An emulated autopilot, as far as the MAVLink stream tells that its companion computer forwards by UDP.

It stands for the messages that speak of the remote control, with real frames of version 1 or 2 packed by pymavlink. It
flies nothing and obeys nothing: every datagram that is sent to it is counted in `forbidden`.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.mavlink.running import AutopilotSpec, RunningAutopilot

__all__ = ["NOT_REHEARSED", "AutopilotSpec", "RunningAutopilot"]

NOT_REHEARSED = ("a remote control: its radio and range, the autopilot's failsafe, and motors that start",)
