"""Emulated RouterOS devices that use the real protocol on real sockets, as strict as real devices.

Asyncio programs use `EmulatedRouter` or `EmulatedSite`; others `RunningSite` (a thread) or `spawn` (a process).

Names are imported lazily: code that only describes an emulated device does not load a whole emulated router.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.lazy_imports import lazy_getattr

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.answers import NOT_REHEARSED
    from atlantis_netcfg.emulator.routeros.control import COMMANDS, ControlError
    from atlantis_netcfg.emulator.routeros.core import Service
    from atlantis_netcfg.emulator.routeros.device import Device
    from atlantis_netcfg.emulator.routeros.radio import Air, RadioLink, RadioPair
    from atlantis_netcfg.emulator.routeros.router import EmulatedRouter
    from atlantis_netcfg.emulator.routeros.running import EmulatorError, RunningSite, SpawnedSite, spawn
    from atlantis_netcfg.emulator.routeros.site import EmulatedSite
    from atlantis_netcfg.emulator.routeros.spec import (
        CellSpec,
        Deviation,
        DeviceMode,
        DeviceModeName,
        DiscoveryNeighbour,
        EmulatorSpec,
        Environment,
        Execute,
        Load,
        ManagementSpec,
        ModemSpec,
        Radio,
        RouterSpec,
        SimSpec,
        SiteSpec,
        User,
        Validity,
    )
    from atlantis_netcfg.emulator.routeros.wire.link import (
        FaultKind,
        LinkFault,
        RouterLink,
        TrafficCounters,
        WireBehaviour,
        WireCounters,
    )

__all__ = [
    "COMMANDS",
    "NOT_REHEARSED",
    "Air",
    "CellSpec",
    "ControlError",
    "Deviation",
    "Device",
    "DeviceMode",
    "DeviceModeName",
    "DiscoveryNeighbour",
    "EmulatedRouter",
    "EmulatedSite",
    "EmulatorError",
    "EmulatorSpec",
    "Environment",
    "Execute",
    "FaultKind",
    "LinkFault",
    "Load",
    "ManagementSpec",
    "ModemSpec",
    "Radio",
    "RadioLink",
    "RadioPair",
    "RouterLink",
    "RouterSpec",
    "RunningSite",
    "Service",
    "SimSpec",
    "SiteSpec",
    "SpawnedSite",
    "TrafficCounters",
    "User",
    "Validity",
    "WireBehaviour",
    "WireCounters",
    "spawn",
]

__getattr__ = lazy_getattr(
    __name__,
    {
        "answers": ("NOT_REHEARSED",),
        "control": ("COMMANDS", "ControlError"),
        "core": ("Service",),
        "device": ("Device",),
        "radio": ("Air", "RadioLink", "RadioPair"),
        "router": ("EmulatedRouter",),
        "running": ("RunningSite", "SpawnedSite", "EmulatorError", "spawn"),
        "site": ("EmulatedSite",),
        "spec": (
            "DiscoveryNeighbour",
            "CellSpec",
            "Deviation",
            "DeviceMode",
            "DeviceModeName",
            "Environment",
            "Execute",
            "Load",
            "ManagementSpec",
            "ModemSpec",
            "Radio",
            "RouterSpec",
            "SimSpec",
            "SiteSpec",
            "EmulatorSpec",
            "User",
            "Validity",
        ),
        "wire.link": ("FaultKind", "LinkFault", "RouterLink", "TrafficCounters", "WireBehaviour", "WireCounters"),
    },
)
