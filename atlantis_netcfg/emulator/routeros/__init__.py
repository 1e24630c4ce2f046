"""Emulated devices that speak the real protocol on real sockets, as strict as the devices they stand for.

Asyncio programs use `Router` or `Site`; others `RunningSite` (a thread) or `spawn` (a process).

A name is imported when it is asked for: who only describes a twin does not load the whole of an emulated router.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.lazy_imports import homes

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.control import COMMANDS, TwinRefused
    from atlantis_netcfg.emulator.routeros.device import Device
    from atlantis_netcfg.emulator.routeros.environment import Called, Environment, Load, Validity
    from atlantis_netcfg.emulator.routeros.lte import CellSpec, ModemSpec, SimSpec
    from atlantis_netcfg.emulator.routeros.not_rehearsed import NOT_REHEARSED
    from atlantis_netcfg.emulator.routeros.radio import Air, RadioLink, RadioPair
    from atlantis_netcfg.emulator.routeros.router import Router
    from atlantis_netcfg.emulator.routeros.running import RunningSite, SpawnedSite, TwinsFailed, spawn
    from atlantis_netcfg.emulator.routeros.services import Service
    from atlantis_netcfg.emulator.routeros.site import Site
    from atlantis_netcfg.emulator.routeros.spec import (
        Deviation,
        DeviceMode,
        Execute,
        Management,
        Mode,
        Radio,
        RouterSpec,
        SiteSpec,
        TwinSpec,
        User,
    )
    from atlantis_netcfg.emulator.routeros.wire.faults import Fault, FaultKind
    from atlantis_netcfg.emulator.routeros.wire.knobs import WireBehaviour
    from atlantis_netcfg.emulator.routeros.wire.link import Link
    from atlantis_netcfg.emulator.routeros.wire.tally import Counters, TrafficCounters

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
        "environment": ("Environment", "Called", "Load", "Validity"),
        "control": ("COMMANDS", "TwinRefused"),
        "device": ("Device",),
        "lte": ("CellSpec", "ModemSpec", "SimSpec"),
        "not_rehearsed": ("NOT_REHEARSED",),
        "radio": ("Air", "RadioLink", "RadioPair"),
        "router": ("Router",),
        "running": ("RunningSite", "SpawnedSite", "TwinsFailed", "spawn"),
        "services": ("Service",),
        "site": ("Site",),
        "spec": (
            *("Deviation", "DeviceMode", "Execute", "Management", "Mode", "Radio", "RouterSpec"),
            *("SiteSpec", "TwinSpec", "User"),
        ),
        "wire.faults": ("Fault", "FaultKind"),
        "wire.knobs": ("WireBehaviour",),
        "wire.link": ("Link",),
        "wire.tally": ("Counters", "TrafficCounters"),
    },
)
