"""Reading of all links of a site at once: devices, queries, and the result."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from atlantis_netcfg import runs
from atlantis_netcfg.core import errors, events
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.links import LinkFinding, policy
from atlantis_netcfg.links.cost import Bill, bill
from atlantis_netcfg.links.satellite import judge_names
from atlantis_netcfg.operations.allow_list_test.plan import named_targets, resolve
from atlantis_netcfg.operations.common import session_link
from atlantis_netcfg.operations.common.costs import ways_of
from atlantis_netcfg.operations.common.jobs import endpoint_of
from atlantis_netcfg.operations.common.kinds import get_managed_device, is_supported
from atlantis_netcfg.operations.common.site_links import links_of
from atlantis_netcfg.operations.common.traffic_budget import over_budget, standing_traffic
from atlantis_netcfg.operations.links.session import PINGS, ReadOnlySession, RouterReading, read_router
from atlantis_netcfg.operations.links.status import (
    IN_USE,
    BoxesStatus,
    SeenLinks,
    Silent,
    UnitLook,
    kept_off,
    link_status,
    of_bridge,
    of_terminal,
    of_unit,
    rank,
    read_by_driver,
    read_radio,
    read_routeros,
    twice,
)
from atlantis_netcfg.operations.lte.units import LteUnit
from atlantis_netcfg.routeros.estimate import LinkMetrics as Carrier
from atlantis_netcfg.routeros.estimate import on_the_wire
from atlantis_netcfg.runs.report.links import LinksReport

if TYPE_CHECKING:
    from collections.abc import Awaitable, Iterator, Mapping, Sequence

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.links import LinkStatus
    from atlantis_netcfg.links.standing_traffic import StandingTraffic
    from atlantis_netcfg.operations.common.request import Request
    from atlantis_netcfg.routeros.link_use import LinkUse


@dataclass(slots=True)
class LinkQueries:
    """All queries of one reading; `ask` sends them to all devices at once."""

    inventory: Inventory
    router: Host
    """Router of the site that is read."""
    request: Request
    notify: events.Subscriber
    patience_s: float = session_link.PATIENCE_S
    answers: dict[str, Any] = field(default_factory=dict)
    """By host name: its reading, or Silent."""
    not_asked: dict[str, str] = field(default_factory=dict)
    """Reason why a host was not queried, by host name."""
    doors: dict[str, ReadOnlySession] = field(default_factory=dict)
    """Session with its traffic, by host name; RouterOS devices only."""

    async def ask(
        self, hosts: Sequence[Host], selected_hosts: Sequence[Host], routes: Sequence[policy.LinkRoute]
    ) -> None:
        """Query the `selected_hosts` that can be queried, all at the same time."""
        names = {host.name for host in selected_hosts}
        work = []
        for host in hosts:
            reason = self._why_not(host) if host.name in names else "excluded by `device=`"
            if reason is None:
                work.append(self._read_host(host, routes))
            else:
                self.not_asked[host.name] = reason
        await asyncio.gather(*work)

    @property
    def silent(self) -> tuple[Silent, ...]:
        """Devices that were queried and did not respond."""
        return tuple(answer for answer in self.answers.values() if isinstance(answer, Silent))

    def _why_not(self, host: Host) -> str | None:
        """Return why a host is not queried; None if it is."""
        device = host.device
        if isinstance(device, model.SatelliteTerminal):
            return "no documented interface for programs: check its web pages by hand"
        if isinstance(device, model.LteRouter) and device.driver is model.LteDriver.MANUAL:
            return "`driver: manual`: check its own web page"
        if not is_supported(host) and not isinstance(device, model.LteRouter):
            return msg(f"reading a {arg(device.kind.replace('_', ' '))} is not supported yet")
        missing = self.request.rehearsed and host.name not in self.request.targets
        return "not emulated in this rehearsal" if missing else None

    async def _read_host(self, host: Host, routes: Sequence[policy.LinkRoute]) -> None:
        self.notify(events.Event(host.name, events.Stage.CONNECTING, "read-only"))
        try:
            self.answers[host.name] = await self._reading(host, routes)
        except errors.NetcfgError as error:
            self.answers[host.name] = Silent(
                host.name, str(error), error.hint and errors.fill_hint(error.hint, site=host.site, device=host.name)
            )
            self.notify(events.Event(host.name, events.Stage.FAILED, str(error)))
        else:
            self.notify(events.Event(host.name, events.Stage.DONE, self._usage_text(host.name)))

    def _reading(self, host: Host, routes: Sequence[policy.LinkRoute]) -> Awaitable[Any]:
        if isinstance(host.device, model.Router):
            return read_router(self._door(host), routes)
        if isinstance(host.device, model.Cpe):
            return read_radio(self._door(host))
        assert isinstance(host.device, model.LteRouter)  # noqa: S101 - `boxes` yields no other kind that can be asked
        unit = self.unit(host, host.device)
        if host.device.driver is model.LteDriver.ROUTEROS:
            return read_routeros(self._door(host), unit)
        return read_by_driver(unit)

    def carrier(self, host: Host) -> Carrier:
        """Return the link that a session to a host uses; for a bridge's far end, the link to this site.

        Raises UsageError for a link that its site does not have.
        """
        return _carrier(self.inventory, self.router, host, self.request)

    def unit(self, host: Host, device: model.LteRouter) -> LteUnit:
        """Return a 4G unit in the form that its driver needs."""
        store = runs.Store(self.request.state, is_rehearsal=self.request.rehearsed)
        target = self.request.targets.get(host.name)
        return LteUnit(host, device, store, self.notify, self.request.rehearsed, target)

    def _door(self, host: Host) -> ReadOnlySession:
        """Return a read-only session; raise UsageError for a link that its site does not have."""
        session = session_to(self.inventory, self.router.site, host, self.request, self.patience_s)
        self.doors[host.name] = session
        return session

    def _usage_text(self, name: str) -> str:
        answer = self.answers[name]
        if name in self.doors:
            session = self.doors[name]
            return msg(f"read in {arg(session.round_trips)} round trips, {arg(session.bytes / 1000):.1f} kB")
        return msg(f"read in {arg(answer.requests)} requests" if isinstance(answer, UnitLook) else "read")


def session_to(
    inventory: Inventory, site: str, host: Host, request: Request, patience_s: float = session_link.PATIENCE_S
) -> ReadOnlySession:
    """Return a session, not yet opened, to a RouterOS device from a site or from outside.

    `patience_s`: for a connection over a fast link. Raises NoMatchError for a device of another kind, UsageError for a
    link that its site does not have, and for a device that the rehearsal does not emulate.
    """
    endpoint = endpoint_of(host, get_managed_device(inventory, host).access, request)
    router = next(
        (site_host for site_host in inventory.site_hosts(site) if isinstance(site_host.device, model.Router)), host
    )
    if _carrier(inventory, router, host, request).rtt_s < session_link.FAST_S:
        endpoint = replace(endpoint, connect_timeout_s=patience_s)
    return ReadOnlySession(host.name, endpoint)


def _carrier(inventory: Inventory, router: Host, host: Host, request: Request) -> Carrier:
    here = host if host.site == router.site else router
    return session_link.site_link_of(inventory, here, request.via.get(here.name))


def boxes(inventory: Inventory, router: Host) -> Iterator[Host]:
    """Yield the router and the devices of its site's links, each once, including both ends of a bridge."""
    yield router
    seen_names = {router.name}
    for link in inventory.sites[router.site].bearers:
        box = inventory.hosts.get(link.device or "")
        far = inventory.hosts.get(box.device.ptp.peer) if box and isinstance(box.device, model.Cpe) else None
        for host in (box, far):
            if host is not None and host.name not in seen_names:
                seen_names.add(host.name)
                yield host


def ping_bytes(routes: Sequence[policy.LinkRoute]) -> Mapping[str, int]:
    """Return the bytes of each link's pings on the wire, if all are answered."""
    costs: dict[str, int] = {}
    for probe in policy.probe_commands(routes, count=PINGS):
        costs[probe.link] = costs.get(probe.link, 0) + probe.wire_bytes
    return costs


def months(
    usage: runs.Usage, device: str, reading: RouterReading | None, routes: Sequence[policy.LinkRoute], now: datetime
) -> dict[str, runs.MonthBytes]:
    """Save this reading's counters; return each link's monthly usage. Raise JournalError or DamagedStateError."""
    for name, counters in _counters(device, reading, routes, now):
        usage.record(name, counters)
    return {route.name: usage.month(route.name, now) for route in routes}


def _counters(
    device: str, reading: RouterReading | None, routes: Sequence[policy.LinkRoute], now: datetime
) -> Iterator[tuple[str, runs.Counters]]:
    if reading is None or reading.ports is None:
        return
    for route in routes:
        port = reading.ports.get(route.port or "")
        if port is None or route.port is None or port.rx_bytes is None or port.tx_bytes is None:
            continue
        yield (
            route.name,
            runs.Counters(
                device=device,
                interface=route.port,
                rx_bytes=port.rx_bytes,
                tx_bytes=port.tx_bytes,
                at=reading.at or now,
                uptime_s=reading.uptime_s,
            ),
        )


def bills(queries: LinkQueries, active: tuple[str, ...] | None, seconds: float) -> dict[str, Bill]:
    """Return the cost of sessions with RouterOS devices over metered links, by link.

    A session over a link of the site really uses its default route; an emulated device is behind the link of the
    inventory, whatever its routes are.
    """
    links = links_of(queries.inventory, queries.router.site)
    bytes_by_link: dict[str, int] = {}
    for name, session in queries.doors.items():
        link = queries.carrier(queries.inventory.hosts[name]).name
        if link != session_link.LAN.name and active is not None and len(active) == 1 and not queries.request.rehearsed:
            link = active[0]
        if links[link].is_metered and session.traffic:
            bytes_by_link[link] = bytes_by_link.get(link, 0) + on_the_wire(session.bytes, session.connections)
    return {name: bill(nbytes, seconds, links[name].tariff) for name, nbytes in bytes_by_link.items()}


@dataclass(frozen=True, slots=True)
class LinksStatus:
    """The state of a site's links from one reading, in the order of preference."""

    links: tuple[LinkStatus, ...]
    boxes: Mapping[str, str]
    """Device or devices of each link, by link."""
    months: Mapping[str, runs.MonthBytes]
    probe_bytes: Mapping[str, int]
    """Bytes that the pings of each link may have used on the wire, by link."""
    unreachable: tuple[Silent, ...]
    not_asked: Mapping[str, str]
    """Reason why a device was not queried, by device."""
    round_trips: Mapping[str, int]
    """Round trips of each queried RouterOS device, including its login."""
    queried_devices: tuple[str, ...]
    """Queried devices, with or without a response."""
    bills: Mapping[str, Bill]
    """Cost of this reading by metered link, as far as sessions with RouterOS devices used the link."""
    standing: Mapping[str, StandingTraffic]
    """Standing traffic by link, computed from the inventory."""
    uptime_s: float | None = None
    """Uptime of the router; None: not read."""
    use: LinkUse | None = None
    """Link that is used for a limited time instead of the order in the inventory."""
    notes: tuple[str, ...] = ()
    """Problems that do not concern the links."""

    def report(
        self, site: str, title: str, *, is_rehearsal: bool, not_rehearsed: tuple[str, ...] = (), time_zone: str = ""
    ) -> LinksReport:
        """Return the report for people and programs."""
        return LinksReport(
            site=site,
            title=title,
            is_rehearsal=is_rehearsal,
            bearers=self.as_dict(),
            queried_devices=self.queried_devices,
            unreachable=[
                {"device": item.device, "message": item.message, "hint": item.hint} for item in self.unreachable
            ],
            not_asked=self.not_asked,
            round_trips=self.round_trips,
            costs={name: {**bill.as_dict(), "words": bill.words} for name, bill in self.bills.items()},
            notes=self.notes,
            not_rehearsed=not_rehearsed,
            time_zone=time_zone,
        )

    def as_dict(self) -> dict[str, dict[str, Any]]:
        """Return each link as JSON-able data: the fields of `LinkStatus` and additional results."""
        return {
            link.name: {
                **link.as_dict(),
                "verdict": link.verdict.value,
                "box": self.boxes[link.name],
                "probe_bytes": self.probe_bytes.get(link.name, 0),
                "month_since": _stamp(self.months[link.name].since),
                "month_gaps": list(self.months[link.name].gaps),
                "standing": self.standing[link.name].as_dict(),
            }
            for link in self.links
        }


def _stamp(moment: datetime | None) -> str | None:
    return None if moment is None else f"{moment.astimezone(UTC):%Y-%m-%d %H:%M} UTC"


async def collect_links(  # noqa: PLR0913, PLR0917 - all that a command line says
    inventory: Inventory,
    site: str,
    selected_hosts: Sequence[Host],
    request: Request,
    notify: events.Subscriber,
    patience_s: float = session_link.PATIENCE_S,
) -> LinksStatus:
    """Read the links of a site; only `selected_hosts` are queried, with both ends of a bridge.

    A device that does not respond is a finding and no error; `patience_s`: for a connection over a fast link. Raises
    NoMatchError for a site without a router.
    """
    router = next(
        (site_host for site_host in inventory.site_hosts(site) if isinstance(site_host.device, model.Router)), None
    )
    if router is None:
        raise errors.NoMatchError(f"site `{arg(site)}` has no router, and only a router reports its links")
    routes = ways_of(inventory, router)
    began = datetime.now(UTC)
    queries = LinkQueries(inventory, router, request, notify, patience_s)
    await queries.ask(tuple(boxes(inventory, router)), _with_far_ends(inventory, selected_hosts), routes)
    name_findings = {} if request.rehearsed else await _names(inventory, site)
    return _LinkSite(
        inventory, router, routes, queries, request, began, datetime.now(UTC), name_findings
    ).put_together()


async def _names(inventory: Inventory, site: str) -> dict[str, tuple[LinkFinding, ...]]:
    """Check on this computer whether the names of each satellite's allow-list still have its addresses."""
    result = {}
    for link in inventory.sites[site].bearers:
        targets = named_targets(inventory, site, link)
        addresses = await resolve(target.dns_name for target in targets)
        result[link.name] = judge_names(targets, addresses, "this computer")
    return result


def _with_far_ends(inventory: Inventory, selected_hosts: Sequence[Host]) -> list[Host]:
    peers = [inventory.hosts.get(item.device.ptp.peer) for item in selected_hosts if isinstance(item.device, model.Cpe)]
    return [*selected_hosts, *(peer for peer in peers if peer is not None)]


def _statuses(observations: Sequence[SeenLinks], over: Sequence[LinkFinding | None]) -> list[LinkStatus]:
    """Combine observations and findings into statuses; `over` holds each link's budget finding."""
    findings = [
        *twice(observations),
        *((item.route.name, excess) for item, excess in zip(observations, over, strict=True) if excess),
    ]
    return [
        _add_findings(link_status(item), [finding for name, finding in findings if name == item.route.name])
        for item in observations
    ]


def _add_findings(status: LinkStatus, more: list[LinkFinding]) -> LinkStatus:
    return replace(status, findings=(*status.findings, *more))


@dataclass(slots=True)
class _LinkSite:
    inventory: Inventory
    router: Host
    ways: tuple[policy.LinkRoute, ...]
    turn: LinkQueries
    request: Request
    began: datetime
    now: datetime
    name_findings: Mapping[str, tuple[LinkFinding, ...]]
    """Findings about the DNS names in the allow-list, by link."""
    notes: list[str] = field(default_factory=list)

    def put_together(self) -> LinksStatus:
        """Judge the responses and save the counters."""
        site = self.inventory.sites[self.router.site]
        month = self._month_usage()
        active, reading = self._active_links(), self._reading
        standing = standing_traffic(self.inventory, self.router.site)
        over = [over_budget(link, traffic) for link, traffic in zip(site.bearers, standing, strict=True)]
        observations = [
            SeenLinks(
                route=route,
                router=self._answer(self.router),
                boxes_status=self._boxes_status(route, link),
                active=None if active is None else route.name in active,
                month_bytes=month[route.name].bytes,
                box=link.device,
                next_hop=str(link.gateway),
                network=link.network,
                power_port=self._power_port(link),
            )
            for route, link in zip(self.ways, site.bearers, strict=True)
        ]
        return LinksStatus(
            links=rank(_statuses(observations, over), site.failover.fail_back_s, self._temporary_use(reading)),
            boxes={link.name: self._link_device_text(link) for link in site.bearers},
            months=month,
            probe_bytes={
                item.route.name: ping_bytes(self.ways)[item.route.name] for item in observations if item.echoes
            },
            unreachable=self.turn.silent,
            not_asked=dict(self.turn.not_asked),
            round_trips={name: session.round_trips for name, session in self.turn.doors.items()},
            queried_devices=tuple(self.turn.answers),
            bills=bills(self.turn, active, (self.now - self.began).total_seconds()),
            standing={item.link.name: item for item in standing},
            uptime_s=None if reading is None else reading.uptime_s,
            use=None if reading is None else reading.use,
            notes=tuple(self.notes),
        )

    @property
    def _reading(self) -> RouterReading | None:
        answer = self._answer(self.router)
        return answer if isinstance(answer, RouterReading) else None

    def _temporary_use(self, reading: RouterReading | None) -> tuple[str, LinkFinding] | None:
        if reading is None or reading.use is None:
            return None
        hint = msg(f"`provision links use site={arg(self.router.site)} end` ends it now")
        return reading.use.link, LinkFinding(events.Verdict.WARN, IN_USE, reading.use.words(reading.uptime_s), hint)

    def _answer(self, host: Host | None) -> Any:  # noqa: ANN401 - a reading of the host's kind, Silent or None
        return None if host is None else self.turn.answers.get(host.name)

    def _active_links(self) -> tuple[str, ...] | None:
        reading = self._reading
        return None if reading is None or reading.routes is None else policy.active_links(reading.routes, self.ways)

    def _boxes_status(self, route: policy.LinkRoute, link: model.Link) -> BoxesStatus:
        box = self.inventory.hosts.get(link.device or "")
        if link.kind.traits.box == "satellite_terminal":
            status = self._terminal(box)
            findings = (*status.findings, *self.name_findings.get(link.name, ()))
            return replace(
                status, quality=kept_off(link, route.port, self._reading) | status.quality, findings=findings
            )
        if box is not None and isinstance(box.device, model.Cpe):
            far = self.inventory.hosts.get(box.device.ptp.peer)
            return of_bridge((box, self._answer(box)), None if far is None else (far, self._answer(far)))
        if box is not None and isinstance(box.device, model.LteRouter):
            return self._unit(box, box.device)
        return BoxesStatus()

    def _unit(self, box: Host, device: model.LteRouter) -> BoxesStatus:
        """Return a 4G unit's status; for a manual unit its driver gives one without a query."""
        answer = self._answer(box)
        if isinstance(answer, Silent):
            return BoxesStatus(silent=(answer,))
        if device.driver is model.LteDriver.MANUAL:
            look_result = self.turn.unit(box, device).look()
            answer = UnitLook(look_result.reading, look_result.findings)
        return BoxesStatus() if answer is None else of_unit(box.name, answer, device.driver, forwards=self._forwards)

    @property
    def _forwards(self) -> bool:
        return isinstance(self.router.device, model.Router) and bool(self.router.device.forwards)

    def _terminal(self, box: Host | None) -> BoxesStatus:
        store = runs.Store(self.request.state, is_rehearsal=self.request.rehearsed)
        try:
            return of_terminal(self.inventory, box, store, self.now.astimezone().date())
        except errors.NetcfgError as error:
            self.notes.append(str(error))
            return BoxesStatus()

    def _link_device_text(self, link: model.Link) -> str:
        box = self.inventory.hosts.get(link.device or "")
        if box is not None and isinstance(box.device, model.Cpe):
            return msg(f"{arg(box.name)} to {arg(box.device.ptp.peer)}")
        if box is not None and isinstance(box.device, model.LteRouter):
            return msg(f"{arg(box.name)} ({arg(box.device.driver.value)})")
        return link.device or ""

    def _power_port(self, link: model.Link) -> str | None:
        box = self.inventory.hosts.get(link.device or "")
        source = getattr(box.device, "powered_by", None) if box is not None else None
        return source.port if source is not None and source.device == self.router.name else None

    def _month_usage(self) -> dict[str, runs.MonthBytes]:
        usage = runs.Store(self.request.state, is_rehearsal=self.request.rehearsed).usage(self.router.site)
        try:
            return months(usage, self.router.name, self._reading, self.ways, self.now)
        except errors.NetcfgError as error:
            self.notes.append(msg(f"the bytes of this month are unknown: {arg(error)}"))
            return dict.fromkeys((route.name for route in self.ways), runs.MonthBytes())
