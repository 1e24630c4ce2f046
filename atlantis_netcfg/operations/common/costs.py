"""Cost of a request on metered links: shown and agreed to first, counted afterwards.

Every entry point uses this module, so that neither a command nor a playbook can forget to ask: `require_consent`
refuses a request before its first byte, a `Meter` accompanies each device's run, and `Costs.report` returns the bill.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final

from atlantis_netcfg import runs
from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.links import cost
from atlantis_netcfg.links.policy import LinkRoute, active_link
from atlantis_netcfg.operations.common import request as requests
from atlantis_netcfg.operations.common.kinds import is_supported
from atlantis_netcfg.operations.common.request import Mode, Request
from atlantis_netcfg.operations.common.session_link import LAN, site_link_of
from atlantis_netcfg.operations.common.site_links import link_of, links_of
from atlantis_netcfg.routeros import apply
from atlantis_netcfg.routeros.estimate import Estimate, on_the_wire
from atlantis_netcfg.routeros.estimate import LinkMetrics as Carrier
from atlantis_netcfg.routeros.estimate import beforehand as before_reading

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.routeros._types import Observation

_MB: Final = 1_000_000


def ways_of(inventory: Inventory, host: Host) -> tuple[LinkRoute, ...]:
    """Return the links in the router's routing; empty for a device that is not a router."""
    if not isinstance(host.device, model.Router):
        return ()
    ports = {link: port for port, link in ports_of(host).items()}
    return tuple(
        LinkRoute(
            name=link.name,
            gateway=str(link.gateway),
            address=str(link.address),
            probe_targets=tuple(map(str, link.canaries)),
            port=ports.get(link.name),
            kind=link.kind.value,
            is_metered=link.metered,
        )
        for link in inventory.sites[host.site].bearers
    )


def ports_of(host: Host) -> Mapping[str, str]:
    """Return the link name of each router port, in the order of the inventory."""
    if not isinstance(host.device, model.Router):
        return {}
    return {port.name: port.link for port in host.device.ports if port.link is not None}


_TOOL: Final = 60_000
"""Maximum bytes of the packed program that runs our modules on a gateway; checked by a test."""
_LOOK: Final = (34_000, 10_000)
"""Bytes up and down of all roles if there is nothing to change."""
_WORK: Final = (117_000, 46_000)
"""Bytes up and down of all roles on a new gateway, including the program."""


def preview_costs(
    inventory: Inventory, hosts: Sequence[Host], request: Request, *, at_most: bool = True
) -> tuple[cost.Preview, ...]:
    """Return one cost preview per metered link that this request uses, summed over its devices.

    `at_most`: a run that may write is priced as if all of its text had to be written, since the device has not been
    read yet, and a plan as if the device's parser had to check all of it; otherwise the reading alone.

    Raises UsageError for a link that a site does not have.
    """
    sums: dict[cost.MeteredLink, list[Estimate]] = {}
    bounds: set[cost.MeteredLink] = set()
    for host in hosts:
        site_link = _carrier(inventory, host, request)
        if site_link is not None and site_link.is_metered:
            link = link_of(inventory, host.site, site_link.name)
            sums.setdefault(link, []).append(_estimate_host(host, site_link, request, at_most=at_most))
            if at_most and (_is_write_request(request) or (request.mode is Mode.PLAN and is_supported(host))):
                bounds.add(link)
    return tuple(
        cost.preview(
            sum(each.wire_bytes for each in estimates),
            sum(each.seconds for each in estimates),
            link,
            at_most=link in bounds,
        )
        for link, estimates in sums.items()
    )


def require_consent(inventory: Inventory, hosts: Sequence[Host], request: Request) -> None:
    """Raise CostRefusal before the first byte unless the cost is agreed to; a rehearsal costs nothing.

    Beyond the cap, consent does not help. What a run would write is checked against the cap once its plan is known.
    Raises UsageError for a link that a site does not have.
    """
    readings = preview_costs(inventory, hosts, request, at_most=False)
    if request.rehearsed:
        return
    for reading in readings:
        if reading.over_cap:
            raise reading.refusal()
    if not request.accept_cost:
        dear = preview_costs(inventory, hosts, request)
        if dear:
            raise unpaid([each.words for each in dear], request.command)


def unpaid(words: Sequence[str], command: str = "provision") -> cost.CostRefusal:
    """Return the error for costs without consent; `command` tells by which entry point the request came."""
    return cost.CostRefusal(
        f"the cost was not accepted, so nothing was sent: {arg(join('; ', words))}",
        hint=(
            f"run the same command with {arg(accepting(command))} (`--yes` does not accept costs), or use another "
            "link: `via=lan`"
        ),
    )


def accepting(command: str) -> str:
    """Return the argument that gives consent to costs, for the entry point used."""
    return f"`-e {requests.ACCEPT_COST}=true`" if command == requests.PLAIN_ANSIBLE else f"`{cost.ACCEPT}`"


def _carrier(inventory: Inventory, host: Host, request: Request) -> Carrier | None:
    """Return the link that a session to a host uses; None if there is no session, or for a local modem.

    A RutOS unit has no route in the inventory: it is behind the router of its site, and is reached the same way.
    A computer has no backup.
    """
    if is_supported(host) or (isinstance(host.device, model.SshHost) and request.mode is not Mode.BACKUP):
        return site_link_of(inventory, host, request.via.get(host.name))
    if not isinstance(host.device, model.LteRouter) or host.device.driver is not model.LteDriver.RUTOS:
        return None
    here = (
        item for item in inventory.hosts.values() if item.site == host.site and isinstance(item.device, model.Router)
    )
    router = next(here, None)
    if router is None:
        return None
    return site_link_of(inventory, router, request.via.get(host.name) or request.via.get(router.name))


def _estimate_host(host: Host, link: Carrier, request: Request, *, at_most: bool) -> Estimate:
    if is_supported(host):
        return _estimate(link, request, at_most=at_most)
    if isinstance(host.device, model.SshHost):
        return _computer(link, writes=at_most and _is_write_request(request))
    return _unit(link)


def _computer(link: Carrier, *, writes: bool) -> Estimate:
    """Estimate all roles of a computer over SSH; measured on an emulated gateway with 700 ms and 352/704 kbit/s.

    Nothing to do: 18.8 kB up and 5.9 kB down in 10 round trips, with a new connection and the role of a bundle.
    Everything to do: 81 kB up with a program of 53 kB, 45 kB down, 21 s of work on the host; its round trips are
    inferred, and the first data of the call that compares everything, 13 kB, was added by its size.
    Whether the computer has the current version of the program that runs the modules is not known in advance, so it is
    always counted. The program of the far end of measured links, 12.4 kB packed in each run, was added afterwards by
    its size. Downloads by the computer itself, packages and sources, are extra: their modules respect the cap.
    """
    up, down = _WORK if writes else (_LOOK[0] + _TOOL, _LOOK[1])
    trips, work_s = (63, 25.0) if writes else (13, 6.0)
    seconds = trips * link.rtt_s + 8 * up / link.rate_up_bps + 8 * down / link.rate_down_bps + work_s
    return Estimate(link.name, trips, up, down, seconds)


def _unit(link: Carrier) -> Estimate:
    """Estimate reading a RutOS unit: two HTTPS sessions with a few kB of JSON (inferred, not measured on a unit)."""
    return Estimate(link.name, 8, 4_000, 12_000, 12 * link.rtt_s, sessions=2)


def _estimate(link: Carrier, request: Request, *, at_most: bool) -> Estimate:
    if request.mode is Mode.BACKUP:
        return before_reading(link, exports=True)
    plans = at_most and request.mode is Mode.PLAN
    return before_reading(link, writes=at_most and _is_write_request(request), plans=plans)


def _is_write_request(request: Request) -> bool:
    return not request.mode.reads_only and request.mode is not Mode.BACKUP


@dataclass(slots=True)
class Meter:
    """The cost policy of one device's job.

    A session is assumed to use the link of the inventory (`access.via`, or the one named with `via=`) until more is
    known. On the router of a site its active default route tells which link really carries traffic from outside the
    site, and so the session; over the technician's cable it uses no link. An emulated device is behind the link of the
    inventory, whatever its own routes are.
    """

    inventory: Inventory
    host: Host
    request: Request
    declared_link: str = field(init=False)
    active: str | None = field(init=False, default=None)
    """Link of the active default route; None: not read, or not unique."""
    expected_cost: cost.Preview | None = field(init=False, default=None)
    """Expected cost of the run on the link that carries it, if that link is metered."""

    def __post_init__(self) -> None:
        self.declared_link = site_link_of(self.inventory, self.host, self.request.via.get(self.host.name)).name

    @property
    def ports(self) -> tuple[str, ...]:
        """The ports whose counters are read with each observation."""
        return tuple(port for port, link in ports_of(self.host).items() if link in self._links)

    @property
    def link(self) -> cost.MeteredLink:
        """The link that carries the session, as far as it is known."""
        if self.active is None or self.declared_link == LAN.name or self.request.rehearsed:
            return self._links[self.declared_link]
        return self._links[self.active]

    @property
    def _links(self) -> Mapping[str, cost.MeteredLink]:
        return links_of(self.inventory, self.host.site)

    def judge(
        self, observation: Observation, estimate: Estimate | None, *, spends: bool, is_plan: bool
    ) -> apply.Admission:
        """Read the active route, then check that the plan's traffic is agreed to and below the cap."""
        self.active = active_link(observation.rows.get("/ip/route", ()), ways_of(self.inventory, self.host))
        notes = (*self._elsewhere(), *self._without_budget())
        if not self.link.is_metered or estimate is None:
            return apply.Admission(notes)
        self.expected_cost = cost.preview(estimate.wire_bytes, estimate.seconds, self.link)
        refusal = self._refusal(plan_only=is_plan) if spends else None
        if refusal is None:
            return apply.Admission(notes)
        if self.request.rehearsed:
            return apply.Admission((*notes, msg(f"a real run would be refused: {arg(refusal)}")))
        return apply.Admission(notes, str(refusal), refusal.hint)

    def _refusal(self, *, plan_only: bool) -> cost.CostRefusal | None:
        """Return why the plan's traffic may not be sent; a plan or a rehearsal needs no consent."""
        assert self.expected_cost is not None  # noqa: S101 - `judge` has just said what it expects
        if self.expected_cost.over_cap:
            return self.expected_cost.refusal()
        if plan_only or self.request.rehearsed or self.request.accept_cost:
            return None
        return cost.CostRefusal(
            f"the cost was not accepted: {arg(self.expected_cost.words)}",
            hint=(
                f"run the same command with {arg(accepting(self.request.command))}, or wait until "
                f"{arg(self.declared_link)} is up again"
            ),
        )

    def report(self, result: apply.DeviceResult, journal: runs.Recorder, store: runs.Store) -> dict[str, Any]:
        """Record the actual cost; return what the result adds: `notes`, and `cost` for a metered link.

        A write error is reported in the result, which must not be lost over it.
        """
        notes = [*result.notes, *self._keep(result, store)]
        if not self.link.is_metered:
            return {"notes": notes}
        final_bill = cost.bill(
            on_the_wire(result.sent_bytes + result.received_bytes, result.sessions), result.seconds, self.link.tariff
        )
        router = self._router_count(result)
        try:
            journal.write(self._record(final_bill, router))
        except NetcfgError as failure:
            notes.append(str(failure))
        return {"notes": notes, "cost": self._cost(final_bill, router)}

    def _without_budget(self) -> Iterator[str]:
        """Yield a warning for each of a router's metered links without a budget for standing traffic."""
        for link in self.inventory.sites[self.host.site].bearers if isinstance(self.host.device, model.Router) else ():
            if link.metered and not link.has_standing_budget:
                yield msg(
                    f"WARN: no budget in the inventory for background traffic over {arg(link.name)}; docs/links.md"
                )

    def _elsewhere(self) -> Iterator[str]:
        """Yield a warning if the session uses another link than in the inventory, above all a more expensive one."""
        if self.link.name == self.declared_link or self.active is None:
            return
        sentence = msg(
            f"the inventory reaches {arg(self.host.name)} over {arg(self.declared_link)}, but its traffic uses "
            f"{arg(self.active)}"
        )
        dear = ", which is metered" if self.link.is_metered else ""
        order = [route.name for route in ways_of(self.inventory, self.host)]
        down = order.index(self.declared_link) < order.index(self.active)
        yield msg(f"{arg(sentence)} now{arg(dear)}" + (f": {arg(self.declared_link)} is down" if down else ""))

    def _keep(self, result: apply.DeviceResult, store: runs.Store) -> Iterator[str]:
        """Save each port's last counters for the monthly usage; yield the errors."""
        if not result.counts:
            return
        last, usage = result.counts[-1], store.usage(self.host.site)
        for port, name in ports_of(self.host).items():
            if port not in last.ports or name not in self._links:
                continue
            rx, tx = last.ports[port]
            counters = runs.Counters(
                device=self.host.name, interface=port, rx_bytes=rx, tx_bytes=tx, at=last.at, uptime_s=last.uptime_s
            )
            try:
                usage.record(name, counters)
            except NetcfgError as failure:
                yield str(failure)
                return

    def _router_count(self, result: apply.DeviceResult) -> dict[str, Any] | None:
        """Return the increase of the router's counters between first and last reading; None if unknown."""
        port = next((port for port, link in ports_of(self.host).items() if link == self.link.name), None)
        if port is None or not result.counts:
            return None
        first, last = result.counts
        if first is last or port not in first.ports or port not in last.ports:
            return None
        rx, tx = (after - before for before, after in zip(first.ports[port], last.ports[port], strict=True))
        if rx < 0 or tx < 0:
            return None
        return {"interface": port, "rx_bytes": rx, "tx_bytes": tx, "bytes": rx + tx}

    def _cost(self, final_bill: cost.Bill, router: dict[str, Any] | None) -> dict[str, Any]:
        return {
            "bearer": self.link.name,
            "declared": self.declared_link,
            "active": self.active,
            "cap_bytes": self.link.cap_bytes,
            "accepted": self.request.accept_cost,
            "expected": None if self.expected_cost is None else dict(self.expected_cost.bill.as_dict()),
            "words": self._expected_words(),
            "instead": next(self._elsewhere(), None),
            "bill": dict(final_bill.as_dict()),
            "bill_words": _bill_text(final_bill, router),
            "router": router,
        }

    def _expected_words(self) -> str:
        return "" if self.expected_cost is None else self.expected_cost.words

    def _record(self, final_bill: cost.Bill, router: dict[str, Any] | None) -> runs.CostRecord:
        return runs.CostRecord(
            device=self.host.name,
            bearer=self.link.name,
            declared=self.declared_link,
            accepted=self.request.accept_cost,
            expected_bytes=None if self.expected_cost is None else self.expected_cost.bill.payload_bytes,
            sent_bytes=final_bill.payload_bytes,
            router_bytes=None if router is None else router["bytes"],
            billed_bytes=final_bill.billed_bytes,
            price=None if final_bill.price is None else str(final_bill.price),
            currency=final_bill.currency,
        )


def _bill_text(final_bill: cost.Bill, router: dict[str, Any] | None) -> str:
    if router is None:
        return msg(f"{arg(final_bill.words)}; not counted by the router")
    return msg(
        f"{arg(final_bill.words)}; the router counted {arg(cost.size(router['bytes']))} on {arg(router['interface'])}, "
        "including other traffic"
    )


@dataclass(slots=True)
class Costs:
    """The meters of one request, made when their device's turn comes."""

    inventory: Inventory
    request: Request
    _meters: dict[str, Meter] = field(default_factory=dict)

    def with_meter(self, job: apply.DeviceJob) -> apply.DeviceJob:
        """Return the job with its meter."""
        meter = self._meter(job.name)
        return replace(job, cost_policy=meter, counted_ports=meter.ports)

    def report(self, result: apply.DeviceResult, journal: runs.Recorder, store: runs.Store) -> Mapping[str, Any]:
        """Return what a finished device's result adds about costs; call it before its site's journal is closed."""
        bill_data = self._meter(result.name).report(result, journal, store)
        del self._meters[result.name]
        return bill_data

    def _meter(self, name: str) -> Meter:
        if name not in self._meters:
            self._meters[name] = Meter(self.inventory, self.inventory.hosts[name], self.request)
        return self._meters[name]
