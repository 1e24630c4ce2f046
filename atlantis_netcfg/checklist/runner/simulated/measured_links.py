"""A simulated measurement of a link, which shows the effect of a fault of the link in a rehearsed checklist.

No packet was sent for it: it never passes. `provision measure link --rehearse` measures an emulated link.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Final

from atlantis_netcfg import __version__
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.inventory.model import LinkKind
from atlantis_netcfg.links.qualify import measured_run
from atlantis_netcfg.links.qualify.judgement import profile
from atlantis_netcfg.links.qualify.record import QualifyRecord, make_record
from atlantis_netcfg.links.qualify.samples import (
    CounterSample,
    MessageResult,
    PacketSent,
    ReplySample,
    StreamEnd,
    TrainBegan,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.links.qualify.samples import Sample

_SECOND: Final = 1_000_000_000
_INTERVAL_S: Final = 0.25
_SIZE: Final = 172
_THRESHOLDS: Final = {
    LinkKind.SATELLITE: "satellite",
    LinkKind.LTE: "lte",
    LinkKind.WIFI_PTP: "wifi",
    LinkKind.ETHERNET: "wifi",
}


@dataclass(frozen=True, slots=True)
class MeasuredLink:
    """A simulated link that meets its thresholds, until a fault changes it."""

    name: str
    kind: LinkKind
    age: timedelta = timedelta(days=1)
    slower: float = 0.5
    """Its round-trip time, as a share of the one that its thresholds allow."""
    way: Verdict = Verdict.PASS

    def record(self, site: str, now: datetime) -> QualifyRecord:
        """Return its measurement as of this time."""
        name = _THRESHOLDS[self.kind]
        limits = profile(name)
        start = now - self.age
        run = measured_run.MeasuredRun(
            id=f"{self.name}-{start:%Y%m%dT%H%M%SZ}",
            tool=__version__,
            site=site,
            link=self.name,
            kind=self.kind.value,
            emulated=True,
            selection=measured_run.Selection.ALL,
            far_end=measured_run.FarEnd(name="", address="", port=0, over_vpn=False, authenticated=True, source=""),
            begun=start,
            ended=start + timedelta(minutes=4),
            reason="done",
            clock_synchronised=False,
            budget=measured_run.BudgetLimits(),
            way=self.way,
            way_reason="" if self.way is Verdict.PASS else "the packets were counted on another link",
            thresholds_name=name,
            thresholds=limits,
        )
        return make_record(run, self.samples(now))

    def samples(self, now: datetime) -> Iterator[Sample]:
        """Yield a train without load, and one with a longer round trip during a load that fills the link."""
        limits, start = profile(_THRESHOLDS[self.kind]), now - self.age
        rtt_s = self.slower * limits.ftd_s
        yield from _train("idle", limits.min_samples, rtt_s, start)
        yield from _train("loaded", limits.min_samples // 10, rtt_s * (1 + limits.buffer_delay / 2), start)
        for number, late in enumerate(range(0, 3 * _SECOND, _SECOND)):
            begin, end = number * _SECOND + late // 4, (number + 1) * _SECOND + late // 2
            yield MessageResult(
                "load up", number, 9000, 9, 9, number * _SECOND, end, 9000, begin, end, in_flight=False, due_ns=_SECOND
            )


def _train(stream: str, packets: int, rtt_s: float, start: datetime) -> Iterator[Sample]:
    """Yield a train of which every packet is answered after the same time, half of it each way."""
    since, step, half = round(start.timestamp()) * _SECOND, round(_INTERVAL_S * _SECOND), round(rtt_s / 2 * _SECOND)
    yield TrainBegan(stream, 0, since, _SIZE, _INTERVAL_S, packets * _INTERVAL_S, 90.0, 28, True, False)
    for number in range(packets):
        sent_ns = number * step
        there = since + sent_ns + half
        yield PacketSent(stream, number, sent_ns)
        yield ReplySample(stream, number, sent_ns + 2 * half, number, there, there, _SIZE, 64, 0)
    yield CounterSample(stream, packets, 0, 0, packets)
    yield StreamEnd(stream, packets * step + round(90.0 * _SECOND), "done")
