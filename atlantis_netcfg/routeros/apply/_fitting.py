"""A device that decides which of several desired states fits it: by the menu in which its radio is.

Menus alone tell nothing: `/interface/wifi` is there from 7.13 on without any radio of it. A radio of the board has a
`default-name`, a virtual one has not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceFailed
from atlantis_netcfg.routeros.api import Command

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from atlantis_netcfg.routeros._items import Desired
    from atlantis_netcfg.routeros.apply._job import Channel, DeviceJob

_MENUS = ("/interface/wireless", "/interface/wifi")
_MISSING = ("no such command", "no such directory")


class Unfit(DeviceFailed):
    """Nothing that is declared fits this device."""


@dataclass(frozen=True, slots=True)
class StateVariants:
    """The desired states to choose from."""

    states: Mapping[str, Desired]
    """Menu of the radio to what the device should then hold."""
    why: Callable[[Collection[str]], tuple[str, str]]
    """Given the menus in which the device has radios: why none of the states fits, and what to do about it."""


async def fitted(channel: Channel, job: DeviceJob) -> DeviceJob:
    """Return the job with the state that fits the device; one round trip. Raises Unfit, SessionLost.

    A device with radios in both menus gets the state of the first of them that is declared.
    """
    if job.fitting is None:
        return job
    replies = await channel.flight([Command(f"{menu}/print", ((".proplist", "default-name"),)) for menu in _MENUS])
    found = []
    for menu, reply in zip(_MENUS, replies, strict=True):
        if reply.trap is not None and reply.trap.message.startswith(_MISSING):
            continue
        if any(row.get("default-name") for row in reply.checked().rows):
            found.append(menu)
    for menu, desired in job.fitting.states.items():
        if menu in found:
            return replace(job, desired=desired, fitting=None)
    message, hint = job.fitting.why(found)
    raise Unfit(message, hint=hint)
