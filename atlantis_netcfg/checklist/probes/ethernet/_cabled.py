"""A computer on the site's cable: it answers, it is the one that is declared, and its port at the router is well."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes import _path, _ping
from atlantis_netcfg.checklist.probes.ethernet import _port
from atlantis_netcfg.checklist.probes.evidence import read
from atlantis_netcfg.checklist.probes.not_run import PLACES, not_run
from atlantis_netcfg.checklist.probes.requests import Place
from atlantis_netcfg.checklist.probes.step import Judged
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.checklist.probes.requests import Question
    from atlantis_netcfg.checklist.probes.results import Answer
    from atlantis_netcfg.declaration.model import EthernetEndpoint

__all__ = ["FAIL_LOSS_PERCENT", "CabledProbe"]

FAIL_LOSS_PERCENT = 10.0
"""A cable loses nothing; what loses so much is broken: our own judgement. In between it warns."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CabledProbe:
    """The vehicle answers on the cable, from the network card that is declared, and its port counts no errors.

    Asked on the gateway (or the laptop): `ip -j route get ADDRESS`, `ping -n -c 20 -i 0.2 -W 2 ADDRESS`, and after it
    `ip -j neigh show to ADDRESS`. Asked of the router, where a port is declared: `/interface/ethernet/monitor
    numbers=PORT once=`, `/interface/print`.
    """

    name: str
    place: Place
    endpoint: EthernetEndpoint
    address: str | None
    mac: str | None
    """Upper case; None: nobody has declared it."""
    router: str | None
    """Whose port is looked at; None: no port is declared."""

    def asks(self) -> tuple[Question, ...]:
        """Give the ping with the way and the card behind it, and the router's port."""
        port = self.endpoint.router_port
        ports = () if self.router is None or port is None else _port.asks(self.router, port)
        if self.address is None:
            return ports
        way, ping = _path.ask_way(self.place, self.address), _ping.ask(self.place, self.address)
        return (way, ping, _path.ask_neighbour(self.place, self.address), *ports)

    def judge(self, results: Mapping[str, Answer]) -> Judged:
        """Judge the port, the ping and the card, in this order: a port without a link explains the rest."""
        port = self.endpoint.router_port
        seen = Judged(()) if self.router is None or port is None else _port.judge(self.router, port, results)
        reached = self._reached(results)
        return Judged((*seen.findings, *reached.findings), (*reached.evidence, *seen.evidence))

    def _reached(self, results: Mapping[str, Answer]) -> Judged:
        if self.address is None:
            message = f"no address of {self.name} is known here: it was not asked whether it answers"
            hint = "reserve one in `site.lan.reservations`, or write `endpoints.ethernet.address`"
            return Judged((Finding(Verdict.INCONCLUSIVE, "no-address", message, hint),))
        way = _path.read_way(results.get("route"), self.address)
        if way is None and not tuple(not_run(self.place, "ip", results.get("route"))):
            message = f"{PLACES[self.place]} has no route to {self.name} ({self.address})"
            hint = "is its cable plugged in, and has it an address of the site's LAN? On it: ip -br addr"
            return Judged((Finding(Verdict.FAIL, "no-route", message, hint),))
        if local := tuple(_path.own_address(self.place, self.name, self.address, way)):
            return Judged(local)
        expected = _ping.Pinged(self.name, self.address, self.place, self.endpoint.loss_percent, FAIL_LOSS_PERCENT)
        pinged = _ping.judge(expected, results.get("ping"))
        card = _path.read_neighbour(results.get("neigh"), self.address)
        shown = () if way is None else (read(f"way from {PLACES[self.place]}", way.interface),)
        known = () if card is None else (read(f"network card that answers for {self.address}", card),)
        whose = tuple(self._cards(card, way)) if pinged.verdict in {Verdict.PASS, Verdict.WARN} else ()
        return Judged((*pinged.findings, *whose), (*pinged.evidence, *shown, *known))

    def _cards(self, card: str | None, way: _path.Way | None) -> Iterator[Finding]:
        """Say whose card has answered; on the segment somebody has, and behind a router nobody can see it."""
        if self.place is Place.GATEWAY and way is not None and way.by is not None:
            message = f"packets to {self.name} ({self.address}) leave by way of {way.by}: it is not on the site's cable"
            hint = "plug it into a port of the site's LAN, with an address of the LAN; or correct `endpoints.ethernet`"
            yield Finding(Verdict.FAIL, "not-on-the-cable", message, hint)
        elif self.mac is None:
            message = f"nothing tells whether it is {self.name} that answers at {self.address}"
            hint = "declare `endpoints.ethernet.mac`, or reserve its address in `site.lan.reservations`"
            yield Finding(Verdict.WARN, "whose-unknown", message, hint)
        elif card is None:
            message = f"{PLACES[self.place]} does not tell which network card answers for {self.address}"
            hint = "ask from a computer in the site's LAN, or unplug the cable and see that the pings end"
            yield Finding(Verdict.INCONCLUSIVE, "card-unseen", message, hint)
        elif card != self.mac:
            message = f"{card} answers for {self.address}, and the network card of {self.name} is {self.mac}"
            hint = "two devices have this address, or the card was exchanged: unplug it and ping again"
            yield Finding(Verdict.FAIL, "other-card", message, hint)
