"""Carrying a plan out on one device, so that it ends as declared or as it was, and never between.

`converge` observes, plans, refuses what cannot be done, saves the state, takes the device's safe mode, writes, reads
everything back from a new session and releases. After a failure it finds out by reading what the device has become.
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
