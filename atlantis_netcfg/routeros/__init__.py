"""The RouterOS engine: plan from desired state and current rows, apply it under safe mode, and verify.

Desired text and current rows are compared by means of a table of menus and one generic planner without I/O. The
executor takes safe mode, writes layer by layer, verifies in a new session that the device is reachable and in the
desired state, then releases safe mode or rolls back. Success is what was read back: after a run the second plan is
empty, or the run failed.

    job = DeviceJob(name, endpoint, desired.read(text), site=..., journal=...)
    result = await converge(job, mode=JobMode.APPLY)              # one device
    results = await fleet.run(jobs, mode=JobMode.APPLY)           # all of a run

Names are imported on first use: an emulated router needs the table of menus, and nothing else of the engine.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.lazy_imports import lazy_getattr

if TYPE_CHECKING:
    from atlantis_netcfg.routeros import desired, fleet
    from atlantis_netcfg.routeros.api import Endpoint
    from atlantis_netcfg.routeros.apply import DeviceJob, DeviceResult, JobMode, Patience, Status, converge
    from atlantis_netcfg.routeros.estimate import Estimate, LinkMetrics

__all__ = [
    "DeviceJob",
    "DeviceResult",
    "Endpoint",
    "Estimate",
    "JobMode",
    "LinkMetrics",
    "Patience",
    "Status",
    "converge",
    "desired",
    "fleet",
]

__getattr__ = lazy_getattr(
    __name__,
    {
        "api": ("Endpoint",),
        "apply": ("DeviceJob", "DeviceResult", "JobMode", "Patience", "Status", "converge"),
        "estimate": ("LinkMetrics", "Estimate"),
    },
)
