"""An emulated Teltonika RutOS unit: its HTTPS interface, ubus, and SSH with a small, strict `uci`.

It stands for the protocol and the settings, not for radio: signal figures are constant. Only what our drivers use is
there, and everything else is refused: the twin is a subset of the device and never laxer.
"""

from atlantis_netcfg.twin.rutos._spec import RutosNetwork, RutosSim, RutosSpec
from atlantis_netcfg.twin.rutos._unit import NOT_REHEARSED, RunningRutos, Rutos

__all__ = ["NOT_REHEARSED", "RunningRutos", "Rutos", "RutosNetwork", "RutosSim", "RutosSpec"]
