"""A network with a clock of its own: our reflector without its socket, and a link of known truth before it."""

import heapq
import io
import random
from collections.abc import Callable
from dataclasses import dataclass, field

from atlantis_netcfg.emulator.udp_link import HEADERS, LinkModel, LinkShape
from atlantis_netcfg.links.qualify.budget import Budget, BudgetGuard
from atlantis_netcfg.links.qualify.reflector.answering import Reflector
from atlantis_netcfg.links.qualify.samples import Sample, SampleWriter, read
from atlantis_netcfg.links.qualify.session import ReflectorPeer, Train, TrainPlan, run
from atlantis_netcfg.links.qualify.transport import Arrival

KEY = b"an example key, 32 octets long.."
SECOND = 1_000_000_000
START = 1_790_000_000 * SECOND
SOURCE = ("192.0.2.1", 40000)


@dataclass
class SimulatedNetwork:
    """Time passes only while somebody waits. The reflector's clock is ahead by `skew_ns`, and fast by `drift`."""

    up: LinkModel
    down: LinkModel
    reflector: Reflector
    skew_ns: int = 0
    drift: float = 0.0
    residence_ns: int = 100_000
    headers: int = HEADERS
    now: int = 0
    interrupt_at_ns: int | None = None
    answers: Callable[[bytes, int], bytes | None] | None = None
    """Another reflector than ours: datagram and its clock."""
    truth_up_ns: list[int] = field(default_factory=list)
    """Delay of each packet that arrived at the far end, in the order of sending."""
    truth_down_ns: list[int] = field(default_factory=list)
    truth_replied_ns: list[int] = field(default_factory=list)
    """When each of these left the far end."""
    delivered_bytes: int = 0
    longest_reply_over_request: int = 0
    _due: list[tuple[int, int, bool, bytes]] = field(default_factory=list)
    _count: int = 0

    def now_ns(self) -> int:
        return self.now

    def unix_ns(self) -> int:
        return START + self.now

    def far_ns(self) -> int:
        return START + self.now + self.skew_ns + round(self.now * self.drift)

    def send(self, datagram: bytes) -> str:
        self._carry(datagram, up=True)
        return ""

    def _carry(self, datagram: bytes, *, up: bool) -> None:
        model, truth = (self.up, self.truth_up_ns) if up else (self.down, self.truth_down_ns)
        for copy, arrival_s in enumerate(model.offer(len(datagram) + HEADERS, self.now / SECOND)):
            arrival = max(self.now, round(arrival_s * SECOND))
            if not copy:
                truth.append(arrival - self.now)
                if not up:
                    self.truth_replied_ns.append(self.now)
            self._count += 1
            heapq.heappush(self._due, (arrival, self._count, up, datagram))

    def _far_sends(self) -> int | None:
        """When the reflector sends the next chunk that was requested, on our clock."""
        due = self.reflector.due_ns()
        return None if due is None else max(self.now, round((due - START - self.skew_ns) / (1 + self.drift)) + 1)

    def receive(self, until_ns: int) -> Arrival | None:
        while (at := self._next()) is not None and at <= until_ns:
            if at == self._far_sends():
                self._pass(at)
                requested = self.reflector.requested_chunk(self.far_ns)
                if requested is not None:
                    self._carry(requested[0], up=False)
                continue
            at, _, up, datagram = heapq.heappop(self._due)
            self._pass(at)
            if not up:
                self.delivered_bytes += len(datagram) + HEADERS
                return Arrival(datagram, at, 64)
            reply = self._answer(datagram)
            if reply is not None:
                self.now += self.residence_ns
                self.longest_reply_over_request = max(self.longest_reply_over_request, len(reply) - len(datagram))
                self._carry(reply, up=False)
        if until_ns < 1 << 62:
            self._pass(until_ns)
        return None

    def _next(self) -> int | None:
        times = [self._due[0][0]] if self._due else []
        far = self._far_sends()
        return min(times if far is None else [far, *times], default=None)

    def drain(self) -> None:
        """Let everything arrive that is under way: an interface counts it, also where nobody listens any more."""
        while self._next() is not None:
            self.receive(1 << 62)

    def _answer(self, datagram: bytes) -> bytes | None:
        received = self.far_ns()
        if self.answers is not None:
            return self.answers(datagram, received)
        return self.reflector.answer(datagram, SOURCE, received, 64, lambda: received + self.residence_ns)

    def _pass(self, at: int) -> None:
        if self.interrupt_at_ns is not None and at >= self.interrupt_at_ns:
            self.now, self.interrupt_at_ns = self.interrupt_at_ns, None
            raise KeyboardInterrupt
        self.now = max(self.now, at)


def network(
    up: LinkShape | None = None, down: LinkShape | None = None, seed: int = 1, **changes: object
) -> SimulatedNetwork:
    key = changes.pop("key", KEY)
    assert key is None or isinstance(key, bytes)
    return SimulatedNetwork(
        LinkModel(up or LinkShape(), random.Random(seed)),  # noqa: S311 - an emulation
        LinkModel(down or LinkShape(), random.Random(seed + 1)),  # noqa: S311
        Reflector(key),
        **changes,  # type: ignore[arg-type] # fields of the class
    )


@dataclass
class Recording:
    """Takes samples as a run writes them."""

    text: io.StringIO = field(default_factory=io.StringIO)

    @property
    def write(self) -> SampleWriter:
        return SampleWriter(self.text)

    @property
    def samples(self) -> list[Sample]:
        return [*read(self.text.getvalue().splitlines(keepends=True))]


def unlimited(net: SimulatedNetwork) -> BudgetGuard:
    return BudgetGuard(Budget(), lambda: net.now / SECOND)


def run_train(net: SimulatedNetwork, plan: TrainPlan, peer: ReflectorPeer | None = None) -> tuple[str, list[Sample]]:
    peer = peer or ReflectorPeer(KEY)
    recording = Recording()
    train = Train("train", plan, peer, net, recording.write)
    return run(net, peer, [train], unlimited(net)), recording.samples
