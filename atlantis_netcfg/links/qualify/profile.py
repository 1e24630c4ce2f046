"""A link profile: a link's measured behaviour, in the form that a rehearsal replays.

It is computed from the train `idle` of a run and from its messages, and saved as `profile.json` in the run's folder.
Each direction has its delays (sorted, so each is a percentile), loss, duplicates and reordering outside of gaps, the
rate at which messages arrived, and the longest packet. Gaps have their lengths and directions.

Split of the round trip: without synchronised clocks a one-way delay is known up to a constant only. Then each direction
gets half of the sum of both minimum delays; the variation above them is known per direction. A steady drift between
both clocks is removed. Not in a profile: the order of delays, whether both directions were slow at the same time, loss
in bursts shorter than a gap, and how delay and loss change with the load.
"""

from __future__ import annotations

import math
from statistics import median
from typing import TYPE_CHECKING, Final

from pydantic import BaseModel, ConfigDict

from atlantis_netcfg.core.atomic_files import write_atomically
from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg
from atlantis_netcfg.links.qualify import measured_run, responses
from atlantis_netcfg.links.qualify.figures import percentile
from atlantis_netcfg.links.qualify.reflector import stamp
from atlantis_netcfg.links.qualify.samples import (
    CounterSample,
    MessageResult,
    PacketSent,
    ReplySample,
    TrainBegan,
    read,
)
from atlantis_netcfg.links.qualify.transfers import message_figures

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from atlantis_netcfg.links.qualify.responses import AnsweredPacket, Silence
    from atlantis_netcfg.links.qualify.samples import Sample

VERSION: Final = 1
PROFILE_FILE: Final = "profile.json"
IDLE: Final = "idle"
_LOAD_DOWN: Final = "load down"
"""The only message stream that the far end sends; all others go up."""
_MOST_DELAYS: Final = 1000
_FEWEST: Final = 20
"""Minimum number of answered packets for a profile."""
_MOST_DRIFT: Final = 200e-6
"""Maximum plausible drift between two clocks; a larger one means that the link itself has changed."""
_SECOND: Final = 1_000_000_000


class NoProfile(UsageError, ValueError):
    """The path is no run, or its run has too little data to be replayed."""


class ProfilePart(BaseModel):
    """A part of `profile.json`."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class DirectionProfile(ProfilePart):
    """The behaviour of one direction; loss, duplicates and reordering are shares of packets outside of gaps."""

    delays_s: tuple[float, ...]
    """Delays in ascending order, equally likely; includes the time for sending a test packet."""
    loss: float
    duplicates: float
    reordered: float
    reorder_s: float
    """Median delay of overtaken packets minus the median delay of the others, in seconds."""
    rate_bps: float | None
    """Rate including IP and UDP headers; None: not measured."""
    mtu: int | None


class ProfileGap(ProfilePart):
    """A period in which packets did not pass, in one or both directions."""

    seconds: float
    up: bool
    down: bool


class LinkProfile(ProfilePart):
    """The behaviour of a link, as a rehearsal needs it."""

    version: int = VERSION
    run: str
    site: str
    link: str
    kind: str
    emulated: bool
    """Whether the run was itself a rehearsal."""
    recorded_s: float
    """Duration of the train in seconds; its gaps are replayed with this period."""
    interval_s: float
    packet_octets: int
    """Size in octets of the train's packets, headers included."""
    packets: int
    split: str
    up: DirectionProfile
    down: DirectionProfile
    gaps: tuple[ProfileGap, ...]


def profile_of(run: measured_run.MeasuredRun, samples: Iterable[Sample]) -> LinkProfile:
    """Compute the profile of a run; raise NoProfile if its train is missing or had too few responses."""
    all_samples = [*samples]
    idle = [sample for sample in all_samples if sample.stream == IDLE]
    begin = next((sample for sample in idle if isinstance(sample, TrainBegan)), None)
    pairs = responses.answered_packets(
        [sample for sample in idle if isinstance(sample, PacketSent)],
        [sample for sample in idle if isinstance(sample, ReplySample)],
    )
    if begin is None or len(pairs) < _FEWEST:
        raise NoProfile(
            f"run {arg(run.id)} cannot be replayed: {arg(len(pairs))} packets of its train `{arg(IDLE)}` were answered",
            hint=f"take a run in which at least {arg(_FEWEST)} were",
        )
    known_packets = responses.packets_of_known_fate(idle, begin)
    silences = responses.find_silences(
        known_packets, pairs, next((s for s in idle if isinstance(s, CounterSample)), None)
    )
    least_rtt = min(pair.rtt for pair in pairs) / _SECOND
    gaps = tuple(_gap(silence, begin.interval_s, least_rtt) for silence in silences if responses.is_gap(silence, begin))
    loss_up, loss_down = _losses([s for s in silences if not responses.is_gap(s, begin)], len(pairs))
    up, down, split = _delays(begin, pairs)
    counters = next((sample for sample in idle if isinstance(sample, CounterSample)), None)
    replies = sum(isinstance(sample, ReplySample) for sample in idle)
    by_number = sorted(pairs, key=lambda pair: pair.reflector_sequence)
    by_arrival = sorted(pairs, key=lambda pair: pair.arrived_at_ns)
    late_up = _reorder_lines([(pair.sequence, pair.sequence) for pair in by_number])
    late_down = _reorder_lines([(pair.reflector_sequence, pair.sequence) for pair in by_arrival])
    rate_up, rate_down = _rates(all_samples, begin.headers)
    return LinkProfile(
        run=run.id,
        site=run.site,
        link=run.link,
        kind=run.kind,
        emulated=run.emulated,
        recorded_s=(known_packets[-1].sent_at_ns - known_packets[0].sent_at_ns) / _SECOND + begin.interval_s,
        interval_s=begin.interval_s,
        packet_octets=begin.size + begin.headers,
        packets=len(pairs),
        split=split,
        up=_direction(
            up, late_up, loss_up, (counters.duplicates if counters else 0) / len(pairs), rate_up, run.path_mtu_up
        ),
        down=_direction(down, late_down, loss_down, (replies - len(pairs)) / len(pairs), rate_down, run.path_mtu_both),
        gaps=gaps,
    )


def _gap(silence: Silence, interval_s: float, least_rtt_s: float) -> ProfileGap:
    """Return the length and direction of a gap; a gap both ways also loses responses to packets just before it."""
    duration_s, down = silence.packets * interval_s, silence.down
    few = responses.LEAST_GAP_PACKETS - 1
    if down == 0:
        return ProfileGap(seconds=duration_s, up=True, down=False)
    if down is not None and silence.packets - down <= few < down:
        return ProfileGap(seconds=duration_s, up=False, down=True)
    answers_s = least_rtt_s / 2 if down is None else min(down * interval_s, least_rtt_s / 2)
    return ProfileGap(seconds=max(interval_s, duration_s - answers_s), up=True, down=True)


def _losses(silences: Sequence[Silence], answered_count: int) -> tuple[float, float]:
    """Return the loss shares up and down; equal shares if the direction is not known."""
    lost_count = sum(silence.packets for silence in silences)
    if any(silence.down is None for silence in silences):
        share = 1 - math.sqrt(answered_count / (answered_count + lost_count))
        return share, share
    down = sum(silence.down or 0 for silence in silences)
    return (lost_count - down) / (answered_count + lost_count), down / (answered_count + down)


def _delays(begin: TrainBegan, pairs: Sequence[AnsweredPacket]) -> tuple[dict[int, float], dict[int, float], str]:
    """Return each answered packet's delay up and down by number, and how the round trip was split."""
    up = [(pair.received_ns - begin.begin_ns - (pair.sent_at_ns - begin.begin_at_ns)) / _SECOND for pair in pairs]
    down = [(pair.arrived_at_ns - begin.begin_at_ns - (pair.replied_ns - begin.begin_ns)) / _SECOND for pair in pairs]
    numbers = [pair.sequence for pair in pairs]
    if begin.synchronised and all(stamp.is_synchronised(pair.error) for pair in pairs) and min(*up, *down) > 0:
        return dict(zip(numbers, up, strict=True)), dict(zip(numbers, down, strict=True)), "by both clocks"
    drift = _drift([pair.sent_at_ns / _SECOND for pair in pairs], [(u - d) / 2 for u, d in zip(up, down, strict=True)])
    up = [value - drift * pair.sent_at_ns / _SECOND for value, pair in zip(up, pairs, strict=True)]
    down = [value + drift * pair.sent_at_ns / _SECOND for value, pair in zip(down, pairs, strict=True)]
    half = (min(up) + min(down)) / 2
    return (
        {number: value - min(up) + half for number, value in zip(numbers, up, strict=True)},
        {number: value - min(down) + half for number, value in zip(numbers, down, strict=True)},
        "half of the sum of both least delays each way",
    )


def _drift(times_s: Sequence[float], differences_s: Sequence[float]) -> float:
    """Return the far clock's drift in s/s, from the medians of the first and the last third."""
    third = len(times_s) // 3
    span = median(times_s[-third:]) - median(times_s[:third])
    drift = (median(differences_s[-third:]) - median(differences_s[:third])) / span if span > 0 else 0.0
    return drift if abs(drift) <= _MOST_DRIFT else 0.0


def _reorder_lines(arrivals: Sequence[tuple[int, int]]) -> set[int]:
    """Return the packets that arrived after a later one; `arrivals` holds sending order and number."""
    highest_order, late_numbers = -1, set()
    for order, number in arrivals:
        if order < highest_order:
            late_numbers.add(number)
        highest_order = max(highest_order, order)
    return late_numbers


def _direction(  # noqa: PLR0913, PLR0917 - all that is known of a direction
    delays: dict[int, float], late: set[int], loss: float, copies: float, rate_bps: float | None, mtu: int | None
) -> DirectionProfile:
    in_order = sorted(delay for number, delay in delays.items() if number not in late) or sorted(delays.values())
    overtaken = [delay for number, delay in delays.items() if number in late]
    return DirectionProfile(
        delays_s=tuple(round(max(0.0, delay), 6) for delay in _thin_out(in_order)),
        loss=loss,
        duplicates=max(0.0, copies),
        reordered=len(overtaken) / len(delays),
        reorder_s=max(0.0, median(overtaken) - percentile(in_order, 0.5)) if overtaken else 0.0,
        rate_bps=rate_bps,
        mtu=mtu,
    )


def _thin_out(sorted_values: Sequence[float]) -> Sequence[float]:
    """Reduce the values to the maximum number of percentiles, keeping minimum and maximum."""
    if len(sorted_values) <= _MOST_DELAYS:
        return sorted_values
    return [sorted_values[round(n * (len(sorted_values) - 1) / (_MOST_DELAYS - 1))] for n in range(_MOST_DELAYS)]


def _rates(samples: Sequence[Sample], headers: int) -> tuple[float | None, float | None]:
    """Return the highest rates of arriving messages on the wire: up and down; None if not measured."""
    names = dict.fromkeys(sample.stream for sample in samples if isinstance(sample, MessageResult))
    rates = {name: rate for name in names if (rate := _rate(samples, name, headers)) is not None}
    down = [rate for name, rate in rates.items() if name == _LOAD_DOWN]
    up = [rate for name, rate in rates.items() if name != _LOAD_DOWN]
    return max(up, default=None), max(down, default=None)


def _rate(samples: Sequence[Sample], stream: str, headers: int) -> float | None:
    figures = message_figures(samples, stream)
    if figures is None or figures.busy_bps is None or figures.is_bounded:
        return None
    payload = figures.size / figures.chunks
    overhead = stamp.AUTHENTICATED_SIZE + stamp.HMAC_TLV_SIZE + stamp.CHUNK_HEADER_SIZE + headers
    return figures.busy_bps * (payload + overhead) / payload


def write_profile(folder: Path, profile: LinkProfile) -> None:
    """Replace `profile.json` in a run's folder atomically."""
    write_atomically(folder / PROFILE_FILE, f"{profile.model_dump_json(indent=1)}\n".encode())


def read_profile(path: Path) -> LinkProfile:
    """Read a `profile.json`, or the one of a run's folder, creating it if missing; raise NoProfile."""
    file = path / PROFILE_FILE if path.is_dir() else path
    try:
        if path.is_dir() and not file.is_file():
            run = measured_run.read_run(path)
            with (path / measured_run.SAMPLES_FILE).open(encoding="utf-8") as lines:
                profile = profile_of(run, read(lines, str(path / measured_run.SAMPLES_FILE)))
            write_profile(path, profile)
            return profile
        profile = LinkProfile.model_validate_json(file.read_text(encoding="utf-8"))
    except NoProfile:
        raise
    except (OSError, ValueError) as error:
        raise NoProfile(
            f"{arg(path)} holds no measured run that can be replayed",
            hint=f"name the folder of a run ({arg(measured_run.RUN_FILE)}, {arg(measured_run.SAMPLES_FILE)}),"
            f" or its {arg(PROFILE_FILE)}",
        ) from error
    if profile.version != VERSION:
        raise NoProfile(f"{arg(file)} is of version {arg(profile.version)}, and this program reads {arg(VERSION)}")
    return profile
