"""Applies a plan to one device, which ends in the desired or the previous state, never between.

`converge` observes, plans, refuses what is not possible, saves the state, takes the device's safe mode, writes, reads
everything back in a new session and releases. After a failure it reads the device to find out its state.
"""

from __future__ import annotations

from atlantis_netcfg.routeros.api._values import Channel
from atlantis_netcfg.routeros.apply._executor import converge
from atlantis_netcfg.routeros.apply._job import (
    Admission,
    Connect,
    CostPolicy,
    DeviceJob,
    DeviceResult,
    History,
    JobMode,
    NoHistory,
    Patience,
    SshEndpoint,
    StateVariants,
    Status,
    stopped_before_turn,
)

__all__ = [
    "Admission",
    "Channel",
    "Connect",
    "CostPolicy",
    "DeviceJob",
    "DeviceResult",
    "History",
    "JobMode",
    "NoHistory",
    "Patience",
    "SshEndpoint",
    "StateVariants",
    "Status",
    "converge",
    "stopped_before_turn",
]
