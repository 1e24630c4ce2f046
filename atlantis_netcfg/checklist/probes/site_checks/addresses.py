"""Addresses of the LAN: as in the inventory, without duplicates, and from a single DHCP server.

Static addresses are present, have the right mask, and will be present after a restart (BlueOS 3370, 3432). No interface
has two addresses of one subnet: a lease that ends removes the shared route (BlueOS 4054). One card responds for an
address, and the reserved card for a reserved one. Only the router runs a DHCP server (a vehicle's own server stole
leases: BlueOS 3143, 4328).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from ipaddress import IPv4Address, IPv4Interface
from itertools import combinations
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.checklist.probes.site_checks import parse
from atlantis_netcfg.computers.parts import computer_network
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.links import LinkFinding

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence


FILES = ("/etc/netplan/10-atlantis.yaml", "/etc/network/interfaces", "/etc/systemd/network/05-atlantis.network")
"""Files in which `provision` configures a gateway computer's address, one for each network configuration tool."""
_LOOPBACK = "lo"
_RUN = "apply the site's configuration, which restores the address of the inventory"


def static_addresses_check(site: parse.OwnSite) -> base.Step:
    """Return the step that compares current addresses with the files read at the next start."""
    return parse.step("static-addresses", "Static addresses survive a restart", _Static(site), site.hosts)


@dataclass(frozen=True, slots=True)
class _Static:
    """Check that static addresses survive a restart."""

    site: parse.OwnSite

    def asks(self) -> tuple[base.Question, ...]:
        return (
            *parse.ask("router", self.site, "/ip/address", "address", "interface", "disabled", "invalid", "dynamic"),
            *parse.ask("sockets", self.site, "/interface/ethernet", "name", "default-name"),
            *parse.run("gateway", self.site, "ip -j addr show"),
            *(question for path in FILES for question in parse.run(path, self.site, f"cat {path}")),
        )

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        current = _on_sockets(results, self.site.router.name)
        findings = (
            [current] if isinstance(current, LinkFinding) else list(self._judge_router(self.site.router.name, current))
        )
        evidence = [
            parse.declared_evidence(msg(f"address of {arg(name)}"), address)
            for name, address in self._declared_addresses()
        ]
        gateway = self.site.gateway
        if gateway is not None:
            local = parse.addresses(results["gateway"], gateway.name)
            findings += [local] if isinstance(local, LinkFinding) else self._judge_gateway(gateway, local, results)
            if not isinstance(local, LinkFinding):
                evidence += [
                    parse.read(msg(f"{arg(item.interface)} of {arg(gateway.name)}"), str(item.address))
                    for item in local
                ]
        return base.ProbeResult(tuple(findings), tuple(evidence))

    def _declared_addresses(self) -> Iterator[tuple[str, str]]:
        """Yield interface and address of everything that the router has in the inventory."""
        view = self.site.view
        assert view is not None  # noqa: S101 - the check is made for sites with a router
        yield view.bridge, view.lan.address
        yield view.management.port, view.management.address
        for link in (*view.uplinks, *view.served_links):
            yield link.port, link.interface_address

    def _judge_router(self, name: str, current: tuple[parse.InterfaceAddress, ...]) -> Iterator[LinkFinding]:
        wrong = list(_find_wrong_addresses(name, tuple(self._declared_addresses()), current))
        yield from wrong
        if not wrong:
            count = len(tuple(self._declared_addresses()))
            yield parse.good(
                "router-as-declared",
                msg(f"{arg(name)} has its {arg(count)} addresses of the inventory, none of them leased"),
            )

    def _judge_gateway(
        self,
        gateway: parse.ComputerReadings,
        local: tuple[parse.InterfaceAddress, ...],
        results: Mapping[str, base.Answer],
    ) -> list[LinkFinding]:
        interface = IPv4Interface(f"{gateway.device.address}/{self.site.site_config.lan.network.prefixlen}")
        there = next((item for item in local if item.address.ip == interface.ip), None)
        wrong = _check_running_address(gateway, interface, there)
        if wrong is not None:
            return [wrong]
        problem = self._in_files(gateway, interface, results)
        fine = parse.good("gateway-as-declared", msg(f"{arg(gateway.name)} has {arg(interface)}, also after a restart"))
        return [problem or fine]

    def _in_files(
        self, gateway: parse.ComputerReadings, interface: IPv4Interface, results: Mapping[str, base.Answer]
    ) -> LinkFinding | None:
        """Return what is wrong with the files read at the next start; None if they match the running state."""
        texts = {path: results[path] for path in FILES}
        trouble = next(
            (
                result
                for result in texts.values()
                if not isinstance(result, base.CommandResult) or result.trouble is not None
            ),
            None,
        )
        if trouble is not None:
            return parse.silent(gateway.name, getattr(trouble, "trouble", None) or base.Trouble.SILENT, trouble.words)
        files = {
            path: answer.out
            for path, answer in texts.items()
            if isinstance(answer, base.CommandResult) and answer.rc == 0
        }
        host = self.site.inventory.hosts[gateway.name]
        network_file = computer_network(self.site.inventory, host)
        if network_file is not None:
            return _check_network_file(
                gateway.name, network_file.path, files.get(network_file.path), network_file.content, interface
            )
        if gateway.is_leased or any(_says(text, interface) for text in files.values()):
            return None
        message = msg(
            f"{arg(gateway.name)} has {arg(interface)}, but no file of this toolkit sets it: it may not survive a "
            "restart"
        )
        hint = msg(
            f"set `network:` of {arg(gateway.name)} and apply the site's configuration, or restart it once and repeat "
            "the check"
        )
        return parse.unknown("no-file", message, hint)


def _on_sockets(results: Mapping[str, base.Answer], router: str) -> tuple[parse.InterfaceAddress, ...] | LinkFinding:
    """Return the router's addresses by the factory name of their port, because port names can be changed."""
    current = parse.addresses(results["router"], router)
    ports = parse.rows(results["sockets"], router, "the names of its ports", "default-name")
    if isinstance(current, LinkFinding):
        return current
    if isinstance(ports, LinkFinding):
        return ports
    socket = {row.get("name", ""): row.get("default-name", "") for row in ports}
    return tuple(replace(item, interface=socket.get(item.interface, item.interface)) for item in current)


def _says(text: str, interface: IPv4Interface) -> bool:
    """Return whether a file sets an address, ignoring comments."""
    lines = (line for line in text.splitlines() if not line.lstrip().startswith("#"))
    return any(str(interface) in line for line in lines)


def _check_network_file(
    name: str, path: str, text: str | None, content: str, interface: IPv4Interface
) -> LinkFinding | None:
    hint = msg(
        f"apply the site with `device={arg(name)}`: it writes {arg(path)} again, with a timer that undoes a mistake"
    )
    if text is None:
        return parse.fail(
            "no-file",
            msg(f"{arg(name)} has {arg(interface)}, but {arg(path)} is missing: the address is lost after a restart"),
            hint,
        )
    if text.strip() != content.strip():
        return parse.fail(
            "file-differs",
            msg(f"{arg(path)} of {arg(name)} differs from the inventory: a restart changes its address"),
            hint,
        )
    return None


def _check_running_address(
    gateway: parse.ComputerReadings, interface: IPv4Interface, there: parse.InterfaceAddress | None
) -> LinkFinding | None:
    if there is None:
        return parse.fail(
            "address-missing",
            msg(f"{arg(gateway.name)} does not have its address {arg(interface)} of the inventory"),
            _RUN,
        )
    if there.interface == _LOOPBACK:
        message = msg(
            f"{arg(gateway.name)} has its address {arg(interface)} on {arg(there.interface)}, where it is unreachable"
        )
        return parse.fail("wrong-interface", message, _RUN)
    if there.address != interface:
        message = msg(
            f"{arg(gateway.name)} has {arg(there.address)}; the mask in the inventory is "
            f"/{arg(interface.network.prefixlen)}"
        )
        return parse.fail("wrong-mask", message, _RUN)
    if there.is_leased and not gateway.is_leased:
        message = msg(
            f"{arg(gateway.name)} has {arg(interface)} by lease, but the inventory says static: it is lost when the "
            "lease ends"
        )
        return parse.fail("address-leased", message, _RUN)
    if gateway.is_leased and not there.is_leased:
        message = msg(f"{arg(gateway.name)} has {arg(interface)} set manually, but the inventory says DHCP")
        return parse.warn(
            "address-by-hand",
            message,
            msg(f"set {arg(gateway.name)} to DHCP, or set `address_by: static` in the inventory"),
        )
    return None


def _find_wrong_addresses(
    name: str, desired_addresses: tuple[tuple[str, str], ...], current: tuple[parse.InterfaceAddress, ...]
) -> Iterator[LinkFinding]:
    for interface, text in desired_addresses:
        address = IPv4Interface(text)
        there = next((item for item in current if item.address.ip == address.ip), None)
        if there is None:
            yield parse.fail(
                "address-missing",
                msg(f"{arg(name)} does not have its address {arg(text)} of the inventory on {arg(interface)}"),
                _RUN,
            )
        elif there.address != address:
            message = msg(
                f"{arg(name)} has {arg(there.address)} on {arg(there.interface)}; the mask in the inventory is"
            )
            yield parse.fail("wrong-mask", f"{message} /{address.network.prefixlen}", _RUN)
        elif there.interface != interface:
            message = msg(
                f"{arg(name)} has its address {arg(text)} on {arg(there.interface)} instead of {arg(interface)}"
            )
            yield parse.fail("wrong-interface", message, _RUN)
        elif there.flags:
            yield parse.fail(
                "address-flagged",
                msg(
                    f"{arg(text)} of {arg(name)} is {arg(parse.join_words(there.flags))}; no address in the inventory "
                    "is"
                ),
                _RUN,
            )


_SUBNET_HINT = "remove one of them: when a lease ends, the route of both goes with it, and contact is lost"


def one_subnet_twice_check(site: parse.OwnSite) -> base.Step:
    """Return the step on the addresses of the router and the gateway computer."""
    return parse.step("one-subnet-twice", "No interface has two addresses of one subnet", _OneSubnet(site), site.hosts)


@dataclass(frozen=True, slots=True)
class _OneSubnet:
    """Check that no interface has two addresses of one subnet."""

    site: parse.OwnSite

    def asks(self) -> tuple[base.Question, ...]:
        return (
            *parse.ask("router", self.site, "/ip/address", "address", "interface", "disabled", "invalid", "dynamic"),
            *parse.run("gateway", self.site, "ip -j addr show"),
        )

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        names = {"router": self.site.router.name}
        if self.site.gateway is not None:
            names["gateway"] = self.site.gateway.name
        values = {name: parse.addresses(results[question], name) for question, name in names.items()}
        current = {name: entries for name, entries in values.items() if not isinstance(entries, LinkFinding)}
        silence = tuple(entries for entries in values.values() if isinstance(entries, LinkFinding))
        wrong = tuple(finding for name, entries in current.items() for finding in _find_shared_subnets(name, entries))
        evidence = tuple(
            parse.read(msg(f"{arg(item.interface)} of {arg(name)}"), _describe_address(item))
            for name, entries in current.items()
            for item in entries
        )
        fine = parse.good(
            "each-subnet-once",
            msg(f"no interface of {arg(parse.join_words(names.values()))} has two addresses of one subnet"),
        )
        return base.ProbeResult((*wrong, *silence) or (fine,), evidence)


def _find_shared_subnets(name: str, entries: tuple[parse.InterfaceAddress, ...]) -> Iterator[LinkFinding]:
    for item, other in combinations([current for current in entries if not current.dead], 2):
        if item.interface == other.interface and item.address.network.overlaps(other.address.network):
            message = msg(
                f"{arg(item.interface)} of {arg(name)} has {arg(_describe_address(item))} and "
                f"{arg(_describe_address(other))}, which are in one subnet"
            )
            yield parse.fail("subnet-twice", message, _SUBNET_HINT)


def _describe_address(item: parse.InterfaceAddress) -> str:
    return msg(f"{arg(item.address)} ({'leased' if item.is_leased else 'static'})")


_DUPLICATE_HINT = "switch one of them off, or give it another address or its own reservation"


def duplicate_addresses_check(site: parse.OwnSite) -> base.Step:
    """Return the step on the router's ARP table and leases, and the gateway computer's neighbours."""
    return parse.step("duplicate-addresses", "No LAN address is used twice", _Duplicates(site), site.hosts)


@dataclass(frozen=True, slots=True)
class _Duplicates:
    """Check that no address of the LAN is used twice."""

    site: parse.OwnSite

    def asks(self) -> tuple[base.Question, ...]:
        arp = ("address", "mac-address", "interface", "complete", "status", "disabled", "invalid")
        return (
            *parse.ask("arp", self.site, "/ip/arp", *arp),
            *parse.ask("leases", self.site, "/ip/dhcp-server/lease", "address", "mac-address", "status", "disabled"),
            *parse.run("neighbours", self.site, "ip -j neigh show"),
        )

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        router = self.site.router.name
        result = [parse.neighbours(results["arp"], router)]
        if self.site.gateway is not None:
            result.append(parse.neighbours(results["neighbours"], self.site.gateway.name))
        leases = parse.rows(results["leases"], router, "its leases", "address")
        lan_neighbours = [
            item for part in result if not isinstance(part, LinkFinding) for item in part if self._is_in_lan(item)
        ]
        silence = [part for part in (*result, leases) if isinstance(part, LinkFinding)]
        wrong = [
            *self._find_duplicates(lan_neighbours),
            *self._compare_reservations(lan_neighbours),
            *self._busy(() if isinstance(leases, LinkFinding) else leases),
        ]
        evidence = tuple(
            parse.read(msg(f"{arg(neighbour.address)}, seen by {arg(neighbour.seen_by)}"), neighbour.mac)
            for neighbour in lan_neighbours
        )
        return base.ProbeResult(
            tuple(dict.fromkeys((*wrong, *silence))) or (self._good_finding(lan_neighbours),), evidence
        )

    def _is_in_lan(self, neighbour: parse.Neighbour) -> bool:
        return IPv4Address(neighbour.address) in self.site.site_config.lan.network

    def _find_duplicates(self, lan_neighbours: Sequence[parse.Neighbour]) -> Iterator[LinkFinding]:
        cards: dict[str, dict[str, parse.Neighbour]] = {}
        for neighbour in sorted(lan_neighbours, key=lambda entry: not entry.fresh):
            cards.setdefault(neighbour.address, {}).setdefault(neighbour.mac, neighbour)
        for address, macs in cards.items():
            text = parse.join_words(msg(f"{arg(mac)} (seen by {arg(item.seen_by)})") for mac, item in macs.items())
            if len(macs) > 1 and all(neighbour.fresh for neighbour in macs.values()):
                yield parse.fail(
                    "address-twice", msg(f"two cards respond at {arg(address)}: {arg(text)}"), _DUPLICATE_HINT
                )
            elif len(macs) > 1:
                message = msg(f"another card responded at {arg(address)} some time ago: {arg(text)}")
                yield parse.warn(
                    "address-changed",
                    message,
                    "repeat the check in a few minutes: if nothing changes, find the other card",
                )

    def _compare_reservations(self, lan_neighbours: Sequence[parse.Neighbour]) -> Iterator[LinkFinding]:
        lan = self.site.site_config.lan
        by_address = {str(reservation.address): reservation for reservation in lan.reservations}
        by_card = {reservation.mac.lower(): reservation for reservation in lan.reservations}
        now = {entry.address for entry in lan_neighbours if entry.fresh}
        current = [item for item in lan_neighbours if item.fresh or item.address not in now]
        for neighbour in {(neighbour.address, neighbour.mac): neighbour for neighbour in current}.values():
            reserved_host, owner = by_address.get(neighbour.address), by_card.get(neighbour.mac)
            if reserved_host is not None and reserved_host.mac.lower() != neighbour.mac:
                there = msg(f"{arg(neighbour.mac)}{f', the card of {arg(owner.name)},' if owner else ''}")
                message = msg(
                    f"{arg(neighbour.address)} is reserved for {arg(reserved_host.name)}, but {arg(there)} responds "
                    "there"
                )
                hint = msg(
                    f"correct `mac:` of {arg(reserved_host.name)} if its card is new; otherwise find the device that "
                    "took its address"
                )
                yield parse.fail("wrong-card", message, hint)
            elif reserved_host is None and owner is not None:
                message = msg(
                    f"{arg(owner.name)} has the address {arg(neighbour.address)} instead of its reserved "
                    f"{arg(owner.address)}"
                )
                hint = msg(
                    f"set {arg(owner.name)} to DHCP and renew its lease: others expect it at {arg(owner.address)}"
                )
                yield parse.fail("wrong-address", message, hint)

    def _busy(self, leases: Sequence[Mapping[str, str]]) -> Iterator[LinkFinding]:
        """Yield findings for `busy` leases: another host responded at an address to be leased (Manual, DHCP)."""
        for row in leases:
            if row.get("status") == "busy":
                message = msg(
                    f"the router does not assign {arg(row.get('address', '?'))}: another device responds there"
                )
                yield parse.warn("lease-busy", message, "find the device with that manual address, and set it to DHCP")

    def _good_finding(self, lan_neighbours: Sequence[parse.Neighbour]) -> LinkFinding:
        count = len({neighbour.address for neighbour in lan_neighbours})
        if not count:
            hint = "switch the robots on and repeat the check: only recently contacted devices are seen"
            return parse.unknown(
                "nobody-seen", "neither the router nor the gateway computer sees any device in the LAN", hint
            )
        are = msg("1 address of the LAN is" if count == 1 else f"{arg(count)} addresses of the LAN are each")
        return parse.good("each-once", msg(f"{arg(are)} used by one card, as reserved"))


_DHCP_HINT = "unplug it, or switch its DHCP server off: the site cannot reach a robot that takes its lease"


def rogue_dhcp_check(site: parse.OwnSite) -> base.Step:
    """Return the step that reads alerts from the router, and discovers servers on the LAN."""
    title = "No other DHCP server on the LAN"
    if site.gateway is None:
        return parse.by_hand(
            "rogue-dhcp",
            title,
            msg(
                f"Check the LAN of {arg(site.name)} for DHCP offers from a computer in it, for example with `sudo nmap "
                "--script broadcast-dhcp-discover`. The site has no gateway computer and no control centre that could "
                "do it."
            ),
            msg(f"Only the router offers addresses: {arg(site.site_config.lan.gateway)}."),
            site.hosts,
        )
    return parse.step("rogue-dhcp", title, _RogueDhcp(site), site.hosts)


@dataclass(frozen=True, slots=True)
class _RogueDhcp:
    """Check that there is no other DHCP server on the LAN."""

    site: parse.OwnSite

    def asks(self) -> tuple[base.Question, ...]:
        assert self.site.gateway is not None  # noqa: S101 - the step is skipped without one
        cards = tuple(reservation.mac for reservation in self.site.site_config.lan.reservations)
        return (
            base.DhcpDiscoverRequest("offers", base.Place.GATEWAY, self.site.gateway.interface, cards=cards),
            *parse.run("router", self.site, f"ip -j neigh show to {self.site.site_config.lan.gateway}"),
            *parse.ask("alerts", self.site, "/ip/dhcp-server/alert", "interface", "unknown-server", "disabled"),
        )

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        assert self.site.gateway is not None  # noqa: S101 - the step is skipped without one
        dhcp_offers = parse.offers(results["offers"], self.site.gateway.name)
        alerts = tuple(self._alerts(results))
        if isinstance(dhcp_offers, LinkFinding):
            return base.ProbeResult((*alerts, dhcp_offers))
        each = {(offer.server, offer.mac): offer for offer in dhcp_offers}.values()
        evidence = tuple(
            parse.measured_evidence(msg(f"DHCP offer of {arg(item.server)}"), _offer_text(item)) for item in each
        )
        findings = tuple(
            finding
            for finding in self._judge_offers(dhcp_offers, self._card(results))
            if not alerts or finding.verdict is not Verdict.PASS
        )
        return base.ProbeResult((*alerts, *findings), evidence)

    def _alerts(self, results: Mapping[str, base.Answer]) -> Iterator[LinkFinding]:
        """Yield findings for DHCP alerts; alerts exist only if configured, so a missing menu is no finding."""
        if self.site.router is None or "alerts" not in results:
            return
        result = parse.rows(results["alerts"], self.site.router.name, "its DHCP alerts", "interface")
        for row in () if isinstance(result, LinkFinding) else result:
            server = row.get("unknown-server", "")
            if server and not parse.yes(row, "disabled"):
                place = row.get("interface", "its LAN")
                yield parse.fail(
                    "dhcp-alert",
                    msg(f"the router has seen another DHCP server on {arg(place)}: {arg(server)}"),
                    _DHCP_HINT,
                )

    def _card(self, results: Mapping[str, base.Answer]) -> str | None:
        """Return the router's MAC address in the gateway's neighbour table; None, if it is missing, proves nothing."""
        result = parse.neighbours(results["router"], "")
        local = str(self.site.site_config.lan.gateway)
        return (
            None
            if isinstance(result, LinkFinding)
            else next((neighbour.mac for neighbour in result if neighbour.address == local), None)
        )

    def _judge_offers(self, dhcp_offers: tuple[base.DhcpOffer, ...], router_card: str | None) -> Iterator[LinkFinding]:
        local = str(self.site.site_config.lan.gateway)
        strangers = {(item.server, item.mac): item for item in dhcp_offers if item.server != local}
        cards = sorted({offer.mac for offer in dhcp_offers if offer.server == local and offer.mac is not None})
        strange = [card for card in cards if router_card not in {None, card}]
        for stranger in strangers.values():
            sender = _sender(self.site, stranger.server, stranger.mac)
            yield parse.fail(
                "rogue-dhcp",
                msg(f"{arg(sender)} also assigns addresses on the LAN: {arg(_offer_text(stranger))}"),
                _DHCP_HINT,
            )
        if len(cards) > 1:
            message = msg(f"two cards assign addresses as the router {arg(local)}: {arg(cards[0])} and {arg(cards[1])}")
            yield parse.fail(
                "router-twice", message, "one of them is not the router: find it by its card address, and unplug it"
            )
        elif strange:
            message = msg(
                f"{arg(strange[0])} assigns addresses as the router {arg(local)}, whose card is {arg(router_card)}"
            )
            yield parse.fail("not-the-router", message, "find it by its card address, and unplug it")
        if not dhcp_offers:
            hint = (
                "check that the gateway computer is in the LAN, and that `/ip/dhcp-server print` of the router "
                "shows no flag"
            )
            yield parse.unknown(
                "nobody-offers", msg(f"no response to a DHCP request, not even from the router {arg(local)}"), hint
            )
        elif not strangers and not strange and len(cards) < 2:  # noqa: PLR2004 - two are one too many
            request_count = 2 + len(self.site.site_config.lan.reservations)
            yield parse.good(
                "only-the-router",
                msg(
                    f"only the router {arg(local)} offers an address, to each of {arg(request_count)} requesting cards"
                ),
            )


def _sender(site: parse.OwnSite, address: str, mac: str | None) -> str:
    """Describe a sender: its address, MAC address, and owner by the DHCP reservations."""
    cards = {card.mac.lower(): card.name for card in site.site_config.lan.reservations}
    whose = cards.get((mac or "").lower())
    return msg(f"{arg(address)} ({arg(mac or 'card unknown')}{f', the card of {arg(whose)}' if whose else ''})")


def _offer_text(offer: base.DhcpOffer) -> str:
    gateway = msg(f" with gateway {arg(offer.router)}" if offer.router else "")
    return msg(f"it offered {arg(offer.address)}{arg(gateway)}")


_SOLICIT_S = 8.0


def rogue_router_check(site: parse.OwnSite) -> base.Step:
    """Return the step that discovers IPv6 routers on the LAN: the site's own sends no advertisement."""
    title = "No other router on the LAN"
    if site.gateway is None:
        return parse.by_hand(
            "rogue-router",
            title,
            msg(
                f"Check the LAN of {arg(site.name)} for IPv6 routers from a computer in it, for example with `rdisc6` "
                "of the package ndisc6. The site has no gateway computer and no control centre that could do it."
            ),
            "No router responds.",
            site.hosts,
        )
    return parse.step("rogue-router", title, _RogueRouter(site), site.hosts)


@dataclass(frozen=True, slots=True)
class _RogueRouter:
    """Check that there is no other router on the LAN."""

    site: parse.OwnSite

    def asks(self) -> tuple[base.Question, ...]:
        assert self.site.gateway is not None  # noqa: S101 - the step is skipped without one
        return (base.RouterSolicitRequest("routers", base.Place.GATEWAY, self.site.gateway.interface, _SOLICIT_S),)

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        assert self.site.gateway is not None  # noqa: S101 - the step is skipped without one
        advertisements = parse.routers(results["routers"], self.site.gateway.name)
        if isinstance(advertisements, LinkFinding):
            return base.ProbeResult((advertisements,))
        evidence = tuple(
            parse.measured_evidence(msg(f"router advertisement of {arg(item.address)}"), _advertisement_text(item))
            for item in advertisements
        )
        words = msg(f"no IPv6 router responded to 2 router solicitations on the LAN within {arg(_SOLICIT_S):g} s")
        return base.ProbeResult(
            tuple(self._finding(item) for item in advertisements) or (parse.good("no-other-router", words),), evidence
        )

    def _finding(self, router: base.RouterAdvertisement) -> LinkFinding:
        sender = _sender(self.site, router.address, router.mac)
        message = msg(
            f"{arg(sender)} announces itself as an IPv6 router on the LAN: {arg(_advertisement_text(router))}"
        )
        hint = (
            "unplug it, or disable its router advertisements: gateways ignore them, other computers and robots "
            "on the LAN do not"
        )
        return parse.fail("rogue-router", message, hint)


def _advertisement_text(router: base.RouterAdvertisement) -> str:
    route = msg(f"a default route for {arg(router.lifetime_s)} s" if router.lifetime_s else "no default route")
    prefixes = msg(f", and addresses of {arg(join(', ', router.prefixes))}" if router.prefixes else "")
    return msg(f"it offers {arg(route)}{arg(prefixes)}")
