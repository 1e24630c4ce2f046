"""Emulated devices that speak the real protocol on real sockets, as strict as the devices they stand for.

Asyncio programs use `Router` or `Site`; others `RunningSite` (a thread) or `spawn` (a process).
"""

from atlantis_netcfg.twin.control import COMMANDS, TwinRefused
from atlantis_netcfg.twin.device import NOT_REHEARSED, Device, Service
from atlantis_netcfg.twin.lte import CellSpec, ModemSpec, SimSpec
from atlantis_netcfg.twin.radio import Air, RadioLink, RadioPair
from atlantis_netcfg.twin.router import Router
from atlantis_netcfg.twin.running import RunningSite, SpawnedSite, TwinsFailed, spawn
from atlantis_netcfg.twin.site import Site, SiteSpec, TwinSpec
from atlantis_netcfg.twin.spec import DeviceMode, Execute, Management, Mode, Radio, RouterSpec, User
from atlantis_netcfg.twin.wire.faults import Fault, FaultKind
from atlantis_netcfg.twin.wire.knobs import Knobs
from atlantis_netcfg.twin.wire.link import Link
from atlantis_netcfg.twin.wire.tally import Counters, Tally

__all__ = [
    "COMMANDS",
    "NOT_REHEARSED",
    "Air",
    "CellSpec",
    "Counters",
    "Device",
    "DeviceMode",
    "Execute",
    "Fault",
    "FaultKind",
    "Knobs",
    "Link",
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
    "Tally",
    "TwinRefused",
    "TwinSpec",
    "TwinsFailed",
    "User",
    "spawn",
]
