"""Ethernet: a vehicle or its operator's computer on the site's cable, and a location's cables; our own column.

The ROV joins through its HMI computer, by cable (report 2.2.2). Hosts measure loss and round trip between them, the
network card that responds is compared with the inventory, and the router's port reports link, rate and errors.

Menus: `/interface/ethernet/monitor` (`status: link-ok`, `rate: 1Gbps`, `full-duplex: yes`) and the counters of
`/interface/print` (`rx-error`, `tx-error`, since the router was started). Manual, Ethernet and Interface.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist import report
from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.checklist.probes.link_probe import link_steps, reserved_mac
from atlantis_netcfg.checklist.probes.ping import (
    NeighbourPing,
    NeighbourRoute,
    judge_ping,
    neighbour_request,
    own_address,
    ping_request,
    read_neighbour,
    read_route,
    route_request,
)
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory.model import ETHERNET, EthernetEndpoint
from atlantis_netcfg.links import LinkFinding
from atlantis_netcfg.links.status import Query

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping


_COUNTERS = ("name", "default-name", "running", "disabled", "rx-error", "tx-error", "link-downs")
_TRUE = frozenset({"true", "yes"})
_SLOW = frozenset({"10Mbps"})
"""Link rates that a cable with a broken pair, or an end set by hand, falls back to."""
_PORT_VALUES = (("rate", msg("rate")), ("full-duplex", "full duplex"), ("rx-error", "receive errors"))
_MORE = (("tx-error", "transmit errors"), ("link-downs", "link losses"))


def port_requests(router: str, port: str) -> tuple[base.RouterOsQuery, ...]:
    """Return the requests about a port."""
    return (
        base.RouterOsQuery(
            "monitor", router, Query("/interface/ethernet", "monitor", (("numbers", port), ("once", "")))
        ),
        base.RouterOsQuery("interfaces", router, Query("/interface", "print", (), _COUNTERS)),
    )


def judge_port(router: str, port: str, results: Mapping[str, base.Answer]) -> base.ProbeResult:
    """Judge the port; a menu that the router does not have is left out."""
    answers = [results.get(name) for name in ("monitor", "interfaces")]
    if all(not isinstance(answer, base.Rows) or answer.trouble is not None for answer in answers):
        return base.ProbeResult((base.no_answer_finding(router, answers[0]),))
    monitor, interfaces = (base.rows_of(result) for result in answers)
    interface = None if interfaces is None else next((row for row in interfaces if row.get("name") == port), None)
    socket = next((row for row in interfaces or () if row.get("default-name") == port), None)
    if (socket or {}).get("name", port) != port or (interface or {}).get("default-name", port) != port:
        problem = msg(f"is named {arg(socket['name'])} there" if socket is not None else "is another socket there")
        message = msg(
            f"port {arg(port)} of {arg(router)} {arg(problem)}, so the values under that name are not about it"
        )
        hint = "apply the site's configuration, which restores the port names"
        return base.ProbeResult((LinkFinding(Verdict.FAIL, "port-renamed", message, hint),))
    if interfaces is not None and interface is None:
        message = msg(f"{arg(router)} has no port {arg(port)}")
        hint = "correct `endpoints.ethernet.router_port`: use the router's own port name"
        return base.ProbeResult((LinkFinding(Verdict.FAIL, "no-port", message, hint),))
    local = [row for row in monitor or () if row.get("name", port) == port]
    values = {**(interface or {}), **(local[0] if local else {})}
    return base.ProbeResult(tuple(_findings(router, port, values)), _evidence(router, port, values))


def _findings(router: str, port: str, values: Mapping[str, str]) -> Iterator[LinkFinding]:
    if values.get("disabled") in _TRUE:
        hint = "apply the site's configuration to enable it, or find out who disabled it"
        yield LinkFinding(Verdict.FAIL, "port-disabled", msg(f"port {arg(port)} of {arg(router)} is disabled"), hint)
        return
    status = values.get("status") or {"true": "link-ok", "false": "no-link"}.get(values.get("running", ""), "")
    if status == "no-link":
        hint = "check that the cable is plugged in at both ends and that the other end is switched on"
        yield LinkFinding(Verdict.FAIL, "port-down", msg(f"port {arg(port)} of {arg(router)} has no link"), hint)
        return
    if status != "link-ok":
        text = f"`{status}`" if status else "nothing"
        message = msg(f"{arg(router)} reports {arg(text)} for the link of port {arg(port)}")
        yield LinkFinding(Verdict.INCONCLUSIVE, "port-unknown", message, "check the LEDs of the port")
        return
    rate = values.get("rate")
    yield LinkFinding(
        Verdict.PASS, "link", msg(f"port {arg(port)} of {arg(router)} has a link{f' of {arg(rate)}' if rate else ''}")
    )
    yield from _quality(router, port, values)


def _quality(router: str, port: str, values: Mapping[str, str]) -> Iterator[LinkFinding]:
    hint = "replace the cable, and set both ends to auto-negotiation"
    if values.get("rate") in _SLOW:
        yield LinkFinding(
            Verdict.WARN, "rate-low", msg(f"port {arg(port)} of {arg(router)} runs at only {arg(values['rate'])}"), hint
        )
    if values.get("full-duplex") in {"false", "no"}:
        yield LinkFinding(
            Verdict.WARN, "half-duplex", msg(f"port {arg(port)} of {arg(router)} runs in half duplex"), hint
        )
    for name, words in (("rx-error", "received with errors"), ("tx-error", "not sent")):
        count = values.get(name, "")
        if count.isdecimal() and int(count):
            message = msg(
                f"port {arg(port)} of {arg(router)} has counted {arg(count)} frames {arg(words)} since it started"
            )
            yield LinkFinding(
                Verdict.WARN, f"{name}s", message, "replace the cable, then check whether the number grows"
            )


def _evidence(router: str, port: str, values: Mapping[str, str]) -> tuple[report.Evidence, ...]:
    where = msg(f"at port {arg(port)} of {arg(router)}")
    return tuple(
        base.read(join(" ", (words, where)), values[name])
        for name, words in (*_PORT_VALUES, *_MORE)
        if values.get(name)
    )


FAIL_LOSS_PERCENT = 10.0
"""A cable loses nothing; with this loss it is broken (our own judgement). In between, the item warns."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CabledProbe:
    """Check that the vehicle responds on the cable, with the expected network card and no port errors.

    Run on the gateway (or the laptop): `ip -j route get ADDRESS`, `ping -n -c 20 -i 0.2 -W 2 ADDRESS`, and after it `ip
    -j neigh show to ADDRESS`. Read from the router, if the inventory has a port: `/interface/ethernet/monitor
    numbers=PORT once=`, `/interface/print`.
    """

    name: str
    place: base.Place
    endpoint: EthernetEndpoint
    address: str | None
    mac: str | None
    """Upper case; None: not declared."""
    router: str | None
    """Router whose port is checked; None: no port is declared."""

    def asks(self) -> tuple[base.Question, ...]:
        """Return the ping with its route and neighbour entry, and the requests about the router's port."""
        port = self.endpoint.router_port
        ports = () if self.router is None or port is None else port_requests(self.router, port)
        if self.address is None:
            return ports
        way, ping = route_request(self.place, self.address), ping_request(self.place, self.address)
        return (way, ping, neighbour_request(self.place, self.address), *ports)

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        """Judge the port, the ping and the card, in this order: a port without a link explains the rest."""
        port = self.endpoint.router_port
        port_result = (
            base.ProbeResult(()) if self.router is None or port is None else judge_port(self.router, port, results)
        )
        ping_result = self._judge_reachability(results)
        return base.ProbeResult(
            (*port_result.findings, *ping_result.findings), (*ping_result.evidence, *port_result.evidence)
        )

    def _judge_reachability(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        if self.address is None:
            message = msg(f"no address of {arg(self.name)} is known: it was not pinged")
            hint = "reserve one in `site.lan.reservations`, or set `endpoints.ethernet.address`"
            return base.ProbeResult((LinkFinding(Verdict.INCONCLUSIVE, "no-address", message, hint),))
        way = read_route(results.get("route"), self.address)
        if way is None and not tuple(base.not_run(self.place, "ip", results.get("route"))):
            message = msg(f"{arg(base.PLACES[self.place])} has no route to {arg(self.name)} ({arg(self.address)})")
            hint = "check its cable, and that it has an address of the site's LAN; on it: ip -br addr"
            return base.ProbeResult((LinkFinding(Verdict.FAIL, "no-route", message, hint),))
        if local := tuple(own_address(self.place, self.name, self.address, way)):
            return base.ProbeResult(local)
        target = NeighbourPing(self.name, self.address, self.place, self.endpoint.loss_percent, FAIL_LOSS_PERCENT)
        ping_result = judge_ping(target, results.get("ping"))
        card = read_neighbour(results.get("neigh"), self.address)
        route_evidence = (
            () if way is None else (base.read(msg(f"route from {arg(base.PLACES[self.place])}"), way.interface),)
        )
        card_evidence = (
            () if card is None else (base.read(msg(f"network card that responds for {arg(self.address)}"), card),)
        )
        whose = tuple(self._cards(card, way)) if ping_result.verdict in {Verdict.PASS, Verdict.WARN} else ()
        return base.ProbeResult(
            (*ping_result.findings, *whose), (*ping_result.evidence, *route_evidence, *card_evidence)
        )

    def _cards(self, card: str | None, way: NeighbourRoute | None) -> Iterator[LinkFinding]:
        """Yield findings about the network card that responded; behind a router it cannot be seen."""
        if self.place is base.Place.GATEWAY and way is not None and way.by is not None:
            message = msg(
                f"packets to {arg(self.name)} ({arg(self.address)}) leave through {arg(way.by)}: it is not on the "
                "site's cable"
            )
            hint = "connect it to a port of the site's LAN, with an address of the LAN; or correct `endpoints.ethernet`"
            yield LinkFinding(Verdict.FAIL, "not-on-the-cable", message, hint)
        elif self.mac is None:
            message = msg(f"cannot tell whether it is {arg(self.name)} that responds at {arg(self.address)}")
            hint = "set `endpoints.ethernet.mac`, or reserve its address in `site.lan.reservations`"
            yield LinkFinding(Verdict.WARN, "whose-unknown", message, hint)
        elif card is None:
            message = msg(
                f"{arg(base.PLACES[self.place])} does not show which network card responds for {arg(self.address)}"
            )
            hint = "check from a computer in the site's LAN, or unplug the cable and see that the pings stop"
            yield LinkFinding(Verdict.INCONCLUSIVE, "card-unseen", message, hint)
        elif card != self.mac:
            message = msg(
                f"{arg(card)} responds for {arg(self.address)}, but the network card of {arg(self.name)} is "
                f"{arg(self.mac)}"
            )
            hint = "two devices have this address, or the card was replaced: unplug it and ping again"
            yield LinkFinding(Verdict.FAIL, "other-card", message, hint)


def steps(cell: base.Cell) -> tuple[base.Step, ...]:
    """Return the steps for the location's outgoing cables, and for the row's cable if it is in the inventory."""
    links = link_steps(
        cell,
        ETHERNET,
        lambda link: msg(f"Cable {arg(link.name)} of {arg(cell.name)} carries traffic"),
    )
    endpoint = cell.endpoints.ethernet
    if endpoint is not None:
        return (*links, _cable_step(cell, endpoint, "own" if links else ""))
    return links or (_manual_step(cell),)


def _cable_step(cell: base.Cell, endpoint: EthernetEndpoint, name: str) -> base.Step:
    router = cell.router
    seen_by = endpoint.seen_by or (router.name if router is not None else None)
    probe = CabledProbe(
        name=cell.name,
        place=cell.place(endpoint.seen_from),
        endpoint=endpoint,
        address=cell.address(endpoint.address),
        mac=reserved_mac(cell, endpoint.mac),
        router=seen_by if endpoint.router_port is not None else None,
    )
    return base.Step(
        name=name,
        title=msg(f"{arg(cell.name)} responds on the site's cable without loss"),
        kind=report.ItemKind.AUTOMATIC,
        phase=report.Phase.BENCH,
        probe=probe,
        concerns=() if seen_by is None else (seen_by,),
    )


def _manual_step(cell: base.Cell) -> base.Step:
    return base.Step(
        name="",
        title=msg(f"Ethernet of {arg(cell.name)} works"),
        kind=report.ItemKind.PERSON,
        phase=report.Phase.BENCH,
        do=msg(f"Plug {arg(cell.name)} into a LAN port of the site, and ping the gateway from it twenty times."),
        look_for="The LEDs of both ends are lit, and all pings get a response.",
    )
