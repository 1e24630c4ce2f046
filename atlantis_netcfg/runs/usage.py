"""Bytes carried by each link of a site this month, as far as the counters were read.

A router counts the bytes of a port since its start, and loses the count at a restart. Every reading of these counters,
whatever its purpose, is stored here; the month is the sum of the increases between readings. What no reading can show
(from the last reading to a restart, before the first reading) is reported as a gap and never guessed. Bytes between two
readings count in the month of the later one. Months are in UTC; times are this computer's.
"""

from __future__ import annotations

import fcntl
import json
import os
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from enum import Enum, auto
from typing import TYPE_CHECKING, Annotated

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, ValidationError

from atlantis_netcfg.core.atomic_files import open_lock, write_atomically
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.runs import files

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_WHAT = "the data usage of this month"
_BOOT_SLACK = timedelta(seconds=120)
"""Tolerance of the computed start time of a device that was not restarted: clocks are set, and a reply over a

satellite link may be 70 s old.
"""
_KEPT_MONTHS = 13
"""Number of months kept for each link."""
_GAPS = 20
"""Number of gaps kept for each month: the latest."""
_Count = Annotated[int, Field(ge=0)]


class _Data(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Counters(_Data):
    """One reading of the counters of a link's port."""

    device: str
    interface: str
    rx_bytes: _Count
    """Bytes into the port: from the link to the site."""
    tx_bytes: _Count
    at: AwareDatetime
    """Time of the reading by this computer's clock, with time zone."""
    uptime_s: float | None = None
    """Seconds since the device started; None: not requested."""

    @property
    def bytes(self) -> int:
        """Bytes of both directions, as billed for a link."""
        return self.rx_bytes + self.tx_bytes


class _Month(_Data):
    bytes: _Count = 0
    since: AwareDatetime
    gaps: tuple[str, ...] = ()


class _LinkUsage(_Data):
    last: Counters
    months: dict[str, _Month] = {}


class _UsageFile(_Data):
    bearers: dict[str, _LinkUsage] = {}


@dataclass(frozen=True, slots=True)
class MonthBytes:
    """Bytes that a link has carried in a calendar month (UTC), as far as the counters were read."""

    bytes: int | None = None
    """Bytes in both directions; a lower bound if there are gaps. None: no reading in this month."""
    since: datetime | None = None
    """Start of counting: the first reading, which may be from an earlier month."""
    gaps: tuple[str, ...] = ()
    """Uncounted periods with the reason, oldest first."""


class Usage:
    """The file of one site; several processes may write at once."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def record(self, link: str, counters: Counters) -> int | None:
        """Store a reading; return the increase since the last one, None if unknown.

        Raises JournalError if it cannot be written, DamagedStateError if the file is damaged.
        """
        with self._edit_usage() as links:
            usage = links.get(link)
            rise, gap = _rise(usage.last if usage else None, counters)
            months = dict(usage.months) if usage else {}
            name = _month(counters.at)
            since = counters.at if usage is None or rise is None else min(usage.last.at, counters.at)
            month = months.get(name, _Month(since=since))
            gaps = (*month.gaps, gap)[-_GAPS:] if gap is not None else month.gaps
            months[name] = _Month(bytes=month.bytes + (rise or 0), since=month.since, gaps=gaps)
            links[link] = _LinkUsage(
                last=counters, months={each: months[each] for each in sorted(months)[-_KEPT_MONTHS:]}
            )
        return rise

    def month(self, link: str, now: datetime) -> MonthBytes:
        """Return the known usage in the month of `now`. Raises DamagedStateError."""
        usage = self._read().get(link)
        month = usage.months.get(_month(now)) if usage is not None else None
        return MonthBytes() if month is None else MonthBytes(month.bytes, month.since, month.gaps)

    def last(self, link: str) -> Counters | None:
        """Return the latest reading. Raises DamagedStateError."""
        usage = self._read().get(link)
        return None if usage is None else usage.last

    @contextmanager
    def _edit_usage(self) -> Iterator[dict[str, _LinkUsage]]:
        with files.os_errors_as(_WHAT, self._path):
            files.make_private(self._path.parent)
            guard = open_lock(self._path.with_suffix(".lock"))
            try:
                fcntl.flock(guard, fcntl.LOCK_EX)
                links = self._read()
                yield links
                text = _UsageFile(bearers=links).model_dump_json(indent=1)
                write_atomically(self._path, text.encode() + b"\n")
            finally:
                os.close(guard)

    def _read(self) -> dict[str, _LinkUsage]:
        try:
            return dict(_UsageFile.model_validate(json.loads(self._path.read_bytes())).bearers)
        except FileNotFoundError:
            return {}
        except (OSError, ValueError, ValidationError) as error:
            raise files.DamagedStateError(
                f"{arg(_WHAT)} cannot be read: {arg(self._path)}",
                hint="restore the file from a copy, or move it away: the month is then counted from the next check",
            ) from error


def _month(moment: datetime) -> str:
    return f"{moment.astimezone(UTC):%Y-%m}"


def _rise(last: Counters | None, counters: Counters) -> tuple[int | None, str | None]:
    """Return the increase between two readings, and a description of any unknown part."""
    if last is None:
        return None, None
    between = msg(f"between {arg(_stamp(last.at))} and {arg(_stamp(counters.at))}")
    if (last.device, last.interface) != (counters.device, counters.interface):
        was, now = (msg(f"{arg(item.interface)} of {arg(item.device)}") for item in (last, counters))
        return None, msg(
            f"{arg(between)} the link moved from {arg(was)} to {arg(now)}: its traffic in that time is not counted"
        )
    shrunk = counters.rx_bytes < last.rx_bytes or counters.tx_bytes < last.tx_bytes
    restart = _detect_restart(last, counters)
    if restart and (shrunk or restart is _Restart.CERTAIN):
        return counters.bytes, msg(f"{arg(between)} the router restarted: traffic before that is not counted")
    if shrunk:
        why = "were reset or overflowed"
        return counters.bytes, msg(f"{arg(between)} the counters {arg(why)}: traffic before that is not counted")
    gap = "the router restarted, or the clock of this computer was set: the traffic may be higher"
    return counters.bytes - last.bytes, f"{between} {gap}" if restart else None


class _Restart(Enum):
    CERTAIN = auto()
    POSSIBLE = auto()


def _detect_restart(last: Counters, counters: Counters) -> _Restart | None:
    """Detect a restart by uptime; the start time also depends on our clock, which may have been set."""
    if last.uptime_s is None or counters.uptime_s is None:
        return None
    if counters.uptime_s < last.uptime_s:
        return _Restart.CERTAIN
    before, now = (look.at - timedelta(seconds=look.uptime_s or 0.0) for look in (last, counters))
    return _Restart.POSSIBLE if now - before > _BOOT_SLACK else None


def _stamp(moment: datetime) -> str:
    return f"{moment.astimezone(UTC):%Y-%m-%d %H:%M} UTC"
