"""Measurement of one link of a site: this computer sends, the router routes and counts, a folder keeps the data."""

from __future__ import annotations

import asyncio
import signal
import threading
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final

from atlantis_netcfg import __version__
from atlantis_netcfg.core import events
from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.links.qualify import budget, measured_run
from atlantis_netcfg.links.qualify.reflector.clock import ClockState, kernel_clock
from atlantis_netcfg.links.qualify.samples import SampleWriter
from atlantis_netcfg.links.qualify.session import ReflectorPeer
from atlantis_netcfg.links.qualify.transport import UdpTransport
from atlantis_netcfg.operations.allow_list_test.prove import temporary_rows
from atlantis_netcfg.operations.common.costs import ports_of
from atlantis_netcfg.operations.common.jobs import device_job
from atlantis_netcfg.operations.common.site_links import link_of
from atlantis_netcfg.operations.qualify import far_end, routing
from atlantis_netcfg.operations.qualify.measure import CUT_OFF, CountedTransport, Measurement
from atlantis_netcfg.operations.qualify.plan import build_plan, thresholds_of
from atlantis_netcfg.routeros.api import Command, Session
from atlantis_netcfg.runs import NoJournal

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from contextlib import AbstractContextManager
    from pathlib import Path

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.inventory.model import Link
    from atlantis_netcfg.links.qualify.transport import DatagramTransport
    from atlantis_netcfg.operations.common.request import Request
    from atlantis_netcfg.operations.qualify.emulation import EmulatedLink
    from atlantis_netcfg.operations.qualify.plan import QualifyPlan

_ALIVE_S: Final = 10.0
"""Interval in seconds of checks of the router session: if it is lost, the rows go and packets take other links."""
_STOPS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
TUNNEL_MTU: Final = (
    "the path MTU is the tunnel's: longer packets are fragmented, and so are shorter ones on a link with a smaller MTU"
)
NOT_OURS: Final = "the far end is not ours: it has no key and confirms no messages, so no maximum rate was measured"


def links_of_site(inventory: Inventory, site: str, name: str | None) -> tuple[Link, ...]:
    """Return the requested links: one, `all`, or the only one; raise NothingToQualify."""
    if site not in inventory.sites:
        raise far_end.NothingToQualify("measure one site at a time", hint=f"sites: {arg(join(', ', inventory.sites))}")
    links = inventory.sites[site].bearers
    result = tuple(link for link in links if name in {link.name, "all"}) if name is not None else links
    if not result or (name is None and len(result) > 1):
        why = msg(f"`{arg(site)}` has several links" if name is None else f"`{arg(site)}` has no link `{arg(name)}`")
        raise far_end.NothingToQualify(
            why, hint=f"type one of: {arg(join(', ', (f'link={each.name}' for each in links)))}, link=all"
        )
    return result


def router_of(inventory: Inventory, site: str) -> Host:
    """Return the router that routes the packets; raise NothingToQualify."""
    result = inventory.router_of(site)
    if result is None:
        raise far_end.NothingToQualify(f"`{arg(site)}` has no router that can route test packets over one link")
    return result


@dataclass(slots=True)
class LinkRun:
    """The measurement of one link within a person's limits."""

    inventory: Inventory
    site: str
    link: Link
    selection: measured_run.Selection
    limits: measured_run.BudgetLimits
    folder: Path
    """Folder of this run, new and empty."""
    far: far_end.MeasuredFarEnd
    over_vpn: bool = False
    emulated_link: EmulatedLink | None = None
    notify: events.Subscriber = lambda _event: None
    facts: Mapping[str, str] = field(default_factory=dict)
    """Facts about the link that its devices reported before the run."""
    clock: ClockState = field(default_factory=kernel_clock)
    """State of this computer's clock at the beginning."""
    stop: threading.Event = field(default_factory=threading.Event)
    _router: str | None = None
    _before: routing.FlowCounts | None = None
    _after: routing.FlowCounts | None = None
    _remarks: list[str] = field(default_factory=list)

    @property
    def plan(self) -> QualifyPlan:
        """The plan of the measurement."""
        return build_plan(
            self.link,
            self.selection,
            is_rehearsal=self.emulated_link is not None,
            over_vpn=self.over_vpn,
            confirms=self.far.is_ours,
        )

    def measure(self, request: Request) -> tuple[measured_run.MeasuredRun, Measurement]:
        """Send, count and save; both files of the folder are written in any case. Raise NetcfgError."""
        router = router_of(self.inventory, self.site)
        with self._transport() as (transport, source, flow):
            counted_transport = CountedTransport(
                transport, self.stop, tunnel_headers=budget.VPN_HEADERS if self.over_vpn else 0
            )
            guard = budget.BudgetGuard(
                self._budget(), lambda: counted_transport.now_ns() / 1e9, counted_transport.headers
            )
            with (self.folder / measured_run.SAMPLES_FILE).open("x", encoding="utf-8") as file:
                peer = ReflectorPeer(
                    self.far.key, self.clock.is_synchronised, self.clock.error_s, counts=self.far.is_ours
                )
                measurement = Measurement(
                    self.plan, peer, counted_transport, guard, SampleWriter(file), self._progress(router.name)
                )
                initial_run = self._build_initial_run(source)
                measured_run.write_run(self.folder, initial_run)
                try:
                    asyncio.run(self._run_measurement(router, request, measurement, flow))
                except NetcfgError as failure:
                    self._remarks.append(str(failure))
                    measured_run.write_run(self.folder, self._finish_run(initial_run, measurement, router))
                    raise
            run = self._finish_run(initial_run, measurement, router)
            measured_run.write_run(self.folder, run)
        return run, measurement

    @contextmanager
    def _transport(self) -> Iterator[tuple[DatagramTransport, str, routing.MeasuredFlow]]:
        """Open the transport; yield it with its source address and the flow that the router sees."""
        vpn, far, port = self.inventory.pilot.vpn, self.far.address, self.far.port
        endpoint = str(vpn.endpoint)
        connection: AbstractContextManager[UdpTransport]
        if self.emulated_link is not None:
            near = source = str(self.inventory.sites[self.site].management.technician)
            connection = self.emulated_link.transport()
        elif self.over_vpn:
            near = far_end.source_of(self.inventory, self.site, endpoint, vpn.port)
            source = far_end.source_in_vpn(self.inventory, far, port)
            connection = UdpTransport((far, port), source=source)
        else:
            near = source = far_end.source_of(self.inventory, self.site, far, port)
            connection = UdpTransport((far, port), source=source)
        with connection as transport:
            tunnel = routing.MeasuredFlow(near, None, endpoint, vpn.port)
            yield (
                transport,
                source,
                tunnel if self.over_vpn else routing.MeasuredFlow(near, transport.source[1], far, port),
            )

    def _budget(self) -> budget.Budget:
        limits, tariff = self.limits, link_of(self.inventory, self.site, self.link.name).tariff
        return budget.Budget(
            limits.max_bytes, limits.max_seconds, limits.max_price, tariff, closing_s=self.plan.times.timeout_s
        )

    async def _run_measurement(
        self, router: Host, request: Request, measurement: Measurement, flow: routing.MeasuredFlow
    ) -> None:
        """Keep the rows on the router while everything is sent, and read its counts before their removal."""
        job = device_job(self.inventory, router, request, NoJournal(), self.notify)
        async with await Session.open(job.endpoint) as session:
            self._before = await routing.counters(session)
            self._router = await routing.router_words(session)
            ports = [port for port, link in ports_of(router).items() if link in self._links(router).values()]
            counter_rows = routing.rows(flow, self.link.name, ports, *await routing.first_rows(session))
            async with temporary_rows(session, counter_rows):
                await self._send(session, measurement)
                if self.emulated_link is not None:
                    self._remarks += self.emulated_link.tell(router.name, flow)
                self._after = await routing.counters(session)

    async def _send(self, session: Session, measurement: Measurement) -> None:
        """Send in a thread; if the router's session, and so the rows, are lost, stop sending."""
        work = asyncio.ensure_future(asyncio.to_thread(measurement.measure))
        with _stopped_by_signals(self.stop):
            try:
                while not (await asyncio.wait([work], timeout=_ALIVE_S))[0]:
                    (await session.command(Command("/system/identity/print"))).check()
            finally:
                if not work.done():
                    self.stop.set()
                await work

    def _links(self, router: Host) -> Mapping[str, str]:
        """Return the link of each port, for the site's own links."""
        links = {site_link.name for site_link in self.inventory.sites[self.site].bearers}
        return {port: link for port, link in ports_of(router).items() if link in links}

    def _progress(self, router: str) -> Callable[[str, int, int], None]:
        return lambda message, step, total: self.notify(
            events.Event(router, events.Stage.VERIFYING, message, step, total)
        )

    def _build_initial_run(self, source: str) -> measured_run.MeasuredRun:
        name, thresholds = thresholds_of(self.link, is_rehearsal=self.emulated_link is not None)
        billing = self.link.billing if self.link.metered else None
        return measured_run.MeasuredRun(
            id=self.folder.name,
            tool=__version__,
            site=self.site,
            link=self.link.name,
            kind=self.link.kind.value,
            emulated=self.emulated_link is not None,
            selection=self.selection,
            far_end=measured_run.FarEnd(
                name=self.far.name,
                address=self.far.address,
                port=self.far.port,
                over_vpn=self.over_vpn,
                authenticated=self.far.is_ours,
                source=source,
            ),
            begun=datetime.now(UTC),
            ended=None,
            reason=CUT_OFF,
            clock_synchronised=self.clock.is_synchronised,
            facts=dict(self.facts),
            budget=self.limits,
            currency=None if billing is None else billing.currency,
            tariff=link_of(self.inventory, self.site, self.link.name).tariff,
            thresholds_name=name,
            thresholds=thresholds,
            time_zone=self.inventory.pilot.time_zone,
        )

    def _finish_run(
        self, initial_run: measured_run.MeasuredRun, measurement: Measurement, router: Host
    ) -> measured_run.MeasuredRun:
        transport, mtu = measurement.transport, measurement.mtu
        counts = () if self._before is None else routing.link_counts(self._links(router), self._before, self._after)
        way, why = self._judge(counts, measurement)
        charge = measurement.guard.current_bill()
        return initial_run.model_copy(
            update={
                "ended": datetime.now(UTC),
                "reason": str(measurement.reason),
                "sent_bytes": transport.sent_bytes,
                "received_bytes": transport.received_bytes,
                "charged_bytes": measurement.guard.charged_bytes,
                "price": charge.price if initial_run.currency is not None else None,
                "counts": counts,
                "facts": {**initial_run.facts, **({} if self._router is None else {"router": self._router})},
                "way": way,
                "way_reason": why,
                "path_mtu_up": mtu.up,
                "path_mtu_both": mtu.both,
                "path_mtu_reason": mtu.why,
                "remarks": (*self._remarks, *self._notes()),
            }
        )

    def _judge(
        self, counts: tuple[measured_run.LinkCount, ...], measurement: Measurement
    ) -> tuple[events.Verdict, str]:
        transport = measurement.transport
        if self.over_vpn:
            up = routing.TunnelTraffic(transport.sent_packets, transport.sent_bytes)
            return routing.judge_tunnel(
                self.link.name,
                counts,
                up,
                routing.TunnelTraffic(transport.received_packets, transport.received_bytes),
            )
        return routing.judge_way(
            self.link.name, counts, transport.sent_packets, transport.received_packets, measurement.max_lost
        )

    def _notes(self) -> Iterator[str]:
        if number := self.plan.left_out:
            yield msg(
                f"{arg(number)} sizes and rates were skipped: the link's rate in the inventory does not support them"
            )
        if self.over_vpn:
            yield TUNNEL_MTU
        if not self.far.is_ours:
            yield NOT_OURS


@contextmanager
def _stopped_by_signals(stop: threading.Event) -> Iterator[None]:
    """End the measurement properly on Ctrl-C and similar signals: samples are kept, rows removed."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in _STOPS}
    for number in _STOPS:
        signal.signal(number, lambda _number, _frame: stop.set())
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
