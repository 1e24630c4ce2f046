"""Beside one device's run: which link carries it, whether it may go on, what it cost, and what the router counted."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.bearers.cost import CostRefused, bill, preview, size
from atlantis_netcfg.bearers.policy import active_bearer
from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.journal import CostCounted, Counters, Store
from atlantis_netcfg.operations.bearers import LAN, bearer_of
from atlantis_netcfg.operations.costs._gate import accepting
from atlantis_netcfg.operations.costs._links import links_of, ports_of, ways_of
from atlantis_netcfg.routeros.apply import Admission
from atlantis_netcfg.routeros.estimate import on_the_wire

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.bearers.cost import Bill, Link, Preview
    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.journal import Recorder
    from atlantis_netcfg.operations.request import Request
    from atlantis_netcfg.routeros._types import Observed
    from atlantis_netcfg.routeros.apply import DeviceResult
    from atlantis_netcfg.routeros.estimate import Estimate

__all__ = ["Meter"]


@dataclass(slots=True)
class Meter:
    """The engine's `Toll` of one device.

    A session goes over the declared link (`access.via`, or the one that a person named with `via=`) as long as nothing
    else is known. On the router of a site its active default route tells which bearer really carries what comes from
    beyond the site, and with it the session; over the technician's cable no bearer carries it. An emulated device is
    behind the declared link, whatever its own routes say.
    """

    declaration: Declaration
    host: Host
    request: Request
    declared: str = field(init=False)
    active: str | None = field(init=False, default=None)
    """The bearer of the active default route; None: not read, or not one alone."""
    expected: Preview | None = field(init=False, default=None)
    """What the run was expected to cost over the link that carries it, where that is metered."""

    def __post_init__(self) -> None:
        self.declared = bearer_of(self.declaration, self.host, self.request.via.get(self.host.name)).name

    @property
    def ports(self) -> tuple[str, ...]:
        """Ports whose counters are read along."""
        return tuple(port for port, link in ports_of(self.host).items() if link in self._links)

    @property
    def link(self) -> Link:
        """What carries the session, as far as it is known."""
        if self.active is None or self.declared == LAN.name or self.request.rehearsed:
            return self._links[self.declared]
        return self._links[self.active]

    @property
    def _links(self) -> Mapping[str, Link]:
        return links_of(self.declaration, self.host.site)

    def judge(self, seen: Observed, estimate: Estimate | None, *, spends: bool, planned: bool) -> Admission:
        """Look at the active route, then at what the plan would send: whether it is agreed to, and below the cap."""
        self.active = active_bearer(seen.rows.get("/ip/route", ()), ways_of(self.declaration, self.host))
        notes = tuple(self._elsewhere())
        if not self.link.metered or estimate is None:
            return Admission(notes)
        self.expected = preview(estimate.wire_bytes, estimate.seconds, self.link)
        refusal = self._refusal(planned=planned) if spends else None
        if refusal is None:
            return Admission(notes)
        if self.request.rehearsed:
            return Admission((*notes, f"a real run would be refused: {refusal}"))
        return Admission(notes, str(refusal), refusal.hint)

    def _refusal(self, *, planned: bool) -> CostRefused | None:
        """Why what the plan would send may not be sent; a plan alone needs nobody's consent, nor does a rehearsal."""
        assert self.expected is not None  # noqa: S101 - `judge` has just said what it expects
        if self.expected.over_cap:
            return self.expected.refusal()
        if planned or self.request.rehearsed or self.request.accept_cost:
            return None
        return CostRefused(
            f"nobody has agreed to pay for it: {self.expected.words}",
            hint=f"type the same with {accepting(self.request.command)}, or wait until {self.declared} is back",
        )

    def told(self, result: DeviceResult, journal: Recorder, store: Store) -> dict[str, Any]:
        """Write down what it came to; return what the result shall say of it: `cost`, where it was paid by the byte.

        What cannot be written is said in the result: what has happened must not be lost over it.
        """
        notes = [*result.notes, *self._keep(result, store)]
        if not self.link.metered:
            return {"notes": notes}
        spent = bill(on_the_wire(result.sent + result.received, result.sessions), result.seconds, self.link.tariff)
        router = self._counted(result)
        try:
            journal.write(self._record(spent, router))
        except NetcfgError as failure:
            notes.append(str(failure))
        return {"notes": notes, "cost": self._cost(spent, router)}

    def _elsewhere(self) -> Iterator[str]:
        """Say that the session goes over another link than declared, above all if that is the dearer one."""
        if self.link.name == self.declared or self.active is None:
            return
        said = (
            f"{self.host.name} is declared to be reached over {self.declared}, but its traffic goes over {self.active}"
        )
        dear = ", which is paid by the byte" if self.link.metered else ""
        order = [way.name for way in ways_of(self.declaration, self.host)]
        down = order.index(self.declared) < order.index(self.active)
        yield f"{said} now{dear}" + (f": {self.declared} is down" if down else "")

    def _keep(self, result: DeviceResult, store: Store) -> Iterator[str]:
        """Keep the last look at every port for the month; yield what went wrong."""
        if not result.counts:
            return
        last, usage = result.counts[-1], store.usage(self.host.site)
        for port, name in ports_of(self.host).items():
            if port not in last.ports or name not in self._links:
                continue
            rx, tx = last.ports[port]
            look = Counters(
                device=self.host.name, interface=port, rx_bytes=rx, tx_bytes=tx, at=last.at, uptime_s=last.uptime_s
            )
            try:
                usage.record(name, look)
            except NetcfgError as failure:
                yield str(failure)
                return

    def _counted(self, result: DeviceResult) -> dict[str, Any] | None:
        """By how much the router's own counters rose between the first and the last look; None if that is unknown."""
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

    def _cost(self, spent: Bill, router: dict[str, Any] | None) -> dict[str, Any]:
        return {
            "bearer": self.link.name,
            "declared": self.declared,
            "active": self.active,
            "cap_bytes": self.link.cap_bytes,
            "accepted": self.request.accept_cost,
            "expected": None if self.expected is None else dict(self.expected.bill.as_dict()),
            "words": self._asks(),
            "instead": next(self._elsewhere(), None),
            "bill": dict(spent.as_dict()),
            "bill_words": _words(spent, router),
            "router": router,
        }

    def _asks(self) -> str:
        return "" if self.expected is None else self.expected.words

    def _record(self, spent: Bill, router: dict[str, Any] | None) -> CostCounted:
        return CostCounted(
            device=self.host.name,
            bearer=self.link.name,
            declared=self.declared,
            accepted=self.request.accept_cost,
            expected_bytes=None if self.expected is None else self.expected.bill.payload_bytes,
            sent_bytes=spent.payload_bytes,
            router_bytes=None if router is None else router["bytes"],
            billed_bytes=spent.billed_bytes,
            price=None if spent.price is None else str(spent.price),
            currency=spent.currency,
        )


def _words(spent: Bill, router: dict[str, Any] | None) -> str:
    if router is None:
        return f"{spent.words}; not counted by the router"
    return (
        f"{spent.words}; the router counted {size(router['bytes'])} on {router['interface']}, others' traffic included"
    )
