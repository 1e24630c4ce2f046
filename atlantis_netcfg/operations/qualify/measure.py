"""Execution of the stages of a run, one by one, within one budget; every sample is written at once."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.links.qualify import search, session
from atlantis_netcfg.links.qualify.figures import train_figures
from atlantis_netcfg.links.qualify.messages import MessageStream
from atlantis_netcfg.links.qualify.messages_down import DownMessageStream
from atlantis_netcfg.links.qualify.path_mtu import ETHERNET, PathMtu, path_mtu
from atlantis_netcfg.links.qualify.reflector.stamp import AUTHENTICATED_SIZE
from atlantis_netcfg.links.qualify.samples import MessageResult, PacketSent, ReplySample
from atlantis_netcfg.links.qualify.transfers import message_figures
from atlantis_netcfg.operations.qualify.plan import HIGHEST_HZ

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from atlantis_netcfg.links.qualify.budget import BudgetGuard
    from atlantis_netcfg.links.qualify.messages import MessagePlan
    from atlantis_netcfg.links.qualify.samples import Sample
    from atlantis_netcfg.links.qualify.transfers import MessageFigures
    from atlantis_netcfg.links.qualify.transport import Arrival, DatagramTransport
    from atlantis_netcfg.operations.qualify.plan import QualifyPlan, RateCell

TUNNEL_SWITCH, IDLE, UNDER_LOAD, LOAD_UP, LOAD_DOWN = "led", "idle", "loaded", "load up", "load down"
CUT_OFF = "cut off"
"""End reason of a run that could not record one."""


class CountedTransport:
    """A transport that counts sent and received packets, and ends a measurement on request.

    `tunnel_headers`: the bytes that a tunnel adds to each packet; they are on the wire, and paid, as well.
    """

    def __init__(
        self, inner: DatagramTransport, stop: threading.Event | None = None, *, tunnel_headers: int = 0
    ) -> None:
        self.headers = inner.headers + tunnel_headers
        self.tunnel_headers = tunnel_headers
        self.sent_packets = self.sent_bytes = 0
        self.received_packets = self.received_bytes = 0
        self._inner = inner
        self._stop = threading.Event() if stop is None else stop

    def now_ns(self) -> int:
        """See `DatagramTransport`."""
        return self._inner.now_ns()

    def unix_ns(self) -> int:
        """See `DatagramTransport`."""
        return self._inner.unix_ns()

    def send(self, datagram: bytes) -> str:
        """See `DatagramTransport`."""
        error = self._inner.send(datagram)
        if not error:
            self.sent_packets += 1
            self.sent_bytes += len(datagram) + self.headers
        return error

    def receive(self, until_ns: int) -> Arrival | None:
        """See `DatagramTransport`; raise KeyboardInterrupt if a stop was requested."""
        if self._stop.is_set():
            raise KeyboardInterrupt
        arrival = self._inner.receive(until_ns)
        if arrival is not None:
            self.received_packets += 1
            self.received_bytes += len(arrival.datagram) + self.headers
        return arrival


@dataclass(slots=True)
class Measurement:
    """A measurement in progress; `samples` are those written so far."""

    plan: QualifyPlan
    peer: session.ReflectorPeer
    transport: CountedTransport
    guard: BudgetGuard
    keep: Callable[[Sample], None]
    say: Callable[[str, int, int], None] = lambda _message, _step, _total: None
    samples: list[Sample] = field(default_factory=list)
    mtu: PathMtu = field(default_factory=lambda: PathMtu(None, None, "not measured"))
    rates: list[search.SustainedRate] = field(default_factory=list)
    reason: str = CUT_OFF
    """End reason, once the run has begun."""
    unanswered_sizes: int = 0
    """Unanswered packets of the search for the path MTU; most of them were too long."""

    @property
    def max_lost(self) -> int:
        """The maximum number of packets that may have been lost on the link."""
        return lost_packets(self.samples) + self.unanswered_sizes

    def write(self, sample: Sample) -> None:
        """Write a sample to disk, and keep it for the figures."""
        self.keep(sample)
        self.samples.append(sample)

    def measure(self) -> str:
        """Send everything and return why it ended; samples are kept in any case."""
        stages: list[tuple[str, Callable[[], None]]] = [
            *([("the tunnel over the link", self._run_tunnel_switch)] if self.plan.tunnel_switch is not None else []),
            ("round trips without load", self._measure_idle),
            ("path MTU", self._measure_mtu),
            *([("round trips under load", self._measure_load)] if self.plan.load is not None else []),
            *([("goodput from the far end", self._measure_load_down)] if self.plan.load_down is not None else []),
            *((cell.stream, partial(self._measure_cell, cell)) for cell in self.plan.cells),
            *(
                (msg(f"maximum rate of {arg(size)} octets"), partial(self._search_rate, size))
                for size in self.plan.sizes
            ),
        ]
        self.reason = session.EndReason.DONE
        for number, (name, stage) in enumerate(stages):
            self.say(name, number, len(stages))
            try:
                stage()
            except KeyboardInterrupt:
                self.reason = session.EndReason.STOPPED
            if self.reason != session.EndReason.DONE:
                break
        if self.reason == session.EndReason.DONE and self.plan.left_out and not self.plan.cells:
            self.reason = session.EndReason.LEFT_OUT
        return self.reason

    def _run_tunnel_switch(self) -> None:
        assert self.plan.tunnel_switch is not None  # noqa: S101 - `measure` has looked
        self._run_streams(session.Train(TUNNEL_SWITCH, self.plan.tunnel_switch, self.peer, self.transport, self.write))

    def _measure_idle(self) -> None:
        self._run_streams(session.Train(IDLE, self.plan.idle, self.peer, self.transport, self.write))

    def _measure_mtu(self) -> None:
        times = self.plan.times
        timeout = min(3.0, times.timeout_s)
        before = self.transport.sent_packets - self.transport.received_packets
        around = self.transport.tunnel_headers
        self.mtu = path_mtu(
            self.transport,
            self.peer,
            self.guard,
            highest=ETHERNET - around,  # what is longer, a tunnel sends in two pieces
            timeout_s=timeout,
            patience_s=times.give_up_s,
            headers=self.transport.headers - around,
        )
        self.unanswered_sizes = max(0, self.transport.sent_packets - self.transport.received_packets - before)
        if self.guard.limited_by is not None:
            self.reason = self.guard.limited_by
        elif self.mtu.both is None and not any(isinstance(each, ReplySample) for each in self.samples):
            self.reason = session.EndReason.SILENT

    def _measure_load(self) -> None:
        assert self.plan.load is not None  # noqa: S101 - `measure` has looked
        idle = self.plan.idle
        beside = session.TrainPlan(AUTHENTICATED_SIZE, idle.interval_s, self.plan.times.load_s, idle.timeout_s)
        self._run_streams(
            session.Train(UNDER_LOAD, beside, self.peer, self.transport, self.write),
            self._stream(LOAD_UP, self.plan.load),
        )

    def _measure_load_down(self) -> None:
        assert self.plan.load_down is not None  # noqa: S101 - `measure` has looked
        self._run_streams(DownMessageStream(LOAD_DOWN, self.plan.load_down, self.peer, self.transport, self.write))

    def _measure_cell(self, cell: RateCell) -> None:
        self._run_streams(self._stream(cell.stream, cell.plan))

    def _stream(self, name: str, plan: session.TrainPlan | MessagePlan) -> session.PacketStream:
        if isinstance(plan, session.TrainPlan):
            return session.Train(name, plan, self.peer, self.transport, self.write)
        return MessageStream(name, plan, self.peer, self.transport, self.write)

    def _run_streams(self, *streams: session.PacketStream) -> None:
        self.reason = session.run(self.transport, self.peer, streams, self.guard)

    def _search_rate(self, size: int) -> None:
        idle = self._measure_messages(f"rate {size} 0", size, None)
        if idle is None:
            return
        if idle.delay_p95_s is None:
            self.rates.append(search.SustainedRate(size, None, search.RateLimit.SILENCE, ()))
            return
        result = search.sustained_rate(
            size,
            lambda rate: self._measure_messages(f"rate {size} {rate:g}", size, rate),
            idle_latency_s=0.0 if idle.latency is None else idle.latency.p50,
            idle_loss=train_figures(self.samples, IDLE).flr.share_up,
            first_hz=self.plan.first_hz(size),
            highest_hz=HIGHEST_HZ,
        )
        self.rates.append(result)

    def _measure_messages(self, stream: str, size: int, rate_hz: float | None) -> MessageFigures | None:
        plan = self.plan.single(size) if rate_hz is None else self.plan.window(size, rate_hz)
        self._run_streams(self._stream(stream, plan))
        return message_figures(self.samples, stream) if self.reason == session.EndReason.DONE else None


def lost_packets(samples: Iterable[Sample]) -> int:
    """Return the maximum of lost packets: unanswered test packets, and chunks of incomplete messages."""
    sample_list: Sequence[Sample] = tuple(samples)
    sent_packets = {
        (each.stream, each.sequence) for each in sample_list if isinstance(each, PacketSent) and not each.error
    }
    answered_packets = {(each.stream, each.sequence) for each in sample_list if isinstance(each, ReplySample)}
    chunks = sum(
        each.chunks_sent for each in sample_list if isinstance(each, MessageResult) and each.acknowledged_at_ns is None
    )
    return len(sent_packets - answered_packets) + chunks
