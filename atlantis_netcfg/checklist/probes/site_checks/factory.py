"""No host uses a factory address or factory name (BlueBoats all ship with 192.168.2.2)."""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import IPv4Address
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.checklist.probes.site_checks import parse
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.links import LinkFinding
from atlantis_netcfg.links.status import Query

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence


FACTORY: Mapping[str, str] = {
    "192.168.88.1": "MikroTik's factory address",
    "192.168.1.1": "the factory address of satellite terminals, Teltonika and many others",
    "192.168.2.2": "the factory address of Blue Robotics vehicles",
    "192.168.2.1": "the factory address of Blue Robotics top sides and many routers",
    "192.168.0.1": "the factory address of many routers and access points",
}
_NAME = "MikroTik"
"""`/system/identity` of a RouterOS device that was never named."""


def factory_defaults_check(site: parse.OwnSite) -> base.Step:
    """Return the step: hosts seen at such addresses, and those that respond to one ARP request on the LAN."""
    return parse.step("factory-defaults", "No device is left on factory settings", _Factory(site), site.hosts)


@dataclass(frozen=True, slots=True)
class _Factory:
    """Check that no device is left on factory settings."""

    site: parse.OwnSite

    def asks(self) -> tuple[base.Question, ...]:
        arp = ("address", "mac-address", "interface", "complete", "disabled", "invalid")
        return (
            *parse.ask("arp", self.site, "/ip/arp", *arp),
            *parse.ask(
                "names", self.site, "/ip/neighbor", "address", "mac-address", "identity", "interface", "platform"
            ),
            *parse.run("neighbours", self.site, "ip -j neigh show"),
            *(self._ping(address) for address in self._addresses),
        )

    def _ping(self, address: str) -> base.RouterOsQuery:
        """Return an ARP ping: it needs no route, finds hosts with an address of another network, and disturbs none."""
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        assert self.site.view is not None  # noqa: S101 - the same
        words = (("address", address), ("arp-ping", "yes"), ("interface", self.site.view.bridge), ("count", "2"))
        return base.RouterOsQuery(f"ping {address}", self.site.router.name, Query("/tool", "ping", words))

    @property
    def _addresses(self) -> tuple[str, ...]:
        """Factory addresses that the inventory does not use, and that lie in none of its networks."""
        site = self.site.site_config
        networks = [site.lan.network, site.management.network, *(link.network for link in site.bearers)]
        return tuple(item for item in FACTORY if not any(IPv4Address(item) in network for network in networks))

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        router = self.site.router.name
        result = [parse.neighbours(results["arp"], router)]
        if self.site.gateway is not None:
            result.append(parse.neighbours(results["neighbours"], self.site.gateway.name))
        names = parse.rows(results["names"], router, "its neighbours", "mac-address")
        neighbour_places = {
            (neighbour.address, neighbour.mac): neighbour.interface
            for part in result
            if not isinstance(part, LinkFinding)
            for neighbour in part
        }
        pings = {
            address: parse.rows(results[f"ping {address}"], router, "the responses to its ARP requests", "sent")
            for address in self._addresses
        }
        answering_addresses = [
            entry for entry, told_of in pings.items() if not isinstance(told_of, LinkFinding) and _has_answers(told_of)
        ]
        wrong = [
            *self._check_factory_addresses(neighbour_places, answering_addresses),
            *_check_names(self.site.name, () if isinstance(names, LinkFinding) else names),
        ]
        ping_problems = (
            []
            if all(map(_was_sent, pings.values()))
            else [parse.unreadable(router, "the responses to its ARP requests")]
        )
        silence = [part for part in (*result, names, *pings.values(), *ping_problems) if isinstance(part, LinkFinding)]
        evidence = (
            *(parse.measured_evidence(msg(f"{arg(item)}, queried by ARP"), "answers") for item in answering_addresses),
            *(
                parse.read(msg(f"{arg(address)} on {arg(place)}"), mac)
                for (address, mac), place in neighbour_places.items()
                if address in FACTORY
            ),
        )
        told_of = msg(f"nothing in the LAN responds at {arg(parse.join_words(self._addresses))}")
        return base.ProbeResult(
            tuple(dict.fromkeys((*wrong, *silence))) or (parse.good("nobody-on-factory-settings", told_of),), evidence
        )

    def _check_factory_addresses(
        self, neighbour_places: Mapping[tuple[str, str], str], answering_addresses: list[str]
    ) -> Iterator[LinkFinding]:
        for address in self._addresses:
            there = next(((mac, place) for (item, mac), place in neighbour_places.items() if item == address), None)
            if there is None and address not in answering_addresses:
                continue
            who = msg(f"{arg(there[0])} on {arg(there[1])}" if there else "a device in the LAN")
            message = msg(f"{arg(who)} responds at {arg(address)}, {arg(FACTORY[address])}")
            yield parse.fail(
                "factory-address", message, "give that device its address from the inventory, or unplug it"
            )


def _has_answers(result: Sequence[Mapping[str, str]]) -> bool:
    return any(row.get("received", "0") not in {"", "0"} for row in result)


def _was_sent(result: Sequence[Mapping[str, str]] | LinkFinding) -> bool:
    """Return whether a ping was sent; a failed request counts as sent, as it has its own finding."""
    return isinstance(result, LinkFinding) or any(row.get("sent", "0") not in {"", "0"} for row in result)


def _check_names(site: str, names: tuple[Mapping[str, str], ...]) -> Iterator[LinkFinding]:
    for row in names:
        if row.get("identity") == _NAME:
            where = row.get("address") or row.get("mac-address", "?")
            message = msg(
                f"the RouterOS device {arg(where)} on {arg(row.get('interface', '?'))} still has its factory name"
            )
            yield parse.warn(
                "factory-name",
                message,
                msg(
                    f"`provision device adopt site={arg(site)} device=NAME` gives a new device its name, user and "
                    "certificate"
                ),
            )
