"""An emulated voyage: its clock, positions and link, and the signal that the emulated unit receives.

Time passes only in `wait`, so an hour takes seconds. Positions are reports in gpsd's format. The unit is the same
emulator as in every rehearsal, read by its real driver. Packets go to our reflector over a link of the rate in the
inventory, which falls with the coverage. The coverage is invented.
"""

from __future__ import annotations

import heapq
import json
import random
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.emulator import udp_link
from atlantis_netcfg.links.qualify.reflector.answering import Reflector
from atlantis_netcfg.links.qualify.session import SECOND
from atlantis_netcfg.links.qualify.transport import Arrival
from atlantis_netcfg.records.survey import positions

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from atlantis_netcfg.emulator.coverage import Coverage, PlaceTruth, Track
    from atlantis_netcfg.records.survey.measure import RadioReader, RadioSample

KEY: Final = b"EXAMPLE key of a rehearsal"
START: Final = datetime(2026, 11, 20, 10, 15, tzinfo=UTC)
_SOURCE: Final = ("192.0.2.1", 40000)
_TTL: Final = 64
NOT_REHEARSED: Final = (
    (
        "the survey: the connection to gpsd and satellite reception; the real coverage (simulated here); which link "
        "carries the test packets"
    ),
)


@dataclass(slots=True)
class SimulatedClock:
    """Simulated clock, in nanoseconds since the start of the voyage."""

    ns: int = 0

    def now_s(self) -> float:
        """See `SurveyClock.now_s`."""
        return self.ns / SECOND

    def utc(self) -> datetime:
        """See `SurveyClock.utc`."""
        return START + timedelta(microseconds=self.ns // 1000)

    def wait(self, seconds: float) -> None:
        """See `SurveyClock.wait`; advances the clock without waiting."""
        self.reach(self.ns + round(seconds * SECOND))

    def reach(self, ns: int) -> None:
        """Advance the clock to this time; never backwards."""
        self.ns = max(self.ns, ns)


@dataclass(slots=True)
class SimulatedLink:
    """A `DatagramTransport` to our reflector over two models of a link; both clocks are the voyage's."""

    clock: SimulatedClock
    shapes: Callable[[], tuple[udp_link.LinkShape, udp_link.LinkShape]]
    """Returns the link's current properties, up and down."""
    up: udp_link.LinkModel
    down: udp_link.LinkModel
    reflector: Reflector = field(default_factory=lambda: Reflector(KEY))
    headers: int = udp_link.HEADERS
    _due: list[tuple[int, int, bool, bytes]] = field(default_factory=list)
    _count: int = 0

    @property
    def wire_bytes(self) -> int:
        """Bytes sent by this end plus bytes delivered to it."""
        return self.up.sent_bytes + self.down.delivered_bytes

    def now_ns(self) -> int:
        """See `DatagramTransport.now_ns`."""
        return self.clock.ns

    def unix_ns(self) -> int:
        """See `DatagramTransport.unix_ns`."""
        return round(START.timestamp()) * SECOND + self.clock.ns

    def send(self, datagram: bytes) -> str:
        """See `DatagramTransport.send`."""
        self._carry(datagram, up=True)
        return ""

    def _carry(self, datagram: bytes, *, up: bool) -> None:
        self.up.shape, self.down.shape = self.shapes()
        model = self.up if up else self.down
        for arrival_s in model.offer(len(datagram) + udp_link.HEADERS, self.clock.ns / SECOND):
            self._count += 1
            heapq.heappush(self._due, (max(self.clock.ns, round(arrival_s * SECOND)), self._count, up, datagram))

    def receive(self, until_ns: int) -> Arrival | None:
        """See `DatagramTransport.receive`."""
        while self._due and self._due[0][0] <= until_ns:
            at, _, up, datagram = heapq.heappop(self._due)
            self.clock.reach(at)
            if not up:
                return Arrival(datagram, at, _TTL)
            received_ns = self.unix_ns()
            reply = self.reflector.answer(datagram, _SOURCE, received_ns, _TTL, self.unix_ns)
            if reply is not None:
                self._carry(reply, up=False)
        self.clock.reach(until_ns)
        return None


@dataclass(frozen=True, slots=True)
class DeclaredRate:
    """The `rate:` of a link in the inventory."""

    rtt_s: float
    up_bps: float
    down_bps: float


def gpsd_reports(at: datetime, latitude: float, longitude: float) -> tuple[bytes, bytes]:
    """Return two reports as gpsd 3.22 writes them for a 3D fix: SKY and TPV."""
    device = "/dev/ttyACM0"
    sky = {"class": "SKY", "device": device, "hdop": 0.9, "nSat": 11, "uSat": 9}
    fix = {"class": "TPV", "device": device, "mode": 3, "time": f"{at:%Y-%m-%dT%H:%M:%S}.000Z", "ept": 0.005}
    fix |= {"lat": round(latitude, 9), "lon": round(longitude, 9), "altHAE": 59.0, "eph": 17.1}
    sky_line, fix_line = (json.dumps(row, separators=(",", ":")).encode() + b"\r\n" for row in (sky, fix))
    return sky_line, fix_line


@dataclass(slots=True)
class Voyage:
    """The emulated parts of a survey. `tune` passes the current signal to the emulated unit."""

    track: Track
    coverage: Coverage
    rate: DeclaredRate
    tune: Callable[[PlaceTruth], None]
    clock: SimulatedClock = field(default_factory=SimulatedClock)
    name: str = "an emulated track"
    reports: Callable[[datetime, float, float], Iterable[bytes]] = gpsd_reports
    """Returns gpsd's reports at a time and a place."""
    link: SimulatedLink = field(init=False)
    _stream: positions.GpsdStream = field(default_factory=positions.GpsdStream)
    _told_s: int = -1
    """Last second for which the emulated gpsd has reported."""

    def __post_init__(self) -> None:
        """Create the emulated link."""
        generators = (random.Random(1), random.Random(2))  # noqa: S311 - an emulation
        up, down = (udp_link.LinkModel(udp_link.LinkShape(), source) for source in generators)
        self.link = SimulatedLink(self.clock, self._shapes, up, down)

    @property
    def truth(self) -> PlaceTruth:
        """Signal and service at the current position."""
        return self.coverage.at(*self.track.at(self.clock.now_s()))

    def _shapes(self) -> tuple[udp_link.LinkShape, udp_link.LinkShape]:
        """Return the link properties (up, down) at the current position; without service, all packets are lost."""
        truth = self.truth
        loss, delay_s = 0.0 if truth.has_service else 1.0, self.rate.rtt_s / 2 * truth.delay_factor
        up, down = (bps * truth.rate_share for bps in (self.rate.up_bps, self.rate.down_bps))
        return udp_link.LinkShape(up, delay_s, loss=loss), udp_link.LinkShape(down, delay_s, loss=loss)

    def position(self) -> positions.TrackPosition | positions.NoPosition:
        """See `PositionSource.position`; the receiver reports once per second."""
        second = int(self.clock.now_s())
        if second != self._told_s:
            self._told_s = second
            for report in self.reports(START + timedelta(seconds=second), *self.track.at(second)):
                self._stream.feed(second, report)
        return self._stream.position(self.clock.now_s())


@dataclass(frozen=True, slots=True)
class VoyageRadio:
    """Reader of the emulated unit: sets the signal of the current position before each reading."""

    voyage: Voyage
    reader: RadioReader

    def read(self) -> RadioSample:
        """See `RadioReader.read`."""
        self.voyage.tune(self.voyage.truth)
        return self.reader.read()

    def carried_by(self) -> str | None:
        """See `RadioReader.carried_by`."""
        return self.reader.carried_by()
