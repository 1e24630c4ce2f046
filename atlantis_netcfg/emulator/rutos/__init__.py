"""An emulated Teltonika RutOS unit: its HTTPS interface, ubus, and SSH with a small, strict `uci`.

It stands for the protocol and the settings, not for radio: signal figures are those that it is given. Only what our
drivers use is there, and everything else is refused: the twin is a subset of the device and never laxer.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.lazy_imports import homes

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.rutos._unit import RunningRutos, Rutos
    from atlantis_netcfg.emulator.rutos._web import NOT_REHEARSED, RutosNetwork, RutosSim, RutosSpec

__all__ = ["NOT_REHEARSED", "RunningRutos", "Rutos", "RutosNetwork", "RutosSim", "RutosSpec"]

__getattr__ = homes(
    __name__,
    {"_unit": ("RunningRutos", "Rutos"), "_web": ("NOT_REHEARSED", "RutosNetwork", "RutosSim", "RutosSpec")},
)
