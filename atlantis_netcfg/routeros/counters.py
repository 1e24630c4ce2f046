"""The byte counters of ports, read beside other things (Manual, CLI reference, `/interface`: `rx-byte`, `tx-byte`)."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.routeros._types import PortCounts
from atlantis_netcfg.routeros.api import Command

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.routeros.api import Reply

_UPTIME = re.compile(r"(?:(\d+)w)?(?:(\d+)d)?(?:(\d+)h)?(?:(\d+)m)?(?:(\d+)s)?")
_UPTIME_ONLY: Final = Command("/system/resource/print", ((".proplist", "uptime"),))
_UNITS: Final = (604_800, 86_400, 3_600, 60, 1)


def counting(ports: Sequence[str]) -> Command:
    """The command that reads the counters of these ports, one or more; a port is its socket, whatever its name is."""
    first, *others = ports
    either = [word for port in others for word in (f"?default-name={port}", "?#|")]
    properties = (".proplist", "default-name,rx-byte,tx-byte")
    return Command("/interface/print", (properties,), (f"?default-name={first}", *either))


def looks(ports: Sequence[str], beside: int, window: int) -> tuple[list[Command], list[Command]]:
    """What to send before and behind `beside` other sentences: only as much as their round trips have room for.

    `window`: sentences in flight at once.

    With room for one look it is the later one, which is what a month is counted by.
    """
    room = -beside % window
    if not ports or not room:
        return [], []
    look = counting(ports)
    return ([look] if room > 1 else []), [look]


def closing(ports: Sequence[str]) -> list[Command]:
    """A look beside the last sentences of a run, which have room for it: counters and uptime, for `read_counts`."""
    return [counting(ports), _UPTIME_ONLY] if ports else []


def read_counts(reply: Reply, resource: Reply) -> PortCounts | None:
    """Read an answer; None if the device refused it or knows none of the ports."""
    ports = {
        row["default-name"]: (int(row["rx-byte"]), int(row["tx-byte"]))
        for row in reply.rows
        if "default-name" in row and row.get("rx-byte", "").isdecimal() and row.get("tx-byte", "").isdecimal()
    }
    if reply.trap is not None or not ports:
        return None
    uptime = resource.rows[0].get("uptime", "") if resource.rows else ""
    return PortCounts(datetime.now(UTC), seconds(uptime), ports)


def seconds(interval: str) -> float | None:
    """A time as RouterOS prints it (`1w2d3h4m5s`), in seconds; None if it is none."""
    found = _UPTIME.fullmatch(interval)
    if not interval or found is None:
        return None
    return float(sum(int(digits) * unit for digits, unit in zip(found.groups(), _UNITS, strict=True) if digits))
