"""The 4G modem of a router twin: its SIM, the network around it, and what `/interface/lte` shows of both.

Sources: Manual, LTE/5G (`allow-roaming`, `use-network-apn` for MBIM modems, `show-capabilities`), and published logs.
Levels are constants; cells, SMS and eSIM are not emulated.

Assumption: lte-pin-words
Assumption: lte-pin-once
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros.lte._modem import CellSpec, ModemSpec, SimSpec, SimState

__all__ = ["CellSpec", "ModemSpec", "SimSpec", "SimState"]
