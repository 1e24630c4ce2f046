"""Set-up of a site's survey: unit, router, far end and clock, real or all emulated."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from atlantis_netcfg import __version__
from atlantis_netcfg.checklist.probes.gps import GPSD_PORT
from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.emulator import coverage
from atlantis_netcfg.inventory.model import Gateway
from atlantis_netcfg.links.qualify.session import ReflectorPeer
from atlantis_netcfg.links.qualify.transport import UdpTransport
from atlantis_netcfg.operations.computers._access import computer_access
from atlantis_netcfg.operations.computers.remote_session import ssh_command
from atlantis_netcfg.operations.qualify.far_end import key_of
from atlantis_netcfg.records.survey import measure, rehearsal
from atlantis_netcfg.records.survey.points import SurveyHeader
from atlantis_netcfg.records.survey.positions import (
    MAX_AGE_S,
    MAX_HDOP,
    GpsdSource,
    NoPosition,
    parse_gpsd_address,
    parse_position,
)
from atlantis_netcfg.records.survey.radio import UnitRadio

if TYPE_CHECKING:
    from collections.abc import Callable
    from contextlib import ExitStack

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.inventory.model import Link
    from atlantis_netcfg.links.qualify.samples import Sample
    from atlantis_netcfg.operations import Request
    from atlantis_netcfg.records.survey.points import SurveyPoint
    from atlantis_netcfg.records.survey.positions import TrackPosition
    from atlantis_netcfg.runs import Store

_PORT_OF_VIANA = (41.6864, -8.8388)
"""Start of an emulated voyage at a site without a geofence: the point in the report."""


class RealClock:
    """The clocks of this computer."""

    @staticmethod
    def now_s() -> float:
        """See `SurveyClock.now_s`."""
        return time.monotonic()

    @staticmethod
    def utc() -> datetime:
        """See `SurveyClock.utc`."""
        return datetime.now(UTC)

    @staticmethod
    def wait(seconds: float) -> None:
        """See `SurveyClock.wait`."""
        time.sleep(seconds)


@dataclass(slots=True)
class TypedPositions:
    """Positions typed by a person; the last one is the current position."""

    name: str = "a person"
    current: TrackPosition | None = None
    _places: dict[str, TrackPosition] = field(default_factory=dict)
    """Positions by place name."""

    def type(self, text: str) -> bool:
        """Set the current position from typed text; empty text repeats it. Returns False if there is no position."""
        if text.strip():
            position = parse_position(text, self._places)
            self.current = position or self.current
            return position is not None
        return self.current is not None

    def position(self) -> TrackPosition | NoPosition:
        """See `PositionSource.position`."""
        return self.current or NoPosition.NOT_TYPED


@dataclass(frozen=True, slots=True)
class SiteSurvey:
    """Scope and settings of a survey."""

    inventory: Inventory
    link: Link
    unit: Host
    request: Request
    store: Store
    plan: measure.SurveyPlan
    radio_only: bool = False
    clicks: bool = False
    gps: str | None = None
    """`gateway`, `here`, or an address; None: the gateway if it has a receiver, otherwise this computer."""
    tune: Callable[[coverage.PlaceTruth], None] | None = None
    """Rehearsal: sets the signals that the emulated unit receives."""

    @property
    def site(self) -> str:
        """The name of the site."""
        return self.unit.site

    @property
    def far_end(self) -> tuple[str, int, bytes]:
        """Address, port and key of the reflector. Raises UsageError if the inventory has none."""
        far = self.inventory.pilot.qualify
        if far is None:
            raise UsageError(
                "the inventory has no far end that could respond to test packets",
                hint="set `qualify:` in group_vars/all/pilot.yml, or use `--radio-only`, which sends nothing",
            )
        address = str(far.address or self.inventory.pilot.vpn.endpoint)
        return address, far.port, key_of(far)

    def build_survey(
        self, stack: ExitStack, samples: Callable[[Sample], None], write: Callable[[SurveyPoint], None]
    ) -> measure.RunningSurvey:
        """Build the survey; resources are closed with the stack. Raises UsageError."""
        if self.tune is not None:
            return self._build_emulation(samples, write)
        tester = None
        if not self.radio_only:
            transport = stack.enter_context(self._transport())
            tester = measure.LinkTester(self.plan, transport, ReflectorPeer(self.far_end[2]), samples)
            self.plan.test_every_s(transport.headers)
        radio = UnitRadio(self.inventory, self.unit, self.request, self.store, self.inventory.router_of(self.site))
        positions = TypedPositions() if self.clicks else stack.enter_context(self._gpsd())
        return measure.RunningSurvey(self.plan, self.link.name, positions, radio, tester, RealClock(), write)

    def _transport(self) -> UdpTransport:
        address, port, _ = self.far_end
        try:
            return UdpTransport((address, port))
        except OSError as error:
            raise UsageError(
                f"this computer has no route to the far end {arg(address)}: {arg(error.strerror)}",
                hint="connect it to the network of the site, or use `--radio-only`, which sends nothing",
            ) from error

    def _build_emulation(
        self, samples: Callable[[Sample], None], write: Callable[[SurveyPoint], None]
    ) -> measure.RunningSurvey:
        assert self.tune is not None  # noqa: S101 - the caller checks it
        fence, rate = self.inventory.sites[self.site].checklist.geofence, self.link.rate
        begin = _PORT_OF_VIANA if fence is None else (fence.latitude, fence.longitude)
        declared_rate = rehearsal.DeclaredRate(rate.rtt_ms / 1000, rate.up_kbps * 1000.0, rate.down_kbps * 1000.0)
        voyage = rehearsal.Voyage(coverage.out_and_back(*begin), coverage.two_masts(*begin), declared_rate, self.tune)
        tester = None
        if not self.radio_only:
            tester = measure.LinkTester(self.plan, voyage.link, ReflectorPeer(rehearsal.KEY), samples)
            self.plan.test_every_s(voyage.link.headers)
        radio = rehearsal.VoyageRadio(voyage, UnitRadio(self.inventory, self.unit, self.request, self.store))
        return measure.RunningSurvey(self.plan, self.link.name, voyage, radio, tester, voyage.clock, write)

    def _gpsd(self) -> GpsdSource:
        gateways = [host for host in self.inventory.site_hosts(self.site) if isinstance(host.device, Gateway)]
        with_receiver = [host for host in gateways if isinstance(host.device, Gateway) and host.device.gps is not None]
        if self.gps == "gateway" or (self.gps is None and with_receiver):
            gateway = next(iter((*with_receiver, *gateways)), None)
            if gateway is None:
                raise UsageError(f"`{arg(self.site)}` has no gateway", hint="use `gps=here`, or the address of a gpsd")
            words = [*ssh_command(computer_access(self.inventory, gateway, self.request))]
            forward = ["-W", f"127.0.0.1:{GPSD_PORT}"]
            return GpsdSource(msg(f"gpsd of {arg(gateway.name)}"), command=[*words[:-1], *forward, words[-1]])
        address = ("127.0.0.1", GPSD_PORT) if self.gps in {None, "here"} else parse_gpsd_address(self.gps or "")
        return GpsdSource(msg(f"gpsd at {arg(address[0])}:{arg(address[1])}"), address)

    def header(self, survey: measure.RunningSurvey, name: str) -> SurveyHeader:
        """Return the header line of the survey file."""
        tester = survey.tester
        far = None
        if tester is not None:
            far = "an emulated reflector" if self.tune is not None else "{}:{}".format(*self.far_end[:2])
        return SurveyHeader(
            id=name,
            tool=__version__,
            site=self.site,
            title=self.inventory.sites[self.site].title,
            link=self.link.name,
            unit=self.unit.name,
            far_end=far,
            positions_by=survey.positions.name,
            emulated=self.tune is not None,
            begun=survey.clock.utc(),
            time_zone=self.inventory.pilot.time_zone,
            step_m=self.plan.step_m,
            step_s=self.plan.step_s,
            max_age_s=MAX_AGE_S,
            max_hdop=MAX_HDOP,
            hourly_bytes=self.plan.hourly_bytes,
            test_every_s=None if tester is None else round(self.plan.test_every_s(tester.transport.headers), 1),
            train_packets=self.plan.train.packets,
            packet_size=self.plan.train.size,
            message_size=self.plan.message.size,
        )
