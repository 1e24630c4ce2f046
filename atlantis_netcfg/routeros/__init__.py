"""The RouterOS engine: desired text against observed rows gives a plan; a plan is applied under the device's safe mode.

Text and rows are compared by a table of menus and one generic planner without I/O. The executor takes safe mode, writes
layer by layer, proves from a new session that the device is still reachable and as declared, then releases or unrolls.
What counts is what was read back: after a run the second plan is empty, or the run failed.

    job = DeviceJob(name, endpoint, desired.read(text), site=..., journal=...)
    result = await converge(job, mode=Mode.APPLY)              # one device
    results = await fleet.run(jobs, mode=Mode.APPLY)           # all of a run

A name is imported when it is asked for: an emulated router needs the table of menus, and nothing of the engine.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.lazy_imports import homes

if TYPE_CHECKING:
    from atlantis_netcfg.routeros import desired, fleet
    from atlantis_netcfg.routeros.api import Endpoint
    from atlantis_netcfg.routeros.apply import DeviceJob, DeviceResult, JobMode, Patience, Status, converge
    from atlantis_netcfg.routeros.estimate import BearerProfile, Estimate

__all__ = [
    "BearerProfile",
    "DeviceJob",
    "DeviceResult",
    "Endpoint",
    "Estimate",
    "JobMode",
    "Patience",
    "Status",
    "converge",
    "desired",
    "fleet",
]

__getattr__ = homes(
    __name__,
    {
        "api": ("Endpoint",),
        "apply": ("DeviceJob", "DeviceResult", "JobMode", "Patience", "Status", "converge"),
        "estimate": ("BearerProfile", "Estimate"),
    },
)
