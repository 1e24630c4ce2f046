"""The stages of a run, their order and duration: a pure function of the link and the selection.

Sizes and rates beyond the rate in the inventory are left out: sending them for long costs money and shows nothing new.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory.model import Pace
from atlantis_netcfg.links.qualify import grids
from atlantis_netcfg.links.qualify.budget import IPV4_HEADERS, VPN_HEADERS
from atlantis_netcfg.links.qualify.judgement import profile
from atlantis_netcfg.links.qualify.measured_run import Selection
from atlantis_netcfg.links.qualify.messages import MessagePlan
from atlantis_netcfg.links.qualify.messages_down import requested_bytes
from atlantis_netcfg.links.qualify.reflector.stamp import AUTHENTICATED_SIZE
from atlantis_netcfg.links.qualify.search import FIRST_HZ, HALVINGS
from atlantis_netcfg.links.qualify.session import TrainPlan

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.inventory.model import Link
    from atlantis_netcfg.links.qualify.judgement import QualifyProfile

IDLE_PACKETS: Final = 600
"""Number of packets without load, as the shipped thresholds require (`min_samples`)."""
GAP_SHARE: Final = 1.2
"""Minimum duration of the train without load, as a multiple of the longest gap allowed."""
HIGHEST_HZ: Final = 64.0
"""Highest message rate that is tried."""
LOAD_SHARE: Final = 1.2
"""Load as a multiple of the link's declared rate: more than the link carries, so that its queue fills."""
LOAD_LIMIT_BPS: Final = 40e6
"""Maximum load; the far end sends at most 50 Mbit/s to one source."""
MAX_LOAD_SHARE: Final = 1.5
"""A grid cell that offers more than this multiple of the declared rate is not tried."""
SEARCH_SIZES: Final = {Selection.TELEMETRY: 200, Selection.IMAGES: 6_000, Selection.THROUGHPUT: 20_000}
"""Message sizes in octets whose highest rate is searched: 128 with RTPS headers, and two images."""
_LEAST_MESSAGES: Final = 4
_MTU_BYTES: Final = 2 * 3 * 11 * 1500
"""Bytes of both complete searches, each size sent three times: about ten sizes between 576 and 1500."""


@dataclass(frozen=True, slots=True)
class StageTimes:
    """The duration of each stage in seconds."""

    idle_interval_s: float
    timeout_s: float
    cell_s: float
    """Duration for one message size at one telemetry rate."""
    image_s: float
    load_s: float
    window_s: float
    """Duration of one window in the search for the highest rate."""
    give_up_s: float
    """Silence after which a message counts as lost, and the search for the path MTU ends."""


TIMES: Final = {
    Pace.FAST: StageTimes(0.05, 2, 10, 5, 10, 4, 10),
    Pace.MOBILE: StageTimes(0.1, 3, 20, 8, 10, 4, 30),
    Pace.SATELLITE: StageTimes(0.2, 5, 30, 10, 20, 8, 90),
}
REHEARSED_GAP_S: Final = 5.0
"""Longest gap in a rehearsal: its train without load lasts 6 s and could show no longer gap."""
REHEARSAL_TIMES: Final = StageTimes(0.01, 1.5, 1, 1, 2, 1, 5)


@dataclass(frozen=True, slots=True)
class RateCell:
    """One size at one rate of a grid."""

    stream: str
    rate_hz: float
    plan: TrainPlan | MessagePlan
    image: grids.NominalImage | None = None
    octets: int = 0


@dataclass(frozen=True, slots=True)
class QualifyPlan:
    """All stages of a run over one link."""

    selection: Selection
    times: StageTimes
    up_bps: float
    idle: TrainPlan
    load: MessagePlan | None
    load_down: MessagePlan | None
    """Load from the far end, as a separate stage: it measures the goodput."""
    cells: tuple[RateCell, ...]
    left_out: int
    """Number of grid cells omitted because the link's declared rate is too low for them."""
    sizes: tuple[int, ...]
    """Message sizes whose highest rate is searched."""
    headers: int = IPV4_HEADERS
    """Header octets of each packet on the link: IPv4 and UDP, and the overhead of the VPN."""
    tunnel_switch: TrainPlan | None = None
    """Packets that may be lost while a tunnel moves to the link; excluded from all figures."""

    @property
    def bytes(self) -> int:
        """The maximum of bytes over the link, both ways together, headers included; nothing is resent."""
        headers = self.headers
        total = grids.train_bytes(self.idle, headers) + _MTU_BYTES
        if self.tunnel_switch is not None:
            total += grids.train_bytes(self.tunnel_switch, headers)
        if self.load is not None:
            beside = TrainPlan(AUTHENTICATED_SIZE, self.idle.interval_s, self.times.load_s)
            total += grids.message_bytes(self.load, headers) + grids.train_bytes(beside, headers)
        if self.load_down is not None:
            total += requested_bytes(self.load_down, headers)
        for cell in self.cells:
            each = cell.plan
            total += (
                grids.train_bytes(each, headers) if isinstance(each, TrainPlan) else grids.message_bytes(each, headers)
            )
        return total + sum(
            grids.message_bytes(window, headers)
            for size in self.sizes
            for window in (self.single(size), *self.windows(size))
        )

    @property
    def seconds(self) -> float:
        """The duration on a link without gaps."""
        wait, times = self.times.timeout_s, self.times
        seconds = self.idle.duration_s + wait + 10 * wait
        seconds += 0 if self.tunnel_switch is None else self.tunnel_switch.duration_s + wait
        seconds += sum(times.load_s + wait for load in (self.load, self.load_down) if load is not None)
        seconds += sum(cell.plan.duration_s + wait for cell in self.cells)
        for size in self.sizes:
            seconds += sum(window.duration_s + wait for window in (self.single(size), *self.windows(size)))
        return seconds

    def single(self, size: int) -> MessagePlan:
        """Return single messages that do not affect each other: they measure the latency without load."""
        rate = 1 / max(1.0, self.times.timeout_s)
        return MessagePlan(size, rate, _LEAST_MESSAGES / rate, give_up_s=self.times.give_up_s)

    def window(self, size: int, rate_hz: float) -> MessagePlan:
        """Return messages at one rate, to test whether the link sustains it."""
        duration = max(self.times.window_s, _LEAST_MESSAGES / rate_hz)
        return MessagePlan(size, rate_hz, duration, give_up_s=self.times.give_up_s)

    def first_hz(self, size: int) -> float:
        """Return the first rate of the search: an eighth of the link's rate in the inventory."""
        return max(FIRST_HZ, min(HIGHEST_HZ, self.carries_hz(size)) / 8)

    def carries_hz(self, size: int) -> float:
        """Return how many messages a second the link's rate in the inventory allows."""
        return self.up_bps / 8 / grids.message_bytes(MessagePlan(size, 1, 1), self.headers)

    def windows(self, size: int) -> Iterator[MessagePlan]:
        """Yield every window that the search may need if the link's rate in the inventory is correct."""
        rate, bad = self.first_hz(size), min(HIGHEST_HZ, 2 * self.carries_hz(size))
        yield self.window(size, rate)
        while rate < bad:
            rate = min(2 * rate, HIGHEST_HZ)
            yield self.window(size, rate)
        for _ in range(HALVINGS):
            yield self.window(size, rate)


def thresholds_of(link: Link, *, is_rehearsal: bool = False) -> tuple[str, QualifyProfile]:
    """Return a link's thresholds with their name for people; in a rehearsal adapted to its short train."""
    settings = link.qualify
    name = (settings.profile or link.kind.traits.thresholds).value
    changes = settings.model_dump(exclude={"profile"}, exclude_none=True)
    title = msg(f"{arg(name)}, with its own {arg(join(', ', changes))}") if changes else name
    limits = profile(name).model_copy(update=changes)
    if is_rehearsal and limits.gap_s > REHEARSED_GAP_S:
        limits = limits.model_copy(update={"gap_s": REHEARSED_GAP_S})
        title += msg(f", outages up to {arg(REHEARSED_GAP_S):g} s in a rehearsal")
    return title, limits


def _idle_packets(link: Link, interval_s: float, *, is_rehearsal: bool) -> int:
    """Return enough packets for a verdict and, on a real link, to observe the longest gap allowed."""
    limits = thresholds_of(link)[1]
    outlasts = 0 if is_rehearsal else ceil(GAP_SHARE * limits.gap_s / interval_s)
    return max(IDLE_PACKETS, limits.min_samples, outlasts)


def build_plan(
    link: Link, selection: Selection, *, is_rehearsal: bool = False, over_vpn: bool = False, confirms: bool = True
) -> QualifyPlan:
    """Build the plan (pure); `confirms`: the far end is this project's, since others do not confirm messages."""
    headers = IPV4_HEADERS + (VPN_HEADERS if over_vpn else 0)
    times = REHEARSAL_TIMES if is_rehearsal else TIMES[link.kind.traits.pace]
    up_bps, down_bps = link.rate.up_kbps * 1000, link.rate.down_kbps * 1000
    selections = [part for part in SEARCH_SIZES if selection in {part, Selection.ALL}]
    cells = [*_cells(selections, times)]
    feasible_cells = [cell for cell in cells if _offered_bps(cell, headers) <= MAX_LOAD_SHARE * up_bps]
    idle_s = _idle_packets(link, times.idle_interval_s, is_rehearsal=is_rehearsal) * times.idle_interval_s
    return QualifyPlan(
        selection,
        times,
        up_bps,
        TrainPlan(AUTHENTICATED_SIZE, times.idle_interval_s, idle_s, times.timeout_s),
        _load(up_bps, times) if Selection.THROUGHPUT in selections else None,
        _load(down_bps, times) if Selection.THROUGHPUT in selections else None,
        tuple(feasible_cells),
        len(cells) - len(feasible_cells),
        tuple(SEARCH_SIZES[part] for part in selections) if confirms else (),
        headers,
        TrainPlan(AUTHENTICATED_SIZE, 0.5, 1.5, times.timeout_s) if over_vpn else None,
    )


def _load(rate_bps: float, times: StageTimes) -> MessagePlan:
    """Return messages of half a second each, back to back, at more than the link's capacity."""
    pace = min(LOAD_SHARE * rate_bps, LOAD_LIMIT_BPS)
    return MessagePlan(round(pace / 8 / 2), 2.0, times.load_s, pace_bps=pace, give_up_s=times.give_up_s)


def _cells(selections: Sequence[Selection], times: StageTimes) -> Iterator[RateCell]:
    # Fewer than ten packets prove nothing of a rate, so a rehearsal waits for no more than one.
    least = 1 if times is REHEARSAL_TIMES else _LEAST_MESSAGES
    if Selection.TELEMETRY in selections:
        for octets in grids.TELEMETRY_SIZES:
            for rate in grids.TELEMETRY_RATES_HZ:
                grid_plan = grids.telemetry_plan(octets, rate, max(times.cell_s, least / rate))
                plan = TrainPlan(grid_plan.size, grid_plan.interval_s, grid_plan.duration_s, times.timeout_s)
                yield RateCell(f"telemetry {octets} {rate:g}", rate, plan, octets=octets)
    if Selection.IMAGES in selections:
        for image in grids.IMAGES:
            for rate in grids.IMAGE_RATES_HZ:
                made_of = grids.image_plan(image, rate, max(times.image_s, _LEAST_MESSAGES / rate))
                messages = MessagePlan(made_of.size, rate, made_of.duration_s, give_up_s=times.give_up_s)
                yield RateCell(f"image {image.label} {rate:g}", rate, messages, image, image.octets)


def _offered_bps(cell: RateCell, headers: int) -> float:
    plan = cell.plan
    if isinstance(plan, TrainPlan):
        return 8 * (plan.size + headers) * cell.rate_hz
    return 8 * grids.message_bytes(MessagePlan(plan.size, 1, 1), headers) * cell.rate_hz
