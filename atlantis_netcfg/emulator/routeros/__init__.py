"""Emulated devices that speak the real protocol on real sockets, as strict as the devices they stand for.

Asyncio programs use `Router` or `Site`; others `RunningSite` (a thread) or `spawn` (a process).

A name is imported when it is asked for: who only describes a twin does not load the whole of an emulated router.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.lazy_imports import homes

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.answers import NOT_REHEARSED
    from atlantis_netcfg.emulator.routeros.control import COMMANDS, TwinRefused
    from atlantis_netcfg.emulator.routeros.core import Service
    from atlantis_netcfg.emulator.routeros.device import Device
    from atlantis_netcfg.emulator.routeros.radio import Air, RadioLink, RadioPair
    from atlantis_netcfg.emulator.routeros.router import Router
    from atlantis_netcfg.emulator.routeros.running import RunningSite, SpawnedSite, TwinsFailed, spawn
    from atlantis_netcfg.emulator.routeros.site import Site
    from atlantis_netcfg.emulator.routeros.spec import (
        Called,
        CellSpec,
        Deviation,
        DeviceMode,
        Environment,
        Execute,
        Load,
        Management,
        Mode,
        ModemSpec,
        Radio,
        RouterSpec,
        SimSpec,
        SiteSpec,
        TwinSpec,
        User,
        Validity,
    )
    from atlantis_netcfg.emulator.routeros.wire.link import (
        Counters,
        Fault,
        FaultKind,
        Link,
        TrafficCounters,
        WireBehaviour,
    )

__all__ = [
    "COMMANDS",
    "NOT_REHEARSED",
    "Air",
    "Called",
    "CellSpec",
    "Counters",
    "Deviation",
    "Device",
    "DeviceMode",
    "Environment",
    "Execute",
    "Fault",
    "FaultKind",
    "Link",
    "Load",
    "Management",
    "Mode",
    "ModemSpec",
    "Radio",
    "RadioLink",
    "RadioPair",
    "Router",
    "RouterSpec",
    "RunningSite",
    "Service",
    "SimSpec",
    "Site",
    "SiteSpec",
    "SpawnedSite",
    "TrafficCounters",
    "TwinRefused",
    "TwinSpec",
    "TwinsFailed",
    "User",
    "Validity",
    "WireBehaviour",
    "spawn",
]

__getattr__ = homes(
    __name__,
    {
        "answers": ("NOT_REHEARSED",),
        "control": ("COMMANDS", "TwinRefused"),
        "core": ("Service",),
        "device": ("Device",),
        "radio": ("Air", "RadioLink", "RadioPair"),
        "router": ("Router",),
        "running": ("RunningSite", "SpawnedSite", "TwinsFailed", "spawn"),
        "site": ("Site",),
        "spec": (
            "Called",
            "CellSpec",
            "Deviation",
            "DeviceMode",
            "Environment",
            "Execute",
            "Load",
            "Management",
            "Mode",
            "ModemSpec",
            "Radio",
            "RouterSpec",
            "SimSpec",
            "SiteSpec",
            "TwinSpec",
            "User",
            "Validity",
        ),
        "wire.link": ("Counters", "Fault", "FaultKind", "Link", "TrafficCounters", "WireBehaviour"),
    },
)
