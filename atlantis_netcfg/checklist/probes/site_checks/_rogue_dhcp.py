"""Nobody but the router hands out addresses on the LAN (a vehicle's own server stole leases: BlueOS 3143, 4328)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.requests import Place, Probing
from atlantis_netcfg.checklist.probes.site_checks._site import OwnSite, ask, by_hand, run, step
from atlantis_netcfg.checklist.probes.site_checks.findings import fail, good, measured, unknown
from atlantis_netcfg.checklist.probes.site_checks.parse import neighbours, offers, rows, yes
from atlantis_netcfg.checklist.probes.step import Judged
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.checklist.probes.requests import Question
    from atlantis_netcfg.checklist.probes.results import Answer, Offer
    from atlantis_netcfg.checklist.probes.step import Step

__all__ = ["of"]

_HINT = "unplug it, or switch its DHCP server off: a robot that takes its lease is lost to the site"


def of(site: OwnSite) -> Step:
    """The router is asked for alerts, and the LAN for offers."""
    title = "No other DHCP server on the LAN"
    if site.gateway is None:
        return by_hand(
            "rogue-dhcp",
            title,
            f"Ask the LAN of {site.name} for DHCP offers, as with `sudo nmap --script broadcast-dhcp-discover` on a"
            " computer in it: the site has no gateway computer that a program could ask from.",
            f"Only the router offers an address: {site.declared.lan.gateway}.",
            site.hosts,
        )
    return step("rogue-dhcp", title, _RogueDhcp(site), site.hosts)


@dataclass(frozen=True, slots=True)
class _RogueDhcp:
    """No other DHCP server on the LAN."""

    site: OwnSite

    def asks(self) -> tuple[Question, ...]:
        assert self.site.gateway is not None  # noqa: S101 - the step is skipped without one
        cards = tuple(reservation.mac for reservation in self.site.declared.lan.reservations)
        return (
            Probing("offers", Place.GATEWAY, self.site.gateway.interface, cards=cards),
            *run("router", self.site, f"ip -j neigh show to {self.site.declared.lan.gateway}"),
            *ask("alerts", self.site, "/ip/dhcp-server/alert", "interface", "unknown-server", "disabled"),
        )

    def judge(self, results: Mapping[str, Answer]) -> Judged:
        assert self.site.gateway is not None  # noqa: S101 - the step is skipped without one
        found = offers(results["offers"], self.site.gateway.name)
        alerts = tuple(self._alerts(results))
        if isinstance(found, Finding):
            return Judged((*alerts, found))
        each = {(offer.server, offer.mac): offer for offer in found}.values()
        evidence = tuple(measured(f"DHCP offer of {item.server}", _told(item)) for item in each)
        judged = tuple(
            finding
            for finding in self._judged(found, self._card(results))
            if not alerts or finding.verdict is not Verdict.PASS
        )
        return Judged((*alerts, *judged), evidence)

    def _alerts(self, results: Mapping[str, Answer]) -> Iterator[Finding]:
        """Rows are there only where somebody has made some; that a router does not tell is no finding then."""
        if self.site.router is None or "alerts" not in results:
            return
        result = rows(results["alerts"], self.site.router.name, "its DHCP alerts", "interface")
        for row in () if isinstance(result, Finding) else result:
            server = row.get("unknown-server", "")
            if server and not yes(row, "disabled"):
                place = row.get("interface", "its LAN")
                yield fail("dhcp-alert", f"the router has seen another DHCP server on {place}: {server}", _HINT)

    def _card(self, results: Mapping[str, Answer]) -> str | None:
        """Which card the gateway computer knows the router by; that it has not spoken to it lately proves nothing."""
        result = neighbours(results["router"], "")
        local = str(self.site.declared.lan.gateway)
        return (
            None
            if isinstance(result, Finding)
            else next((neighbour.mac for neighbour in result if neighbour.address == local), None)
        )

    def _judged(self, found: tuple[Offer, ...], known: str | None) -> Iterator[Finding]:
        local = str(self.site.declared.lan.gateway)
        strangers = {(item.server, item.mac): item for item in found if item.server != local}
        cards = sorted({offer.mac for offer in found if offer.server == local and offer.mac is not None})
        strange = [card for card in cards if known not in {None, card}]
        for stranger in strangers.values():
            yield fail(
                "rogue-dhcp", f"{self._named(stranger)} hands out addresses on the LAN, too: {_told(stranger)}", _HINT
            )
        if len(cards) > 1:
            message = f"two cards hand out addresses as the router {local}: {cards[0]} and {cards[1]}"
            yield fail("router-twice", message, "one of them is not the router: find it by its card, and unplug it")
        elif strange:
            message = f"{strange[0]} hands out addresses as the router {local}, whose card is {known}"
            yield fail("not-the-router", message, "find it by its card, and unplug it")
        if not found:
            hint = "is the gateway computer in the LAN, and does `/ip/dhcp-server print` of the router show no flag?"
            yield unknown("nobody-offers", f"nobody answered a DHCP request, not even the router {local}", hint)
        elif not strangers and not strange and len(cards) < 2:  # noqa: PLR2004 - two are one too many
            requested = 2 + len(self.site.declared.lan.reservations)
            yield good(
                "only-the-router", f"the router {local} alone offers an address, to whichever of {requested} cards asks"
            )

    def _named(self, offer: Offer) -> str:
        cards = {card.mac.lower(): card.name for card in self.site.declared.lan.reservations}
        whose = cards.get((offer.mac or "").lower())
        card = offer.mac or "card unknown"
        return f"{offer.server} ({card}{f', the card of {whose}' if whose else ''})"


def _told(offer: Offer) -> str:
    gateway = f" with gateway {offer.router}" if offer.router else ""
    return f"it offered {offer.address}{gateway}"
