"""All devices of a run at once: results as they come, and no device that waits for another."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from atlantis_netcfg.routeros.apply import DeviceJob, DeviceResult, Mode, Status, converge

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

__all__ = ["AT_ONCE", "run"]

AT_ONCE = 32
"""Devices in work at the same time; each holds its rows in memory only while it is in work."""


async def run(
    jobs: Iterable[DeviceJob],
    *,
    mode: str = Mode.APPLY,
    at_once: int = AT_ONCE,
    done: Callable[[DeviceResult], object] | None = None,
) -> list[DeviceResult]:
    """Converge every device and return the results in the order of the jobs; `done` is told each as soon as it exists.

    Cancelled once, it stops: devices in work are taken back, those that wait are left alone, all are reported.
    """
    waiting = list(jobs)
    room = asyncio.Semaphore(at_once)
    tasks = [asyncio.create_task(_one(job, Mode(mode), room, done), name=job.name) for job in waiting]
    await _finish(tasks)
    return [_result(job, task) for job, task in zip(waiting, tasks, strict=True)]


async def _one(
    job: DeviceJob, mode: Mode, room: asyncio.Semaphore, done: Callable[[DeviceResult], object] | None
) -> DeviceResult:
    async with room:
        result = await converge(job, mode=mode)
    if done is not None:
        done(result)
    return result


async def _finish(tasks: list[asyncio.Task[DeviceResult]]) -> None:
    """Wait for all; the first cancellation is handed to the devices, the second ends everything."""
    if not tasks:
        return
    try:
        await asyncio.wait(tasks)
    except asyncio.CancelledError:
        if (current := asyncio.current_task()) is not None:
            current.uncancel()
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)


def _result(job: DeviceJob, task: asyncio.Task[DeviceResult]) -> DeviceResult:
    if not task.cancelled():
        return task.result()
    status = Status.LEFT_AS_FOUND
    return DeviceResult(job.name, status, status.exit, "stopped by hand before its turn came: nothing was changed")
