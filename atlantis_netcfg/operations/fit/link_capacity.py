"""The capacity of a link and its source: the newest real run of `provision measure link`, else the inventory."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from datetime import timedelta
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.links.standing_traffic import LinkPace
from atlantis_netcfg.operations.common.traffic_budget import declared_pace
from atlantis_netcfg.runs import NoSuchRun

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from datetime import datetime

    from atlantis_netcfg.inventory.model import Link
    from atlantis_netcfg.links.qualify.archive import SavedRun
    from atlantis_netcfg.links.qualify.measured_run import MeasuredRun
    from atlantis_netcfg.links.qualify.record import QualifyRecord
    from atlantis_netcfg.runs import Store

USABLE: Final = 0.7
"""Usable share of a capacity: facts/devices.md, section 9."""
_SOURCES: Final = {
    (True, True): "measured",
    (True, False): "measured up, from inventory down",
    (False, True): "from inventory up, measured down",
    (False, False): "declared",
}


@dataclass(frozen=True, slots=True)
class Capacity:
    """The capacity of a link, and where it is known from."""

    pace: LinkPace
    down_bps: float
    loss: float | None
    """Share of the packets lost on the way up; None: not measured."""
    source: str
    """Origin of both rates."""
    run: str | None = None
    """Name of the measurement; None: there is none."""
    doubt: str = ""
    """Why a positive result would not be justified; empty: it would be."""

    def admits(self, up_bps: float, down_bps: float) -> bool:
        """Return whether this much may be sent each way."""
        return up_bps <= USABLE * self.pace.up_bps and down_bps <= USABLE * self.down_bps


def named_run(stores: Sequence[Store], site: str, run: str) -> SavedRun:
    """Return a run by its name from any of the stores; raise NoSuchRun or DamagedStateError."""
    from atlantis_netcfg.links.qualify.archive import find_run  # noqa: PLC0415 - `validate` has no run to read

    for store in stores[1:]:
        with suppress(NoSuchRun):
            return find_run(store, site, run)
    return find_run(stores[0], site, run)


def newest_run(store: Store, site: str, link: Link) -> SavedRun | None:
    """Return a link's newest real run that filled it, else its newest real run."""
    from atlantis_netcfg.links.qualify.archive import record_of, stored_runs  # noqa: PLC0415 - `validate` has no run to read

    real = [saved_run for saved_run in reversed(stored_runs(store, site, link.name)) if not saved_run.run.emulated]
    return next(
        (saved_run for saved_run in real if _goodput(record_of(saved_run), "up") is not None), real[0] if real else None
    )


def _goodput(record: QualifyRecord, way: str) -> float | None:
    """Return the measured capacity in bit/s with all headers: the goodput plus the overhead of each chunk."""
    row = next((row for row in record.load if row.way == way), None)
    if row is None or row.goodput_bps is None or row.verdict is not Verdict.PASS:
        return None
    from atlantis_netcfg.links.qualify.budget import IPV4_HEADERS, VPN_HEADERS  # noqa: PLC0415 - `validate` has no run to read
    from atlantis_netcfg.links.qualify.grids import message_bytes  # noqa: PLC0415 - `validate` has no run to read
    from atlantis_netcfg.links.qualify.messages import MessagePlan  # noqa: PLC0415 - `validate` has no run to read

    headers = IPV4_HEADERS + (VPN_HEADERS if record.run.far_end.over_vpn else 0)
    return row.goodput_bps * message_bytes(MessagePlan(row.size, 1.0, 1.0), headers) / row.size


def capacity_of(link: Link, saved_run: SavedRun | None, now: datetime, within_days: int) -> Capacity:
    """Return the capacity measured by a run, as far as it goes; without a run, the inventory's.

    A measurement older than `within_days` tells what the link was, not what it is.
    """
    pace, down = declared_pace(link), link.rate.down_kbps * 1000
    if saved_run is None:
        doubt = "only the rate in the inventory is known: this link was not measured"
        return Capacity(pace, down, None, "declared", doubt=doubt)
    from atlantis_netcfg.links.qualify.archive import record_of  # noqa: PLC0415 - `validate` has no run to read

    record = record_of(saved_run)
    measured_up, measured_down, idle = _goodput(record, "up"), _goodput(record, "down"), record.idle
    rtt_s = pace.rtt_s if idle is None or idle.rtt is None else idle.rtt.p50
    return Capacity(
        LinkPace(rtt_s, measured_up or pace.up_bps),
        measured_down or down,
        None if idle is None else idle.flr.share_up,
        _SOURCES[measured_up is not None, measured_down is not None],
        saved_run.run.id,
        join("; ", _doubts(saved_run.run, now - timedelta(days=within_days), measured_up, measured_down)),
    )


def _doubts(run: MeasuredRun, oldest: datetime, up: float | None, down: float | None) -> Iterator[str]:
    if run.emulated:
        yield "the run was emulated: it proves nothing about the real link"
    if run.way is not Verdict.PASS:
        yield msg(f"the run does not prove that it used {arg(run.link)}")
    if run.begun < oldest:
        yield "the run is older than `qualified_within_days` of the checklist allows"
    if not up:
        yield "the run measured no capacity from the site: the inventory's is used"
    if not down:
        yield "the run measured no capacity to the site: the inventory's is used"
