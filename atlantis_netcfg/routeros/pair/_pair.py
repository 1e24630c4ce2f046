"""What is given for the two ends of a radio bridge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from atlantis_netcfg.routeros.apply import DeviceJob


@dataclass(frozen=True, slots=True)
class Signal:
    """Between which levels a healthy link is heard, in dBm; a receiver is also spoilt by too much."""

    weakest_dbm: float = -75.0
    strongest_dbm: float = -20.0


@dataclass(frozen=True, slots=True)
class Pair:
    """The ends of one bridge, told apart by where the technician stands: `far` is reached through `near`'s radio."""

    near: DeviceJob
    far: DeviceJob
    near_radio: str = ""
    """Factory name (`wlan1`); empty: the first radio of the device."""
    far_radio: str = ""
    link_timeout_s: float = 300.0
    """Declared: when the link is not back and proved so long after the first change, both ends return by themselves.

    It has to hold the wait for radar (60 s on DFS channels, 10 min at 5600 to 5650 MHz), association and reading back.
    """
    reserve_s: float = 30.0
    """Of that time, for proving and keeping: the near end is taken back so long before the far one returns."""
    grace_s: float = 5.0
    """For the far end's answer to what changes its radio: the link may be gone before the answer."""
    signal: Signal | None = None
    """Checked at both ends before anything is kept; None: that they are registered is enough."""

    @property
    def name(self) -> str:
        """Both names, near end first."""
        return f"{self.near.name} and {self.far.name}"
