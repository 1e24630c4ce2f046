"""Reading a device to say what differs: like a plan, and with what the device and the journal remember."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.routeros.apply._job import Status
from atlantis_netcfg.routeros.drift import HISTORY, Comparison, DriftKind, History, Past, compare
from atlantis_netcfg.routeros.planner import newer_than_known

if TYPE_CHECKING:
    from atlantis_netcfg.routeros.apply._job import DeviceResult
    from atlantis_netcfg.routeros.apply._work import RunContext

_FORGOTTEN = History()


async def drift(work: RunContext) -> DeviceResult:
    """End with what differs; the device's history costs one round trip, and only where something has drifted."""
    found = work.comparison = compared(work)
    if found.drifted:
        reply = await work.channel.command(HISTORY)
        if reply.trap is None:
            found = work.comparison = compared(work, History(reply.rows))
        result = work.result(Status.DRIFTED, _summary(found))
    else:
        result = work.result(Status.UNCHANGED, _as_declared(found))
    # Of the plan's notes only what holds for a look, too: the others are for whoever carries it out.
    return replace(result, notes=(*newer_than_known(work.seen.facts.version), *work.notes))


def compared(work: RunContext, history: History = _FORGOTTEN) -> Comparison:
    """Compare with the declaration, and with the last confirmed state as far as that can be read."""
    found = compare(work.job.desired, work.seen, work.aim, _past(work), history)
    left = work.left.differences()
    menus = dict.fromkeys((*found.menus, *(difference.menu for difference in left)))
    return replace(found, menus=tuple(menus), differences=(*found.differences, *left))


def _differs(work: RunContext) -> bool:
    return bool(work.aim.actions or work.aim.drift)


def _past(work: RunContext) -> Past | None:
    confirmed = work.job.confirmed
    if confirmed is None:
        return None
    if not _differs(work):
        return Past(confirmed.run, confirmed.at, {})
    try:
        return Past.read(confirmed.run, confirmed.at, confirmed.text())
    except NetcfgError as error:
        if str(error) not in work.notes:
            work.notes.append(str(error))
        return None


def _as_declared(found: Comparison) -> str:
    beside = [item for item in found.differences if item.kind is DriftKind.FOREIGN]
    hidden = [difference for difference in found.differences if difference.kind is DriftKind.HIDDEN]
    words = ["as declared"]
    if beside:
        words.append(f"{_count(len(beside), 'foreign row')} left alone as before")
    if hidden:
        words.append(f"{_count(len(hidden), 'secret')} could not be compared")
    return "; ".join(words)


def _summary(found: Comparison) -> str:
    kinds = [difference.kind for difference in found.drifted]
    parts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in DriftKind if kind in kinds)
    return f"{_count(len(kinds), 'difference')} from the declaration: {parts}"


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
