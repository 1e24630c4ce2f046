"""From what the router and a bearer's own boxes said to what is told of the bearer; pure.

Whom to believe: a canary that answers over the link proves it, whatever a box says of itself; canaries that are all
silent disprove it. A port without a link disproves it without a packet. A satellite is never probed, so nothing but its
port can be seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from ipaddress import IPv4Address
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import BearerStatus, Finding, LinkState, Quality
from atlantis_netcfg.bearers.satellite import judge_factory_address
from atlantis_netcfg.core.verdicts import Verdict
from atlantis_netcfg.operations.links._own import Own, Silent, unheard

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from ipaddress import IPv4Network

    from atlantis_netcfg.bearers.policy import Way
    from atlantis_netcfg.operations.links._router import Echo, Port, RouterReading

__all__ = ["Seen", "ranked", "told", "twice"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """Everything that one look has brought of one bearer."""

    way: Way
    router: RouterReading | Silent | None
    """None: it was not to be asked."""
    own: Own
    active: bool | None
    month_bytes: int | None = None
    box: str | None = None
    """The device of the declaration at this end, if there is one."""
    next_hop: str | None = None
    network: IPv4Network | None = None
    """Of the link."""
    powered: str | None = None
    """The router's PoE port that feeds the box, if one does."""

    @property
    def reading(self) -> RouterReading | None:
        """What the router said, if it did."""
        return self.router if not isinstance(self.router, Silent) else None

    @property
    def port(self) -> Port | None:
        """The interface that the bearer is on."""
        reading = self.reading
        return None if reading is None or self.way.port is None else (reading.ports or {}).get(self.way.port)

    @property
    def strangers(self) -> tuple[str, ...]:
        """Addresses outside the link's network that have answered ARP on its port."""
        reading, network = self.reading, self.network
        if reading is None or reading.neighbours is None or network is None:
            return ()
        there = (one.address for one in reading.neighbours.get(self.way.port or "", ()))
        return tuple(address for address in there if IPv4Address(address) not in network)

    @property
    def echoes(self) -> tuple[Echo, ...]:
        """How its canaries answered."""
        reading = self.reading
        return () if reading is None else (reading.echoes or {}).get(self.way.name, ())

    @property
    def answers(self) -> bool | None:
        """Whether somebody answers over it; None: nobody was asked."""
        return any(echo.received for echo in self.echoes) if self.echoes else None

    @property
    def dark(self) -> bool:
        """Whether its port has no link."""
        return self.port is not None and (self.port.running is False or self.port.disabled is True)


def told(seen: Seen) -> BearerStatus:
    """Reduce it to a status."""
    return BearerStatus(
        name=seen.way.name,
        kind=seen.way.kind,
        state=_state(seen),
        active=seen.active,
        metered=seen.way.metered,
        quality=_quality(seen),
        month_bytes=seen.month_bytes,
        findings=tuple(_findings(seen)),
    )


def _state(seen: Seen) -> LinkState:
    if seen.dark:
        return LinkState.DOWN
    if seen.answers is not None:
        waiting = seen.own.state is LinkState.SEARCHING
        return LinkState.UP if seen.answers else LinkState.SEARCHING if waiting else LinkState.DOWN
    return seen.own.state or LinkState.UNKNOWN


def _quality(seen: Seen) -> Quality:
    port, echoes = seen.port, seen.echoes
    sent = sum(echo.sent for echo in echoes)
    times = [echo.rtt_ms for echo in echoes if echo.rtt_ms is not None]
    lost = sent - sum(echo.received for echo in echoes)
    found: Quality = {
        "port": seen.way.port,
        "port_link": None if port is None or port.running is None else "up" if not seen.dark else "down",
        "rtt_ms": round(min(times), 1) if times else None,
        "loss_percent": round(100 * lost / sent) if sent else None,
    }
    return found | seen.own.quality


def _findings(seen: Seen) -> Iterator[Finding]:
    if isinstance(seen.router, Silent):
        message = f"the router cannot be read, so nobody knows whether this link works: {seen.router.message}"
        yield Finding(Verdict.INCONCLUSIVE, "router-unreachable", message, seen.router.hint)
    yield from _of_port(seen)
    yield from _of_strangers(seen)
    own = tuple(_believed(seen))
    yield from own
    yield from unheard(seen.own.silent, answers=False if seen.dark else seen.answers)
    if not seen.dark:
        yield from _of_canaries(seen, explained=any(one.verdict is Verdict.FAIL for one in own))


def _believed(seen: Seen) -> Iterator[Finding]:
    """A unit that shows no address has one all the same if canaries answer over it."""
    for finding in seen.own.findings:
        if finding.code != "no-address" or not seen.answers:
            yield finding


def _of_port(seen: Seen) -> Iterator[Finding]:
    name, port = seen.way.port, seen.port
    reading = seen.reading
    if reading is not None and reading.ports is not None and port is None:
        hint = "compare `ports` in the router's host_vars with the box"
        yield Finding(Verdict.FAIL, "port-missing", f"the router has no port {name}", hint)
    elif reading is not None and (called := reading.renamed.get(name or "")) is not None:
        hint = "run the site: ports get their names back, and what is declared for a port comes to its socket"
        message = f"port {name} of the router is called {called} there: what the router does by names is elsewhere"
        yield Finding(Verdict.FAIL, "port-renamed", message, hint)
    elif port is not None and port.disabled:
        hint = "run the site to enable it, or look who has disabled it"
        yield Finding(Verdict.FAIL, "port-disabled", f"port {name} of the router is switched off", hint)
    elif port is not None and port.running is False:
        fed = f" from PoE of {seen.powered}" if seen.powered else ""
        hint = f"is the cable plugged in at both ends, and has the box power{fed}?"
        yield Finding(Verdict.FAIL, "port-down", f"port {name} of the router has no link", hint)


def _of_strangers(seen: Seen) -> Iterator[Finding]:
    """A box that answers on its port from another network is one as its factory made it (devices.md, section 3)."""
    reading = seen.reading
    if seen.box is None or seen.next_hop is None or reading is None or reading.neighbours is None:
        return
    answers = seen.next_hop in {one.address for one in reading.neighbours.get(seen.way.port or "", ())}
    for stranger in seen.strangers:
        yield from judge_factory_address(
            seen.box, seen.way.port or "", seen.next_hop, answers=answers, answers_at_factory=stranger
        )


def _of_canaries(seen: Seen, *, explained: bool) -> Iterator[Finding]:
    """Say which canaries are silent; a link that is down is told once, by whoever knows why."""
    silent = [echo.target for echo in seen.echoes if not echo.received]
    if seen.answers is False and not explained:
        message = f"no canary answers over this link ({', '.join(silent)})"
        waits = seen.own.state is LinkState.UP
        hint = (
            "its own box is connected: look beyond it, at the far router or the provider"
            if waits
            else "look at the box of this link, then at what is beyond it"
        )
        yield Finding(Verdict.FAIL, "canaries-silent", message, hint)
    elif seen.answers and silent:
        message = f"{', '.join(silent)} does not answer over this link, the others do"
        hint = "one canary alone proves the link; if it stays silent, declare another one in `canaries`"
        yield Finding(Verdict.WARN, "canary-silent", message, hint)
    elif seen.answers and any(echo.received < echo.sent for echo in seen.echoes):
        sent, received = sum(echo.sent for echo in seen.echoes), sum(echo.received for echo in seen.echoes)
        message = f"{sent - received} of {sent} pings were lost"
        yield Finding(Verdict.WARN, "loss", message, "look again; a link that keeps losing packets is about to fail")


def twice(seen: Sequence[Seen]) -> tuple[tuple[str, Finding], ...]:
    """Name boxes that have one address on two ports, most often the factory's, by bearer."""
    ports: dict[str, list[Seen]] = {}
    for one in seen:
        for stranger in one.strangers:
            ports.setdefault(stranger, []).append(one)
    return tuple(
        (one.way.name, _twice(address, many)) for address, many in ports.items() if len(many) > 1 for one in many
    )


def _twice(address: str, many: Sequence[Seen]) -> Finding:
    where = " and ".join(f"{one.way.port} ({one.way.name})" for one in many)
    message = f"{address} answers on {where}: two boxes with one address, of which the router can reach one only"
    return Finding(Verdict.FAIL, "address-twice", message, "give each box the address that is declared for it")


def ranked(statuses: Sequence[BearerStatus], fail_back_s: int) -> tuple[BearerStatus, ...]:
    """Say of each what follows from the order of preference; `statuses` stand in that order."""
    if any(status.active is None for status in statuses):
        return tuple(statuses)
    active = [status.name for status in statuses if status.active]
    if not active:
        first, *others = statuses
        message = "no default route leads over any link: nothing leaves the site"
        hint = "a router that was never configured has none: run the site; else see what is said of each link"
        return (_with(first, Finding(Verdict.FAIL, "no-way-out", message, hint)), *others)
    place = min(number for number, status in enumerate(statuses) if status.active)
    return tuple(_ranked(status, number, place, statuses, fail_back_s) for number, status in enumerate(statuses))


def _ranked(
    status: BearerStatus, number: int, place: int, statuses: Sequence[BearerStatus], fail_back_s: int
) -> BearerStatus:
    if number < place and status.state is LinkState.UP:
        message = f"it answers, but {statuses[place].name} carries the traffic"
        hint = f"it is taken again when it has answered for {fail_back_s} s without a break: look again after that"
        return _with(status, Finding(Verdict.WARN, "not-taken-yet", message, hint))
    if number and status.active:
        paid = ", and every byte is paid" if status.metered else ""
        message = f"it carries the traffic in place of {statuses[0].name}{paid}"
        return _with(status, Finding(Verdict.WARN, "in-place-of-a-better-one", message, f"repair {statuses[0].name}"))
    return status


def _with(status: BearerStatus, finding: Finding) -> BearerStatus:
    return replace(status, findings=(*status.findings, finding))
