"""`/system/scheduler`: when its rows run (Manual, Scheduler); in a device-mode without `scheduler` none does."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.boot import SYSTEM
from atlantis_netcfg.emulator.routeros.console.run import run_script
from atlantis_netcfg.emulator.routeros.devicemode import allowed
from atlantis_netcfg.emulator.routeros.values import seconds

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.emulator.routeros.core import Core
    from atlantis_netcfg.emulator.routeros.store import Item

_PATH = "/system/scheduler"
_AFTER_BOOT_S = 3.0


def next_run(core: Core) -> float | None:
    """When, on the core's `now`, the next job runs; None if none will."""
    return min((when for _, when in _jobs(core)), default=None)


def run_due(core: Core) -> None:
    """Run every job whose time has come, once; what it prints is lost, an error goes to the log."""
    now = core.now()
    for item, when in list(_jobs(core)):
        if when > now:
            continue
        core.ran[item.id] = now
        core.run_counts[item.id] = core.run_counts.get(item.id, 0) + 1
        script = item.values.get("on-event", "")
        error = run_script(core, SYSTEM, script).error
        if error is not None:
            core.note("script,error", error)


def _jobs(core: Core) -> Iterator[tuple[Item, float]]:
    if not allowed(core.spec, "scheduler"):
        return
    table = core.store.table(_PATH)
    for item in table.items:
        if core.store.text(table, item, "disabled") == "yes":
            continue
        when = _when(core, item)
        if when is not None:
            yield item, when


def _when(core: Core, item: Item) -> float | None:
    """An `interval` of 0 means once; `start-time=startup` is 3 s after boot, and with an interval from then on."""
    period = seconds(item.values.get("interval", "0s")) or 0.0
    first = _first(core, item)
    ran = core.ran.get(item.id)
    if ran is None:
        since = core.scheduled_since.setdefault(item.id, core.now())
        # A job that is given no start has the time of its adding there, and with an interval has not run by then
        # (manual, Scheduler: its example shows `run-count` 0).
        if first >= core.started and (first > since or (first == since and not period)):
            return first
        return _later(first, period, core.scheduled_since[item.id]) if period else None
    return _later(first, period, ran) if period else None


def _first(core: Core, item: Item) -> float:
    if item.values.get("start-time") == "startup":
        return core.started + _AFTER_BOOT_S
    date = item.values.get("start-date", "1970-01-01")
    form = "%b/%d/%Y" if "/" in date else "%Y-%m-%d"
    text = f"{date} {item.values.get('start-time', '00:00:00')}"
    moment = datetime.strptime(text, f"{form} %H:%M:%S").replace(tzinfo=UTC)
    return core.started + (moment - core.boot_clock).total_seconds()


def _later(first: float, period: float, after: float) -> float:
    """Return the first moment of the rhythm behind `after`."""
    return first + period * (max(0, int((after - first) // period)) + 1)
