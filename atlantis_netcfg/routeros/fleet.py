"""All devices of a run in parallel: results as they arrive; no device waits for another.

The two ends of a radio bridge are one member, a `Pair`, and return two results, near end first.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, asynccontextmanager
from dataclasses import dataclass
from functools import partial

from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.routeros import apply
from atlantis_netcfg.routeros.pair import Pair, converge_pair

AT_ONCE = 32
"""Devices in progress at the same time; each keeps its rows in memory only while in progress."""
PATIENCE_S = 10.0
"""A device in progress for longer (dead, or far away) frees its slot for the next one and continues in parallel."""
MOST = 256
"""Limit of devices in progress, waiting ones included: bounds memory if very many are dead or slow."""

ResultCallback = Callable[[apply.DeviceResult], object]


@dataclass(frozen=True, slots=True)
class PendingJob:
    """A device whose job is created only when its turn comes, to save memory.

    A NetcfgError from `make` is that device's result: nothing on it was changed.
    """

    name: str
    make: Callable[[], apply.DeviceJob | Pair]
    other: str | None = None
    """Far end of a pair, whose near end is `name`; None: not a pair."""
    after: tuple[str, ...] = ()
    """Devices of the run on the route to this one: it starts when they have ended, with any result.

        They must not wait for any device themselves.
    """


async def run(
    jobs: Iterable[apply.DeviceJob | Pair],
    *,
    mode: str = apply.JobMode.APPLY,
    at_once: int = AT_ONCE,
    on_result: ResultCallback | None = None,
) -> list[apply.DeviceResult]:
    """Converge every device and return the results in the order of the jobs; `on_result` is called with each.

    On the first cancellation, devices in progress are rolled back, waiting ones are left alone, and all are reported.
    """
    waiting = list(jobs)
    results: dict[int, list[apply.DeviceResult]] = {number: [] for number in range(len(waiting))}
    turns = [(_pending_job(job), results[number].append) for number, job in enumerate(waiting)]
    await _run_all(turns, apply.JobMode(mode), at_once, on_result)
    return [result for number in range(len(waiting)) for result in results[number]]


async def stream(
    jobs: Iterable[PendingJob], on_result: ResultCallback, *, mode: str = apply.JobMode.APPLY, at_once: int = AT_ONCE
) -> None:
    """Converge every device like `run`, but keep no results: `on_result` gets each as soon as it exists."""
    await _run_all([(job, on_result) for job in jobs], apply.JobMode(mode), at_once, None)


def _pending_job(job: apply.DeviceJob | Pair) -> PendingJob:
    if isinstance(job, Pair):
        return PendingJob(job.near.name, partial(_unchanged_job, job), job.far.name)
    return PendingJob(job.name, partial(_unchanged_job, job))


def _unchanged_job(job: apply.DeviceJob | Pair) -> apply.DeviceJob | Pair:
    return job


async def _run_all(
    turns: Sequence[tuple[PendingJob, ResultCallback]],
    mode: apply.JobMode,
    at_once: int,
    on_result: ResultCallback | None,
) -> None:
    room = _Room(at_once)
    ways = {name for job, _ in turns for name in job.after}
    over = {name: asyncio.Event() for job, _ in turns for name in _names(job) if name in ways}
    tasks = [
        asyncio.create_task(_run_device(job, mode, room, over, report, on_result), name=job.name)
        for job, report in turns
    ]
    await _finish(tasks)
    for (job, output), task in zip(turns, tasks, strict=True):
        if task.cancelled():
            for name in _names(job):
                output(apply.stopped_before_turn(name))
        else:
            task.result()


async def _run_device(  # noqa: PLR0913, PLR0917 - one call, from one place
    job: PendingJob,
    mode: apply.JobMode,
    room: _Room,
    over: Mapping[str, asyncio.Event],
    report: ResultCallback,
    on_result: ResultCallback | None,
) -> None:
    for name in job.after:
        if name in over:
            await over[name].wait()
    try:
        async with room.place():
            results = await _converge(job, mode)
    finally:
        for name in _names(job):
            if name in over:
                over[name].set()
    for result in results:
        report(result)
        if on_result is not None:
            on_result(result)


class _Room:
    """Limits the devices in progress: `at_once` new ones, and MOST in total."""

    def __init__(self, at_once: int) -> None:
        self._new = asyncio.Semaphore(at_once)
        self._all = asyncio.Semaphore(max(MOST, at_once))

    @asynccontextmanager
    async def place(self) -> AsyncIterator[None]:
        """Wait for a slot and hold it; after PATIENCE_S the next device may start as well."""
        async with self._all:
            await self._new.acquire()
            with ExitStack() as exit_stack:
                exit_stack.callback(self._new.release)
                timer = asyncio.get_running_loop().call_later(PATIENCE_S, exit_stack.close)
                try:
                    yield
                finally:
                    timer.cancel()


def _names(job: PendingJob) -> tuple[str, ...]:
    return (job.name,) if job.other is None else (job.name, job.other)


async def _converge(waiting: PendingJob, mode: apply.JobMode) -> tuple[apply.DeviceResult, ...]:
    try:
        job = waiting.make()
    except NetcfgError as refusal:
        status = apply.Status.LEFT_AS_FOUND
        return tuple(
            apply.DeviceResult(name, status, refusal.exit, str(refusal), refusal.hint) for name in _names(waiting)
        )
    if isinstance(job, Pair):
        return await converge_pair(job, mode=mode)
    return (await apply.converge(job, mode=mode),)


async def _finish(tasks: list[asyncio.Task[None]]) -> None:
    """Wait for all; the first cancellation is passed to the devices, the second ends everything."""
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
