"""An emulated Teltonika RutOS unit: HTTPS interface, ubus, and SSH with a small, strict `uci`.

It emulates protocol and settings, not radio: signal values are given. Only the functions that our drivers use exist,
and everything else is refused: the emulator is a subset of the device and never more lenient.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.lazy_imports import lazy_getattr

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.rutos._unit import RunningRutos, Rutos
    from atlantis_netcfg.emulator.rutos._web import NOT_REHEARSED, RutosNetwork, RutosSim, RutosSpec

__all__ = ["NOT_REHEARSED", "RunningRutos", "Rutos", "RutosNetwork", "RutosSim", "RutosSpec"]

__getattr__ = lazy_getattr(
    __name__,
    {"_unit": ("RunningRutos", "Rutos"), "_web": ("NOT_REHEARSED", "RutosNetwork", "RutosSim", "RutosSpec")},
)
