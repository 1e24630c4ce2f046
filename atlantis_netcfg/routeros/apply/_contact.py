"""All sessions with one device (first, verifying, after a loss) and their total cost."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.events import Event, Stage
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.routeros import api
from atlantis_netcfg.routeros.apply import _job
from atlantis_netcfg.routeros.safe_mode import Holder, SafeMode
from atlantis_netcfg.routeros.scheduler_jobs import jobs_of

if TYPE_CHECKING:
    from collections.abc import Coroutine, Iterator

    from atlantis_netcfg.routeros.api._values import Channel


_GROWTH = 1.5
_T = TypeVar("_T")


async def completed_despite_stop(work: Coroutine[Any, Any, _T]) -> tuple[_T, bool]:
    """Await the end of a run that already has a result; return it, and whether it was cancelled meanwhile.

    A second cancellation ends it.
    """
    task = asyncio.ensure_future(work)
    try:
        return await asyncio.shield(task), False
    except asyncio.CancelledError:
        if task.cancelled():
            raise
        if (current := asyncio.current_task()) is not None:
            current.uncancel()
        return await task, True


class Contact:
    """Opens sessions with one device and closes all of them at the end."""

    def __init__(self, job: _job.DeviceJob) -> None:
        self.notes: list[str] = []
        """Notes about the sessions, for the result."""
        self._job = job
        self._open: list[Channel] = []
        self._traffic: list[api.Traffic] = []
        self._endpoint = replace(job.endpoint, on_window_shrink=self._shrink_window, opening=self.opening)

    @property
    def traffic(self) -> api.Traffic:
        """Cost of all sessions so far, including those that failed during the login."""
        return api.Traffic.total(self._traffic)

    async def open(self) -> Channel:
        """Open a session. Raises what `api.Session.open` raises; without a pin, no credentials are sent."""
        session = await self._job.connect(self._endpoint)
        self._open.append(session)
        return session

    async def reach(self, patience_s: float, why: str, *, insist: bool = True) -> Channel:
        """Open a session with a device that may be unreachable, with retries. Raises the last failure.

        A certificate other than the pinned one ends the retries at once: it is another device. A refused login also
        ends them, unless `insist` is set.
        """
        another = (api.CertificateMismatch, api.CertificateUnknown)
        final = another if insist else (*another, api.LoginError)
        failure = DeviceError(f"no time left to wait for {arg(self._job.name)}")
        for pause_s in self._pauses(patience_s):
            try:
                return await self.open()
            except final:
                raise
            except DeviceError as failed:
                failure = failed
            self._say(msg(f"{arg(why)}: waiting for a response"))
            await asyncio.sleep(pause_s)
        raise failure

    async def until_free(self, safe_mode: SafeMode, session: Channel, patience_s: float) -> Holder:
        """Wait until safe mode is free; the device may still be undoing the changes of a dead session."""
        holder = Holder(is_taken=False)
        for pause_s in self._pauses(patience_s):
            holder = await safe_mode.free(session)
            if not holder.is_taken or holder.ours:
                return holder
            self._say(msg(f"{arg(holder.who)} holds safe mode: waiting until it is released or undone"))
            await asyncio.sleep(pause_s)
        return holder

    async def until_fired(self, session: Channel, question: api.Command, patience_s: float) -> None:
        """Wait until no dead-man job is armed."""
        for pause_s in self._pauses(patience_s):
            if not jobs_of((await session.command(question)).rows):
                return
            self._say("a dead-man job is armed: waiting until it has rolled everything back")
            await asyncio.sleep(pause_s)

    async def leave(self, session: Channel, *, wait: bool = True) -> None:
        """Close one session; with `wait`, until the device has confirmed, as it may have to undo safe mode."""
        if session in self._open:
            self._open.remove(session)
        await session.close(wait=wait)

    async def close(self, *, wait: bool = True) -> None:
        """Close every session; with `wait`, until the device has undone any safe mode still held."""
        sessions, self._open = self._open, []
        await asyncio.gather(*(session.close(wait=wait) for session in sessions))

    def opening(self, traffic: api.Traffic) -> None:
        """Register the counters of a session that is about to be opened."""
        self._traffic.append(traffic)
        self._job.endpoint.opening(traffic)

    def _shrink_window(self) -> None:
        """Use small batches from now on, since the device stopped responding in a large one."""
        self._endpoint = replace(self._endpoint, window=api.WINDOW)
        self._job.endpoint.on_window_shrink()
        self.notes.append(
            msg(
                f"the device stopped responding to more than {arg(api.WINDOW)} requests at once: they were repeated, "
                f"with at most {arg(api.WINDOW)} at once from now on"
            )
        )
        self._say(self.notes[-1])

    def _pauses(self, patience_s: float) -> Iterator[float]:
        """Yield increasing pauses until the time is over; at least one."""
        patience, now = self._job.patience, asyncio.get_running_loop().time
        until = now() + patience_s
        pause_s = patience.first_poll_s
        while True:
            yield pause_s
            if now() >= until:
                return
            pause_s = min(pause_s * _GROWTH, patience.last_poll_s)

    def _say(self, message: str) -> None:
        self._job.events(Event(self._job.name, Stage.WAITING, message))


async def choose_variant(channel: Channel, job: _job.DeviceJob) -> _job.DeviceJob:
    """Return the job with the desired state that fits the device; one round trip. Raises Unfit, SessionLost.

    A device with radios in both menus gets the state of the first of them in the inventory.
    """
    if job.fitting is None:
        return job
    replies = await channel.flight(
        [api.Command(f"{menu}/print", ((".proplist", "default-name"),)) for menu in _job.RADIO_MENUS]
    )
    radio_menus = []
    for menu, reply in zip(_job.RADIO_MENUS, replies, strict=True):
        if reply.trap is not None and reply.trap.message.startswith(_job.MISSING):
            continue
        if any(row.get("default-name") for row in reply.check().rows):
            radio_menus.append(menu)
    for menu, state in job.fitting.states.items():
        if menu in radio_menus:
            return replace(job, desired_state=state, fitting=None)
    message, hint = job.fitting.why(radio_menus)
    raise _job.Unfit(message, hint=hint)
