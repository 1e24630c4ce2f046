"""Judgement of a link, from the devices at its ends and the router."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field, replace
from ipaddress import IPv4Address, IPv4Network
from typing import TYPE_CHECKING

from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, conjunction, join, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.links import LinkFinding, LinkState, LinkStatus, Quality, wifi
from atlantis_netcfg.links import wifi as radios
from atlantis_netcfg.links.lte import LteReading, Registration, judge, routeros
from atlantis_netcfg.links.satellite import judge_carrier_nat, judge_factory_address
from atlantis_netcfg.operations.common.terminals import is_terminal, judge_terminal
from atlantis_netcfg.operations.links.session import Echo, ReadOnlySession, RouterReading, SessionPort, command, rows
from atlantis_netcfg.routeros import api

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from datetime import date

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.links.policy import LinkRoute
    from atlantis_netcfg.operations.lte.units import LteUnit
    from atlantis_netcfg.routeros._types import Row
    from atlantis_netcfg.runs import Store


IN_USE = "in-use-for-a-time"
"""Finding code of a link that is used instead of the order in the inventory."""
_MENUS = {family: f"/interface/{family}/print" for family in wifi.Family}
_RADIO = "name,default-name,mac-address,disabled"


@dataclass(frozen=True, slots=True)
class RadioLook:
    """A CPE's report about its radio."""

    reading: wifi.WifiReading | None
    """None: the menus of the device show no radio."""
    mac: str | None = None
    """MAC address of the device's own radio, upper case."""


async def read_radio(device: ReadOnlySession) -> RadioLook:
    """Read in one session of three round trips: login, radio menus, radio state. Raise DeviceError."""
    async with device.open_session() as session:
        replies = await session.flight([api.Command(path, ((".proplist", _RADIO),)) for path in _MENUS.values()])
        radio_match = _radio([(family, rows(reply)) for family, reply in zip(_MENUS, replies, strict=True)])
        if radio_match is None:
            return RadioLook(None)
        family, row = radio_match
        table, monitor = await session.flight([command(query) for query in wifi.queries(family, row["name"])])
    monitor_rows = rows(monitor)
    reading = wifi.read(family, rows(table), monitor_rows[0] if monitor_rows else None, row["name"])
    return RadioLook(reading, (row.get("mac-address") or "").upper() or None)


def _radio(tables: list[tuple[wifi.Family, tuple[Row, ...] | None]]) -> tuple[wifi.Family, Row] | None:
    """Return the board's first radio; virtual ones have no `default-name` and come after it."""
    radios = [(family, row) for family, menu in tables for row in menu or () if "name" in row]
    return next((radio for radio in radios if "default-name" in radio[1]), radios[0] if radios else None)


def expected_of(end: Host, other: Host, other_mac: str | None) -> wifi.WifiSettings:
    """Return the settings of one end from the inventory."""
    assert isinstance(end.device, model.Cpe)  # noqa: S101 - the ends of a bridge are CPEs
    ptp = end.device.ptp
    return wifi.WifiSettings(
        peer=other.name,
        peer_macs=frozenset({other_mac} if other_mac else ()),
        access_point=ptp.mode is model.PtpMode.ACCESS_POINT,
        ssid=ptp.ssid,
        protocol=ptp.protocol.value,
        frequency_mhz=ptp.frequency_mhz,
        width_mhz=ptp.width_mhz,
        weakest_dbm=ptp.signal.weakest_dbm,
        strongest_dbm=ptp.signal.strongest_dbm,
    )


@dataclass(frozen=True, slots=True)
class Silent:
    """A device that did not respond to a query, or not as one of its kind does."""

    device: str
    message: str
    hint: str | None = None


@dataclass(frozen=True, slots=True)
class BoxesStatus:
    """The report of a link's devices."""

    state: LinkState | None = None
    """None: the devices do not report it, or the link has no such device."""
    quality: Quality = field(default_factory=dict)
    findings: tuple[LinkFinding, ...] = ()
    silent: tuple[Silent, ...] = ()


def of_bridge(
    near: tuple[Host, RadioLook | Silent | None], far: tuple[Host, RadioLook | Silent | None] | None
) -> BoxesStatus:
    """Judge both ends; the readings are the near end's, plus the far end's signal.

    An end is a reading, a silence, or None if it was not to be queried; `far` is None if the inventory has no far end.
    """
    ends = [end for end in (near, far) if end is not None]
    macs = {host.name: answer.mac for host, answer in ends if isinstance(answer, RadioLook)}
    boxes = BoxesStatus(silent=tuple(answer for _, answer in ends if isinstance(answer, Silent)))
    for host, answer in ends:
        if isinstance(answer, RadioLook):
            end_status = _end_status(host, answer, [other for other, _ in ends if other is not host], macs)
            boxes = _merge(boxes, end_status if host is near[0] else _far(end_status))
    return _excuse_far_end(boxes, far[1]) if far is not None and isinstance(far[1], Silent) else boxes


def _excuse_far_end(boxes: BoxesStatus, far: Silent) -> BoxesStatus:
    """Downgrade a silent far end to inconclusive while the bridge is down, when silence is expected."""
    if boxes.state in {None, LinkState.UP, LinkState.UNKNOWN} or far not in boxes.silent:
        return boxes
    message = msg(f"cannot read {arg(far.device)}, as expected while the bridge is down: {arg(far.message)}")
    hint = "repair the bridge first; if it still does not respond, check its power"
    finding = LinkFinding(Verdict.INCONCLUSIVE, "far-end-unreachable", message, hint)
    rest = tuple(item for item in boxes.silent if item is not far)
    return replace(boxes, findings=(*boxes.findings, finding), silent=rest)


def _end_status(host: Host, look: RadioLook, others: list[Host], macs: dict[str, str | None]) -> BoxesStatus:
    if look.reading is None:
        message = msg(f"{arg(host.name)}: no radio in its menus")
        hint = "RouterOS 7.13 and later need the package `wireless` or `wifi-qcom` for it: see docs/wifi.md"
        return BoxesStatus(LinkState.DOWN, {}, (LinkFinding(Verdict.FAIL, "no-radio", message, hint),))
    if not others:
        return BoxesStatus(radios.link_state(look.reading), radios.quality(look.reading))
    expected_link = expected_of(host, others[0], macs.get(others[0].name))
    findings = (_prefix_host(host, finding) for finding in radios.judge(look.reading, expected_link))
    return BoxesStatus(radios.link_state(look.reading), radios.quality(look.reading, expected_link), tuple(findings))


def _prefix_host(host: Host, finding: LinkFinding) -> LinkFinding:
    return replace(finding, message=f"{host.name}: {finding.message}")


def _far(boxes: BoxesStatus) -> BoxesStatus:
    """Keep only the signal from the far end's readings."""
    return replace(boxes, quality={"far_signal_dbm": boxes.quality.get("signal_dbm")})


def _merge(first: BoxesStatus, second: BoxesStatus) -> BoxesStatus:
    """Merge two reports; the worse state applies."""
    states = [state for state in (first.state, second.state) if state is not None]
    return BoxesStatus(
        max(states, key=_WORSE.index, default=None),
        first.quality | second.quality,
        (*first.findings, *second.findings),
        (*first.silent, *second.silent),
    )


_WORSE = (LinkState.UP, LinkState.UNKNOWN, LinkState.SEARCHING, LinkState.DOWN)


def unheard(silent: Iterable[Silent], *, answers: bool | None) -> tuple[LinkFinding, ...]:
    """Return findings about silent devices: minor if their link works, severe if nothing responds over it."""
    verdict = Verdict.INCONCLUSIVE if answers is not False else Verdict.FAIL
    suffix = {True: ", but its link works", None: "", False: ", and nothing responds over its link"}[answers]
    return tuple(
        LinkFinding(
            verdict,
            "device-unreachable",
            msg(f"cannot read {arg(item.device)}{arg(suffix)}: {arg(item.message)}"),
            item.hint,
        )
        for item in silent
    )


def of_terminal(inventory: Inventory, host: Host | None, store: Store, today: date) -> BoxesStatus:
    """Return the terminal's evidence and the findings about it; raise DamagedStateError."""
    if host is None or not is_terminal(host):
        return BoxesStatus()
    result = judge_terminal(inventory, host, store, today=today)
    evidence = result.evidence
    quality: Quality = {
        "firmware": None if evidence is None else evidence.firmware,
        "seen_by": None if evidence is None else evidence.by,
        "seen_on": None if evidence is None else evidence.seen_on.isoformat(),
    }
    return BoxesStatus(None, quality, result.findings)


def kept_off(link: model.Link, port: str | None, router: RouterReading | None) -> Quality:
    """Return the packets that the router dropped on the link, and whether the next hop recently answered ARP.

    The chain's name is that of `render.view.Uplink.chain`. An ARP entry expires, so its absence proves nothing.
    """
    there = None if router is None or router.neighbours is None else router.neighbours.get(port or "", ())
    drops = None if router is None or router.drop_counters is None else router.drop_counters.get(f"to-{link.name}")
    has_answered = None if there is None else str(link.gateway) in {item.address for item in there}
    return {
        "next_hop_seen": {None: None, True: "yes", False: "no"}[has_answered],
        "kept_off_packets": None if drops is None else drops[0],
        "kept_off_bytes": None if drops is None else drops[1],
    }


_INTERFACE = "lte1"
"""RouterOS' factory name of a unit's only modem."""


@dataclass(frozen=True, slots=True)
class UnitLook:
    """A 4G unit's reading, with its driver's findings."""

    reading: LteReading
    findings: tuple[LinkFinding, ...]
    requests: int | None = None
    """Requests sent to the unit, if its driver counts them."""


async def read_routeros(device: ReadOnlySession, unit: LteUnit) -> UnitLook:
    """Read in one session; raise DeviceError.

    If a run has tried the PIN of the inventory and the SIM still asks for one, the PIN is wrong, whatever the device
    reports.
    """
    async with device.open_session() as session:
        reading = await modem_reading(session)
    if reading.state is Registration.SIM_PIN_REQUIRED and unit.pin_tried:
        reading = replace(reading, pin_refused=True)
    return UnitLook(reading, judge.judge(reading, unit.expectation))


async def modem_reading(session: api.Session) -> LteReading:
    """Read in one round trip; one more if only the log reports the SIM, and one for a modem with another name."""
    replies = await session.flight([command(query) for query in routeros.queries(_INTERFACE)])
    name = routeros.modem_name(rows(replies[1]), _INTERFACE)
    if name != _INTERFACE:
        replies[0] = await session.command(command(routeros.monitor_query(name)))
    reading = _read_lte(replies)
    if reading.state is Registration.UNKNOWN:
        reading = _read_lte(replies, rows(await session.command(command(routeros.log_query()))))
    return reading


def _read_lte(replies: list[api.Reply], log: tuple[Row, ...] | None = None) -> LteReading:
    monitor, interfaces, profiles, addresses = (rows(reply) for reply in replies)
    return routeros.read(monitor[0] if monitor else None, interfaces, profiles, addresses, log, _INTERFACE)


async def read_by_driver(unit: LteUnit) -> UnitLook:
    """Read a unit of another make in a thread, as its driver blocks; raise NetcfgError."""
    status = await asyncio.to_thread(unit.look)
    return UnitLook(status.reading, status.findings, status.requests)


def of_unit(name: str, answer: UnitLook, driver: model.LteDriver, *, forwards: bool) -> BoxesStatus:
    """Convert a 4G unit's reading to its link's status; `forwards`: ports of outer addresses are forwarded inside."""
    reading = answer.reading
    if driver is model.LteDriver.MANUAL:
        return BoxesStatus(findings=answer.findings)
    nat_findings = judge_carrier_nat(name, reading.address, forwards=forwards)
    nat = None if reading.address is None else "yes" if nat_findings else "no"
    findings = (replace(finding, message=f"{name}: {finding.message}") for finding in answer.findings)
    state = judge.link_state(reading)
    return BoxesStatus(
        state, judge.quality(reading) | {"carrier_nat": nat}, (*findings, *(nat_findings if forwards else ()))
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenLinks:
    """All observations of one link from one reading."""

    route: LinkRoute
    router: RouterReading | Silent | None
    """Reading of the router; None: it was not to be queried."""
    boxes_status: BoxesStatus
    active: bool | None
    month_bytes: int | None = None
    box: str | None = None
    """Device of the link at this end in the inventory, if there is one."""
    next_hop: str | None = None
    network: IPv4Network | None = None
    """Network of the link."""
    power_port: str | None = None
    """The router's PoE port that powers the device, if there is one."""

    @property
    def reading(self) -> RouterReading | None:
        """The router's report, if it responded."""
        return self.router if not isinstance(self.router, Silent) else None

    @property
    def port(self) -> SessionPort | None:
        """The interface of the link."""
        reading = self.reading
        return None if reading is None or self.route.port is None else (reading.ports or {}).get(self.route.port)

    @property
    def strangers(self) -> tuple[str, ...]:
        """Addresses outside the link's network that have answered ARP on its port."""
        reading, network = self.reading, self.network
        if reading is None or reading.neighbours is None or network is None:
            return ()
        there = (item.address for item in reading.neighbours.get(self.route.port or "", ()))
        return tuple(address for address in there if IPv4Address(address) not in network)

    @property
    def echoes(self) -> tuple[Echo, ...]:
        """The replies of the link's probe targets."""
        reading = self.reading
        return () if reading is None else (reading.echoes or {}).get(self.route.name, ())

    @property
    def answers(self) -> bool | None:
        """Whether any probe target responds over the link; None if none was pinged."""
        return any(echo.received_count for echo in self.echoes) if self.echoes else None

    @property
    def dark(self) -> bool:
        """Whether the link's port is down or disabled."""
        return self.port is not None and (self.port.running is False or self.port.is_disabled is True)


def link_status(observation: SeenLinks) -> LinkStatus:
    """Reduce the observations of a link to a status."""
    return LinkStatus(
        name=observation.route.name,
        kind=observation.route.kind,
        state=_state(observation),
        active=observation.active,
        is_metered=observation.route.is_metered,
        quality=_quality(observation),
        month_bytes=observation.month_bytes,
        findings=tuple(_findings(observation)),
    )


def _state(observation: SeenLinks) -> LinkState:
    if observation.dark:
        return LinkState.DOWN
    if observation.answers is not None:
        waiting = observation.boxes_status.state is LinkState.SEARCHING
        return LinkState.UP if observation.answers else LinkState.SEARCHING if waiting else LinkState.DOWN
    return observation.boxes_status.state or LinkState.UNKNOWN


def _quality(observation: SeenLinks) -> Quality:
    port, echoes = observation.port, observation.echoes
    sent_count = sum(echo.sent_count for echo in echoes)
    times = [echo.rtt_ms for echo in echoes if echo.rtt_ms is not None]
    lost_count = sent_count - sum(echo.received_count for echo in echoes)
    quality: Quality = {
        "port": observation.route.port,
        "port_link": None if port is None or port.running is None else "up" if not observation.dark else "down",
        "rtt_ms": round(min(times), 1) if times else None,
        "loss_percent": round(100 * lost_count / sent_count) if sent_count else None,
    }
    return quality | observation.boxes_status.quality


def _findings(observation: SeenLinks) -> Iterator[LinkFinding]:
    if isinstance(observation.router, Silent):
        message = msg(
            f"cannot read the router, so the state of this link is unknown: {arg(observation.router.message)}"
        )
        yield LinkFinding(Verdict.INCONCLUSIVE, "router-unreachable", message, observation.router.hint)
    yield from _port_findings(observation)
    yield from _of_strangers(observation)
    boxes = tuple(_filter_findings(observation))
    yield from boxes
    yield from unheard(observation.boxes_status.silent, answers=False if observation.dark else observation.answers)
    if not observation.dark:
        yield from _of_probe_targets(observation, is_explained=any(item.verdict is Verdict.FAIL for item in boxes))


def _filter_findings(observation: SeenLinks) -> Iterator[LinkFinding]:
    """Yield the findings, but no missing address if probe targets respond over the link."""
    for finding in observation.boxes_status.findings:
        if finding.code != "no-address" or not observation.answers:
            yield finding


def _port_findings(observation: SeenLinks) -> Iterator[LinkFinding]:
    name, port = observation.route.port, observation.port
    reading = observation.reading
    if reading is not None and reading.ports is not None and port is None:
        hint = "compare `ports` in the router's host_vars with the device"
        yield LinkFinding(Verdict.FAIL, "port-missing", msg(f"the router has no port {arg(name)}"), hint)
    elif reading is not None and (alias := reading.port_aliases.get(name or "")) is not None:
        hint = "run provision for the site: it restores port names and applies the port settings"
        message = msg(
            f"port {arg(name)} of the router is named {arg(alias)} there: settings bound to the name apply elsewhere"
        )
        yield LinkFinding(Verdict.FAIL, "port-renamed", message, hint)
    elif port is not None and port.is_disabled:
        hint = "apply the site's configuration to enable it, or find out who disabled it"
        yield LinkFinding(Verdict.FAIL, "port-disabled", msg(f"port {arg(name)} of the router is disabled"), hint)
    elif port is not None and port.running is False:
        fed = msg(f" from PoE of {arg(observation.power_port)}" if observation.power_port else "")
        hint = msg(f"is the cable plugged in at both ends, and does the device have power{arg(fed)}?")
        yield LinkFinding(Verdict.FAIL, "port-down", msg(f"port {arg(name)} of the router has no link"), hint)


def _of_strangers(observation: SeenLinks) -> Iterator[LinkFinding]:
    """Report a device on the port with an address of another network: probably factory state (devices.md, 3)."""
    reading = observation.reading
    if observation.box is None or observation.next_hop is None or reading is None or reading.neighbours is None:
        return
    answers = observation.next_hop in {
        item.address for item in reading.neighbours.get(observation.route.port or "", ())
    }
    for stranger in observation.strangers:
        yield from judge_factory_address(
            observation.box,
            observation.route.port or "",
            observation.next_hop,
            answers=answers,
            answers_at_factory=stranger,
        )


def _of_probe_targets(observation: SeenLinks, *, is_explained: bool) -> Iterator[LinkFinding]:
    """Report silent probe targets; a link that is down is reported once, by the finding that explains it."""
    silent = [echo.target for echo in observation.echoes if not echo.received_count]
    if observation.answers is False and not is_explained:
        message = msg(f"no probe target responds over this link ({arg(join(', ', silent))})")
        waits = observation.boxes_status.state is LinkState.UP
        hint = (
            "its device is connected: check beyond it, at the far router or the provider"
            if waits
            else "check the device of this link, then what is beyond it"
        )
        yield LinkFinding(Verdict.FAIL, "canaries-silent", message, hint)
    elif observation.answers and silent:
        message = msg(f"{arg(join(', ', silent))} does not respond over this link, the others do")
        hint = "one probe target is enough to prove the link; if it stays silent, set another one in `canaries`"
        yield LinkFinding(Verdict.WARN, "canary-silent", message, hint)
    elif observation.answers and any(echo.received_count < echo.sent_count for echo in observation.echoes):
        sent_count, received_count = (
            sum(echo.sent_count for echo in observation.echoes),
            sum(echo.received_count for echo in observation.echoes),
        )
        message = msg(f"{arg(sent_count - received_count)} of {arg(sent_count)} pings were lost")
        yield LinkFinding(Verdict.WARN, "loss", message, "check again; a link that keeps losing packets may fail soon")


def twice(observations: Sequence[SeenLinks]) -> tuple[tuple[str, LinkFinding], ...]:
    """Return findings, by link, for addresses that occur on two ports, mostly factory addresses."""
    ports: dict[str, list[SeenLinks]] = {}
    for item in observations:
        for stranger in item.strangers:
            ports.setdefault(stranger, []).append(item)
    return tuple(
        (item.route.name, _duplicate_address_finding(address, many))
        for address, many in ports.items()
        if len(many) > 1
        for item in many
    )


def _duplicate_address_finding(address: str, many: Sequence[SeenLinks]) -> LinkFinding:
    where = conjunction(msg(f"{arg(item.route.port)} ({arg(item.route.name)})") for item in many)
    message = msg(
        f"{arg(address)} responds on {arg(where)}: two devices share one address, and the router reaches only one"
    )
    return LinkFinding(Verdict.FAIL, "address-twice", message, "give each device its address from the inventory")


def rank(
    statuses: Sequence[LinkStatus], fail_back_s: int, use: tuple[str, LinkFinding] | None = None
) -> tuple[LinkStatus, ...]:
    """Add to each status what follows from the order of preference; `statuses` are in that order.

    `use`: the link that is temporarily in use, and the finding about it. It precedes all others meanwhile.
    """
    if use is None or all(status.name != use[0] for status in statuses):
        return _add_rank_findings(statuses, fail_back_s)
    link, finding = use
    order = sorted(statuses, key=lambda status: status.name != link)
    status_by_name = {status.name: status for status in _add_rank_findings(order, fail_back_s)}
    status_by_name[link] = _add_finding(status_by_name[link], finding)
    return tuple(status_by_name[status.name] for status in statuses)


def _add_rank_findings(statuses: Sequence[LinkStatus], fail_back_s: int) -> tuple[LinkStatus, ...]:
    if any(status.active is None for status in statuses):
        return tuple(statuses)
    active = [status.name for status in statuses if status.active]
    if not active:
        first, *others = statuses
        message = "no default route uses any link: no traffic leaves the site"
        hint = "a router that was never configured has none: run the site; otherwise see the results of each link"
        return (_add_finding(first, LinkFinding(Verdict.FAIL, "no-way-out", message, hint)), *others)
    place = min(number for number, status in enumerate(statuses) if status.active)
    return tuple(_rank_status(status, number, place, statuses, fail_back_s) for number, status in enumerate(statuses))


def _rank_status(
    status: LinkStatus, number: int, place: int, statuses: Sequence[LinkStatus], fail_back_s: int
) -> LinkStatus:
    if number < place and status.state is LinkState.UP:
        message = msg(f"it responds, but {arg(statuses[place].name)} carries the traffic")
        hint = msg(
            f"it is used again after it has responded for {arg(fail_back_s)} s without interruption: check again then"
        )
        return _add_finding(status, LinkFinding(Verdict.WARN, "not-taken-yet", message, hint))
    if number and status.active:
        cost_note = ", and it is metered" if status.is_metered else ""
        message = msg(f"it carries the traffic in place of {arg(statuses[0].name)}{arg(cost_note)}")
        return _add_finding(
            status,
            LinkFinding(Verdict.WARN, "in-place-of-a-better-one", message, msg(f"repair {arg(statuses[0].name)}")),
        )
    return status


def _add_finding(status: LinkStatus, finding: LinkFinding) -> LinkStatus:
    return replace(status, findings=(*status.findings, finding))
