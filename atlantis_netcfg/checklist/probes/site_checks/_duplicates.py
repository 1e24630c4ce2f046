"""An address of the LAN is answered by one card, and a reserved one by the card that it is reserved for."""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import IPv4Address
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.site_checks._site import OwnSite, ask, run, step
from atlantis_netcfg.checklist.probes.site_checks.findings import fail, good, listed, read, unknown, warn
from atlantis_netcfg.checklist.probes.site_checks.parse import Neighbour, neighbours, rows
from atlantis_netcfg.checklist.probes.step import Judged

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from atlantis_netcfg.checklist.probes.requests import Question
    from atlantis_netcfg.checklist.probes.results import Answer
    from atlantis_netcfg.checklist.probes.step import Step

__all__ = ["of"]

_HINT = "switch one of them off, and give it another address or a reservation of its own"


def of(site: OwnSite) -> Step:
    """The router's ARP and leases, and what the gateway computer has seen."""
    return step("duplicate-addresses", "No address of the LAN twice", _Duplicates(site), site.hosts)


@dataclass(frozen=True, slots=True)
class _Duplicates:
    """No address of the LAN twice."""

    site: OwnSite

    def asks(self) -> tuple[Question, ...]:
        arp = ("address", "mac-address", "interface", "complete", "status", "disabled", "invalid")
        return (
            *ask("arp", self.site, "/ip/arp", *arp),
            *ask("leases", self.site, "/ip/dhcp-server/lease", "address", "mac-address", "status", "disabled"),
            *run("neighbours", self.site, "ip -j neigh show"),
        )

    def judge(self, results: Mapping[str, Answer]) -> Judged:
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        router = self.site.router.name
        result = [neighbours(results["arp"], router)]
        if self.site.gateway is not None:
            result.append(neighbours(results["neighbours"], self.site.gateway.name))
        leases = rows(results["leases"], router, "its leases", "address")
        seen = [item for part in result if not isinstance(part, Finding) for item in part if self._in_lan(item)]
        silence = [part for part in (*result, leases) if isinstance(part, Finding)]
        wrong = [*self._twice(seen), *self._wrong(seen), *self._busy(() if isinstance(leases, Finding) else leases)]
        evidence = tuple(read(f"{neighbour.address}, seen by {neighbour.seen_by}", neighbour.mac) for neighbour in seen)
        return Judged(tuple(dict.fromkeys((*wrong, *silence))) or (self._fine(seen),), evidence)

    def _in_lan(self, neighbour: Neighbour) -> bool:
        return IPv4Address(neighbour.address) in self.site.declared.lan.network

    def _twice(self, seen: Sequence[Neighbour]) -> Iterator[Finding]:
        cards: dict[str, dict[str, Neighbour]] = {}
        for one in sorted(seen, key=lambda entry: not entry.fresh):
            cards.setdefault(one.address, {}).setdefault(one.mac, one)
        for address, macs in cards.items():
            text = listed(f"{mac} (seen by {item.seen_by})" for mac, item in macs.items())
            if len(macs) > 1 and all(neighbour.fresh for neighbour in macs.values()):
                yield fail("address-twice", f"{address} is answered by two cards: {text}", _HINT)
            elif len(macs) > 1:
                message = f"{address} was answered by another card some time ago: {text}"
                yield warn(
                    "address-changed", message, "repeat the check in some minutes: if it stays so, find the other one"
                )

    def _wrong(self, seen: Sequence[Neighbour]) -> Iterator[Finding]:
        lan = self.site.declared.lan
        by_address = {str(one.address): one for one in lan.reservations}
        by_card = {reservation.mac.lower(): reservation for reservation in lan.reservations}
        now = {entry.address for entry in seen if entry.fresh}
        current = [item for item in seen if item.fresh or item.address not in now]
        for one in {(neighbour.address, neighbour.mac): neighbour for neighbour in current}.values():
            reserved, owner = by_address.get(one.address), by_card.get(one.mac)
            if reserved is not None and reserved.mac.lower() != one.mac:
                there = f"{one.mac}{f', the card of {owner.name},' if owner else ''}"
                message = f"{one.address} is reserved for {reserved.name}, but {there} answers there"
                hint = f"correct `mac:` of {reserved.name} if its card is a new one; else find who took its address"
                yield fail("wrong-card", message, hint)
            elif reserved is None and owner is not None:
                message = f"{owner.name} has the address {one.address}, not its reserved {owner.address}"
                hint = f"set {owner.name} to DHCP and let it ask anew: others look for it at {owner.address}"
                yield fail("wrong-address", message, hint)

    def _busy(self, leases: Sequence[Mapping[str, str]]) -> Iterator[Finding]:
        """RouterOS' `busy`: somebody answered at an address that was to be handed out (Manual, DHCP)."""
        for row in leases:
            if row.get("status") == "busy":
                message = f"the router does not hand out {row.get('address', '?')}: somebody else answers there"
                yield warn("lease-busy", message, "find who has set that address by hand, and set it to DHCP")

    def _fine(self, seen: Sequence[Neighbour]) -> Finding:
        count = len({neighbour.address for neighbour in seen})
        if not count:
            hint = "switch the robots on and repeat the check: only who has been spoken to lately is seen"
            return unknown("nobody-seen", "neither router nor gateway computer has seen anybody in the LAN", hint)
        are = "1 address of the LAN is" if count == 1 else f"{count} addresses of the LAN are each"
        return good("each-once", f"{are} answered by one card, as reserved")
