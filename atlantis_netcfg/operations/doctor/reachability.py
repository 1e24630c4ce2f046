"""The path from this laptop to a site's router: port, cable, address, route, and conflicts.

The judges are pure functions of the kernel's state (`network.py`) and the inventory. Only `ask_router` contacts a
device: it opens one TLS connection to the router's API, reads the certificate, and closes, without a login.

Not detectable here: which of two cables leads to the router, and, without carrier, whether the other end has power. A
firewall of this laptop is not checked. The line with `nmcli` was not tested with a real NetworkManager.
"""

from __future__ import annotations

import asyncio
import hashlib
import shlex
from dataclasses import dataclass
from datetime import UTC, datetime
from ipaddress import IPv4Address, IPv4Interface, IPv4Network
from typing import TYPE_CHECKING

from cryptography import x509

from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory.model import Router
from atlantis_netcfg.operations.common.kinds import get_managed_device
from atlantis_netcfg.operations.common.session_link import LAN, site_link_of
from atlantis_netcfg.operations.doctor.items import DoctorItem, DoctorSection
from atlantis_netcfg.routeros import api

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.operations.doctor.network import KernelRoute, LaptopPort, NetworkFacts

_CONNECT_S = 5.0
_SLOW_MBPS = 100
"""A slower port has a damaged cable or plug: every board of the pilot has at least Fast Ethernet."""


@dataclass(frozen=True, slots=True)
class RouterPlace:
    """A router of the site from the inventory, and how this laptop is to reach it."""

    site: str
    router: str
    address: IPv4Address
    api_port: int
    network: IPv4Network
    """Network of the router's management port."""
    technician: IPv4Address
    admit: tuple[IPv4Network, ...]
    """Networks from which the router's firewall admits management."""
    plug: str
    """Factory name of the router's management port."""
    link: str
    """`lan`: the laptop is plugged into the management port; any other: the router is remote."""
    is_metered: bool
    pin: str | None
    """SHA-256 of the router's certificate, from the inventory or as pinned on this computer."""
    example: bool
    """Whether the addresses are examples, which belong to no device."""

    @property
    def laptop_address(self) -> IPv4Interface:
        """The laptop's address in the inventory."""
        return IPv4Interface(f"{self.technician}/{self.network.prefixlen}")


def router_places(
    inventory: Inventory, site: str, via: str | None, get_pin: Callable[[str], str | None]
) -> tuple[RouterPlace, ...]:
    """Return the routers of a site; raise UsageError if the site has no link as named by `via`."""
    return tuple(_places(inventory, site, via, get_pin))


def _places(
    inventory: Inventory, site: str, via: str | None, get_pin: Callable[[str], str | None]
) -> Iterator[RouterPlace]:
    management = inventory.sites[site].management
    for host in inventory.site_hosts(site):
        if not isinstance(host.device, Router):
            continue
        access, link = host.device.access, site_link_of(inventory, host, via)
        yield RouterPlace(
            site=site,
            router=host.name,
            address=IPv4Address(access.address),
            api_port=access.port,
            network=IPv4Network(management.network),
            technician=IPv4Address(management.technician),
            admit=tuple(map(IPv4Network, management.admit)),
            plug=get_managed_device(inventory, host).place.port,
            link=link.name,
            is_metered=link.is_metered,
            pin=access.fingerprint or get_pin(host.name),
            example=inventory.pilot.example_values,
        )


def _item(name: str, verdict: Verdict, observation: str, hint: str = "", commands: Sequence[str] = ()) -> DoctorItem:
    return DoctorItem(DoctorSection.WAY, name, verdict, observation, hint, tuple(commands))


def _sudo(*words: object) -> str:
    return f"sudo {shlex.join(map(str, words))}"


def judge_ports(facts: NetworkFacts) -> DoctorItem:
    """Report this laptop's wired ports, if no site was named."""
    ports = _candidates(facts)
    if not ports:
        return _item("ports", Verdict.WARN, "this laptop has no Ethernet port", "plug in a USB Ethernet adapter")
    return _item("ports", Verdict.PASS, join("; ", map(_describe, ports)))


def _describe(port: LaptopPort) -> str:
    addresses = msg(f" ({arg(join(', ', map(str, port.addresses)))})" if port.addresses else "")
    if not port.up:
        return msg(f"{arg(port.name)} is disabled{arg(addresses)}")
    return msg(
        f"{arg(port.name)} has a cable connected{arg(addresses)}"
        if port.carrier
        else f"{arg(port.name)} detects no cable{arg(addresses)}"
    )


def judge_way(place: RouterPlace, facts: NetworkFacts) -> tuple[DoctorItem, ...]:
    """Judge everything between this laptop and the router."""
    if place.link != LAN.name:
        return (_judge_far_route(place, facts),)
    port = _chosen_port(place, facts)
    address = _judge_address(place, facts, port)
    return (
        _judge_port(place, facts, port),
        address,
        _judge_route(place, facts, port, address),
        _judge_other_ports(place, facts, port),
        _judge_default_route(place, facts, port),
    )


def _reaching(place: RouterPlace, facts: NetworkFacts) -> list[LaptopPort]:
    """Return the ports with an address in the management network, the one with the inventory's address first."""
    ports = [port for port in facts.ports if any(each.ip in place.network for each in port.addresses)]
    return sorted(ports, key=lambda port: not any(each.ip == place.technician for each in port.addresses))


def _candidates(facts: NetworkFacts) -> list[LaptopPort]:
    """Return the physical wired ports; without any, virtual ones."""
    ports = [port for port in facts.ports if port.is_wired]
    return [port for port in ports if port.card] or ports


def _chosen_port(place: RouterPlace, facts: NetworkFacts) -> LaptopPort | None:
    """Return the port that leads to the router, or else the most likely one: with a cable and no other use."""
    reaching = [port for port in _reaching(place, facts) if port.is_wired]
    if reaching:
        return reaching[0]
    candidates = sorted(_candidates(facts), key=lambda port: (not port.carrier, bool(port.addresses), not port.up))
    return candidates[0] if candidates else None


def _judge_port(place: RouterPlace, facts: NetworkFacts, port: LaptopPort | None) -> DoctorItem:
    if port is None:
        return _item(
            "port",
            Verdict.FAIL,
            "this laptop has no Ethernet port",
            "plug in a USB Ethernet adapter, then run the same command again",
        )
    plug = msg(f"plug the cable into {arg(place.plug)} of {arg(place.router)}, and check the router's power")
    if not port.up:
        return _item(
            "port",
            Verdict.FAIL,
            msg(f"{arg(port.name)} is disabled"),
            commands=[_sudo("ip", "link", "set", port.name, "up")],
        )
    if not port.carrier:
        return _item("port", Verdict.FAIL, msg(f"{arg(port.name)} is enabled but detects no cable (no carrier)"), plug)
    speed = msg("speed unknown" if port.speed_mbps is None else f"{arg(port.speed_mbps)} Mbit/s")
    if port.speed_mbps is not None and port.speed_mbps < _SLOW_MBPS:
        return _item(
            "port",
            Verdict.WARN,
            msg(f"{arg(port.name)} has a cable, at only {arg(speed)}"),
            "try another cable, or clean the plugs",
        )
    others = [each.name for each in _candidates(facts) if each.carrier and each != port]
    if others and not _reaching(place, facts):
        return _item(
            "port",
            Verdict.WARN,
            msg(
                f"{arg(port.name)} and {arg(join(', ', others))} have a cable: unknown which one leads to "
                f"{arg(place.router)}"
            ),
            plug,
        )
    return _item("port", Verdict.PASS, msg(f"{arg(port.name)} has a cable, {arg(speed)}"))


def _address_commands(place: RouterPlace, port: LaptopPort | None) -> list[str]:
    if port is None:
        return []
    free = [_sudo("nmcli", "device", "set", port.name, "managed", "no")] if port.is_managed else []
    return [*free, _sudo("ip", "address", "add", place.laptop_address, "dev", port.name)]


def _judge_address(place: RouterPlace, facts: NetworkFacts, port: LaptopPort | None) -> DoctorItem:
    reaching = _reaching(place, facts)
    for each in facts.ports:
        for address in each.addresses:
            if address.ip == place.address:
                return _item(
                    "address",
                    Verdict.FAIL,
                    msg(f"{arg(each.name)} has {arg(address.ip)}, which is the address of {arg(place.router)} itself"),
                    commands=[
                        _sudo("ip", "address", "del", address, "dev", each.name),
                        *_address_commands(place, port),
                    ],
                )
    if any(place.laptop_address in each.addresses for each in reaching):
        names = join(", ", (each.name for each in reaching if place.laptop_address in each.addresses))
        return _item("address", Verdict.PASS, msg(f"{arg(place.laptop_address)} on {arg(names)}"))
    if not reaching:
        return _item(
            "address",
            Verdict.FAIL,
            msg(
                f"no port has an address in {arg(place.network)} (network of {arg(place.plug)} of {arg(place.router)})"
            ),
            commands=_address_commands(place, port),
        )
    first = reaching[0]
    match = next(each for each in first.addresses if each.ip in place.network)
    same = match.network.prefixlen == place.network.prefixlen
    return _item(
        "address",
        Verdict.WARN if same else Verdict.FAIL,
        msg(f"{arg(first.name)} has {arg(match)}; the inventory has {arg(place.laptop_address)} for this laptop"),
        commands=_address_commands(place, first),
    )


def _route_text(route: KernelRoute) -> str:
    return msg(f"{arg(route.port)}, through gateway {arg(route.gateway)}") if route.gateway else route.port


def _judge_route(place: RouterPlace, facts: NetworkFacts, port: LaptopPort | None, address: DoctorItem) -> DoctorItem:
    route = facts.best_route
    fix: Sequence[str] = address.commands
    if address.verdict in (Verdict.PASS, Verdict.WARN) and port is not None:
        fix = [_sudo("ip", "route", "replace", f"{place.address}/32", "dev", port.name, "src", _source(place, port))]
    if route is None:
        return _item("route", Verdict.FAIL, msg(f"no route to {arg(place.address)}"), commands=fix)
    if port is None or route.port != port.name or route.gateway is not None:
        observation = msg(f"{arg(place.address)} is routed to {arg(_route_text(route))}")
        if port is not None and route.port != port.name:
            observation = msg(f"{arg(place.address)} is routed to {arg(_route_text(route))}, not to {arg(port.name)}")
        return _item("route", Verdict.FAIL, observation, commands=fix)
    return _judge_source(place, route, fix)


def _source(place: RouterPlace, port: LaptopPort) -> IPv4Address:
    mine = [each.ip for each in port.addresses if each.ip in place.network]
    return place.technician if place.technician in mine or not mine else mine[0]


def _judge_source(place: RouterPlace, route: KernelRoute, fix: Sequence[str]) -> DoctorItem:
    """Judge whether the router's firewall admits the source address of the route."""
    source = route.source or "?"
    is_allowed = route.source is not None and any(IPv4Address(route.source) in each for each in place.admit)
    networks = join(", ", map(str, place.admit))
    if not is_allowed:
        return _item(
            "route",
            Verdict.FAIL,
            msg(
                f"{arg(place.address)} is reached from {arg(source)}; the firewall of {arg(place.router)} in the "
                f"inventory admits only {arg(networks)}"
            ),
            commands=fix,
        )
    return _item(
        "route", Verdict.PASS, msg(f"{arg(place.address)} is routed to {arg(_route_text(route))}, from {arg(source)}")
    )


def _judge_far_route(place: RouterPlace, facts: NetworkFacts) -> DoctorItem:
    """Judge the route over a link: the laptop is not at the router and needs a route of its own to it."""
    route = facts.best_route
    look = msg(f"is the VPN or the route over {arg(place.link)} up on this laptop?")
    if route is None:
        return _item("route", Verdict.FAIL, msg(f"no route to {arg(place.address)}"), look)
    if facts.matching and all(each.target == "default" for each in facts.matching) and place.address.is_private:
        return _item(
            "route",
            Verdict.FAIL,
            msg(f"only the default route leads to {arg(place.address)}: {arg(_route_text(route))}"),
            look,
        )
    item = _judge_source(place, route, ())
    return item if item.verdict is Verdict.PASS else _item("route", item.verdict, item.observation, look)


def _judge_other_ports(place: RouterPlace, facts: NetworkFacts, port: LaptopPort | None) -> DoctorItem:
    """Report a second interface, often Wi-Fi, in the router's network: responses get lost there."""
    conflicts, commands = [], []
    for each in facts.ports:
        if port is not None and each.name == port.name:
            continue
        for address in each.addresses:
            if address.network.overlaps(place.network) and each.name != "lo":
                conflicts.append(msg(f"{arg(each.name)} has {arg(address)}"))
                commands.append(_sudo("ip", "address", "del", address, "dev", each.name))
    port_names = {port.name if port is not None else ""}
    for route in facts.matching:
        inside = route.target != "default" and route.port not in port_names
        if inside and not any(f"{route.port} has" in text for text in conflicts):
            conflicts.append(msg(f"{arg(route.target)} is routed to {arg(_route_text(route))}"))
            commands.append(_sudo("ip", "route", "del", route.target, "dev", route.port))
    if conflicts:
        return _item(
            "other ports",
            Verdict.WARN,
            msg(f"{arg(join('; ', conflicts))}: also in the router's network"),
            commands=commands,
        )
    return _item("other ports", Verdict.PASS, msg(f"none in {arg(place.network)}"))


def _judge_default_route(place: RouterPlace, facts: NetworkFacts, port: LaptopPort | None) -> DoctorItem:
    """Report a default route over the site: this laptop's updates and mail over a satellite are expensive."""
    site_ports = {each.name for each in _reaching(place, facts)}
    through = [
        route for route in facts.defaults if port is not None and route.port == port.name and route.port in site_ports
    ]
    if through:
        by = [("default", *(("via", route.gateway) if route.gateway else ()), "dev", route.port) for route in through]
        return _item(
            "default route",
            Verdict.WARN,
            msg(f"{arg(through[0].port)}: this laptop's updates and mail would use the site's links"),
            commands=[_sudo("ip", "route", "del", *words) for words in by],
        )
    if not facts.defaults:
        return _item("default route", Verdict.PASS, "none: no other traffic of this laptop goes over the site")
    return _item("default route", Verdict.PASS, f"{_route_text(facts.defaults[0])}")


def why_not_contacted(place: RouterPlace, way: Sequence[DoctorItem]) -> str | None:
    """Return why the router must not be contacted; None if one connection may be opened."""
    if any(item.name in ("port", "route") and item.verdict is Verdict.FAIL for item in way):
        return "not contacted: its route is not correct yet"
    return msg(f"not contacted: {arg(place.link)} is metered") if place.is_metered else None


@dataclass(frozen=True, slots=True)
class RouterAnswer:
    """The result of one TLS connection."""

    trouble: str | None
    """Why there was no response; None: there was one."""
    certificate: str = ""
    """SHA-256 of the certificate."""
    valid_from: datetime | None = None
    valid_until: datetime | None = None


def ask_router(place: RouterPlace) -> RouterAnswer:
    """Open one TLS connection to the router's API, read its certificate, and close it, without a login."""
    endpoint = api.Endpoint(str(place.address), place.api_port, "", Secret(""), None, connect_timeout_s=_CONNECT_S)
    try:
        certificate = asyncio.run(api.shown_certificate(endpoint))
        read = x509.load_der_x509_certificate(certificate)
    except (api.Unreachable, OSError, ValueError) as error:
        return RouterAnswer(str(error))
    digest = hashlib.sha256(certificate).hexdigest()
    return RouterAnswer(None, digest, read.not_valid_before_utc, read.not_valid_after_utc)


def judge_router(place: RouterPlace, answer: RouterAnswer, now: datetime | None = None) -> tuple[DoctorItem, ...]:
    """Judge whether the router responds, its identity, and whether both clocks are plausible."""
    if answer.trouble is not None:
        hint = msg(f"check the power of {arg(place.router)} and the cable in {arg(place.plug)}")
        return (_item("router", Verdict.FAIL, answer.trouble, hint),)
    return (_judge_identity(place, answer), _judge_dates(place, answer, now or datetime.now(UTC)))


def _judge_identity(place: RouterPlace, answer: RouterAnswer) -> DoctorItem:
    trust = [f"provision device trust site={place.site}"]
    if place.pin is None:
        return _item(
            "router", Verdict.WARN, msg(f"{arg(place.router)} responds, but its certificate is not known"), "", trust
        )
    if place.pin.replace(":", "").lower() != answer.certificate:
        return _item(
            "router",
            Verdict.FAIL,
            msg(f"the device at {arg(place.address)} shows a different certificate than {arg(place.router)}"),
            "only if the router was renewed or replaced on purpose:",
            trust,
        )
    return _item(
        "router", Verdict.PASS, msg(f"{arg(place.router)} responds with the known certificate; no login was made")
    )


def _judge_dates(place: RouterPlace, answer: RouterAnswer, now: datetime) -> DoctorItem:
    begins, ends = answer.valid_from, answer.valid_until
    if begins is None or ends is None:
        return _item("dates", Verdict.INCONCLUSIVE, msg(f"the certificate of {arg(place.router)} has no dates"))
    observation = msg(
        f"its certificate is valid from {arg(begins):%Y-%m-%d} to {arg(ends):%Y-%m-%d}; the time here is "
        f"{arg(now):%Y-%m-%d}"
    )
    if now < begins:
        return _item("dates", Verdict.FAIL, observation, "set this laptop's clock", ["sudo timedatectl set-ntp true"])
    if now > ends:
        return _item("dates", Verdict.WARN, observation, "renew it, or set this laptop's clock if that is wrong")
    return _item("dates", Verdict.PASS, observation)
