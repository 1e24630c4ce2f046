"""The way from this laptop to the router of a site: port, cable, address, route, and what lies in between.

The judges are pure functions of what the kernel says (`network.py`) and of what is declared. Only `ask_router` contacts
a device: it opens one TLS connection to the router's API, looks at the certificate, and closes; nobody logs in.

What cannot be known here: which of two cables leads to the router, and, with no carrier, whether the other end has
power. A firewall of this laptop is not looked at. The line with `nmcli` was not tried with a real NetworkManager.
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
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory.model import Router
from atlantis_netcfg.operations.common.kinds import managed
from atlantis_netcfg.operations.common.session_link import LAN, bearer_of
from atlantis_netcfg.operations.doctor.items import DoctorItem, DoctorSection
from atlantis_netcfg.routeros.api import Endpoint, Unreachable, shown_certificate

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from atlantis_netcfg.inventory import Declaration
    from atlantis_netcfg.operations.doctor.network import KernelRoute, LaptopPort, NetworkFacts

_CONNECT_S = 5.0
_SLOW_MBPS = 100
"""Below it a cable or a plug is damaged: every board of the pilot has Fast Ethernet at least."""


@dataclass(frozen=True, slots=True)
class RouterPlace:
    """A router of the site, as it is declared, and how this laptop is to reach it."""

    site: str
    router: str
    address: IPv4Address
    api_port: int
    network: IPv4Network
    """Of its management port."""
    technician: IPv4Address
    admit: tuple[IPv4Network, ...]
    """From where its firewall lets somebody manage it."""
    plug: str
    """Its management port, by the factory name."""
    bearer: str
    """`lan`: the laptop is plugged into that port; else it is far away."""
    metered: bool
    pin: str | None
    """SHA-256 of its certificate, declared or known on this computer."""
    example: bool
    """The addresses are examples, which lead to nobody's devices."""

    @property
    def assigned(self) -> IPv4Interface:
        """The laptop's declared address."""
        return IPv4Interface(f"{self.technician}/{self.network.prefixlen}")


def router_places(
    declaration: Declaration, site: str, via: str | None, pinned: Callable[[str], str | None]
) -> tuple[RouterPlace, ...]:
    """The routers of a site. Raises UsageError where the site has no such bearer as `via` names."""
    return tuple(_places(declaration, site, via, pinned))


def _places(
    declaration: Declaration, site: str, via: str | None, pinned: Callable[[str], str | None]
) -> Iterator[RouterPlace]:
    management = declaration.sites[site].management
    for host in declaration.site_hosts(site):
        if not isinstance(host.device, Router):
            continue
        access, bearer = host.device.access, bearer_of(declaration, host, via)
        yield RouterPlace(
            site=site,
            router=host.name,
            address=IPv4Address(access.address),
            api_port=access.port,
            network=IPv4Network(management.network),
            technician=IPv4Address(management.technician),
            admit=tuple(map(IPv4Network, management.admit)),
            plug=managed(declaration, host).place.port,
            bearer=bearer.name,
            metered=bearer.metered,
            pin=access.fingerprint or pinned(host.name),
            example=declaration.pilot.example_values,
        )


def _item(name: str, verdict: Verdict, measured: str, hint: str = "", commands: Sequence[str] = ()) -> DoctorItem:
    return DoctorItem(DoctorSection.WAY, name, verdict, measured, hint, tuple(commands))


def _sudo(*words: object) -> str:
    return f"sudo {shlex.join(map(str, words))}"


def judge_ports(facts: NetworkFacts) -> DoctorItem:
    """No site was named: which wired ports this laptop has."""
    wired = _candidates(facts)
    if not wired:
        return _item("ports", Verdict.WARN, "this laptop has no Ethernet port", "plug in a USB Ethernet adapter")
    return _item("ports", Verdict.PASS, "; ".join(map(_described, wired)))


def _described(port: LaptopPort) -> str:
    addresses = f" ({', '.join(map(str, port.addresses))})" if port.addresses else ""
    if not port.up:
        return f"{port.name} is switched off{addresses}"
    return f"{port.name} has a cable{addresses}" if port.carrier else f"{port.name} sees no cable{addresses}"


def judge_way(place: RouterPlace, facts: NetworkFacts) -> tuple[DoctorItem, ...]:
    """Everything between this laptop and the router."""
    if place.bearer != LAN.name:
        return (_judge_far_route(place, facts),)
    chosen = _chosen_port(place, facts)
    address = _judge_address(place, facts, chosen)
    return (
        _judge_port(place, facts, chosen),
        address,
        _judge_route(place, facts, chosen, address),
        _judge_other_ports(place, facts, chosen),
        _judge_default_route(place, facts, chosen),
    )


def _reaching(place: RouterPlace, facts: NetworkFacts) -> list[LaptopPort]:
    """Ports with an address in the router's management network, the one with the declared address first."""
    found = [port for port in facts.ports if any(each.ip in place.network for each in port.addresses)]
    return sorted(found, key=lambda port: not any(each.ip == place.technician for each in port.addresses))


def _candidates(facts: NetworkFacts) -> list[LaptopPort]:
    """The network cards with a socket; where there is none, what stands for one."""
    wired = [port for port in facts.ports if port.wired]
    return [port for port in wired if port.card] or wired


def _chosen_port(place: RouterPlace, facts: NetworkFacts) -> LaptopPort | None:
    """The port that leads to the router, or that most likely will: with an address there, a cable, no other use."""
    reaching = [port for port in _reaching(place, facts) if port.wired]
    if reaching:
        return reaching[0]
    ordered = sorted(_candidates(facts), key=lambda port: (not port.carrier, bool(port.addresses), not port.up))
    return ordered[0] if ordered else None


def _judge_port(place: RouterPlace, facts: NetworkFacts, port: LaptopPort | None) -> DoctorItem:
    if port is None:
        return _item(
            "port",
            Verdict.FAIL,
            "this laptop has no Ethernet port",
            "plug in a USB Ethernet adapter, then type the same again",
        )
    plug = f"plug the cable into {place.plug} of {place.router}, and look at the router's power"
    if not port.up:
        return _item(
            "port", Verdict.FAIL, f"{port.name} is switched off", commands=[_sudo("ip", "link", "set", port.name, "up")]
        )
    if not port.carrier:
        return _item("port", Verdict.FAIL, f"{port.name} is on and sees no cable (no carrier)", plug)
    speed = "speed unknown" if port.speed_mbps is None else f"{port.speed_mbps} Mbit/s"
    if port.speed_mbps is not None and port.speed_mbps < _SLOW_MBPS:
        return _item(
            "port", Verdict.WARN, f"{port.name} has a cable, at {speed} only", "take another cable, or clean the plugs"
        )
    others = [each.name for each in _candidates(facts) if each.carrier and each != port]
    if others and not _reaching(place, facts):
        return _item(
            "port",
            Verdict.WARN,
            f"{port.name} and {', '.join(others)} have a cable: nothing here tells which leads to {place.router}",
            plug,
        )
    return _item("port", Verdict.PASS, f"{port.name} has a cable, {speed}")


def _give_address(place: RouterPlace, port: LaptopPort | None) -> list[str]:
    if port is None:
        return []
    free = [_sudo("nmcli", "device", "set", port.name, "managed", "no")] if port.managed else []
    return [*free, _sudo("ip", "address", "add", place.assigned, "dev", port.name)]


def _judge_address(place: RouterPlace, facts: NetworkFacts, port: LaptopPort | None) -> DoctorItem:
    reaching = _reaching(place, facts)
    for each in facts.ports:
        for address in each.addresses:
            if address.ip == place.address:
                return _item(
                    "address",
                    Verdict.FAIL,
                    f"{each.name} has {address.ip}, which is the address of {place.router} itself",
                    commands=[_sudo("ip", "address", "del", address, "dev", each.name), *_give_address(place, port)],
                )
    if any(place.assigned in each.addresses for each in reaching):
        names = ", ".join(each.name for each in reaching if place.assigned in each.addresses)
        return _item("address", Verdict.PASS, f"{place.assigned} on {names}")
    if not reaching:
        return _item(
            "address",
            Verdict.FAIL,
            f"no port has an address in {place.network}, the network of {place.plug} of {place.router}",
            commands=_give_address(place, port),
        )
    first = reaching[0]
    found = next(each for each in first.addresses if each.ip in place.network)
    same = found.network.prefixlen == place.network.prefixlen
    return _item(
        "address",
        Verdict.WARN if same else Verdict.FAIL,
        f"{first.name} has {found}; declared for this laptop is {place.assigned}",
        commands=_give_address(place, first),
    )


def _shown(route: KernelRoute) -> str:
    return f"{route.port}, by the gateway {route.gateway}" if route.gateway else route.port


def _judge_route(place: RouterPlace, facts: NetworkFacts, port: LaptopPort | None, address: DoctorItem) -> DoctorItem:
    taken = facts.taken
    fix: Sequence[str] = address.commands
    if address.verdict in (Verdict.PASS, Verdict.WARN) and port is not None:
        fix = [_sudo("ip", "route", "replace", f"{place.address}/32", "dev", port.name, "src", _source(place, port))]
    if taken is None:
        return _item("route", Verdict.FAIL, f"no route to {place.address}", commands=fix)
    if port is None or taken.port != port.name or taken.gateway is not None:
        measured = f"{place.address} goes to {_shown(taken)}"
        if port is not None and taken.port != port.name:
            measured = f"{place.address} goes to {_shown(taken)}, and not to {port.name}"
        return _item("route", Verdict.FAIL, measured, commands=fix)
    return _admitted(place, taken, fix)


def _source(place: RouterPlace, port: LaptopPort) -> IPv4Address:
    mine = [each.ip for each in port.addresses if each.ip in place.network]
    return place.technician if place.technician in mine or not mine else mine[0]


def _admitted(place: RouterPlace, taken: KernelRoute, fix: Sequence[str]) -> DoctorItem:
    """A route that leads there: whether the router's firewall lets packets from that source in."""
    source = taken.source or "?"
    admitted = taken.source is not None and any(IPv4Address(taken.source) in each for each in place.admit)
    listed = ", ".join(map(str, place.admit))
    if not admitted:
        return _item(
            "route",
            Verdict.FAIL,
            f"{place.address} is reached from {source}; the declared firewall of {place.router} admits {listed} only",
            commands=fix,
        )
    return _item("route", Verdict.PASS, f"{place.address} goes to {_shown(taken)}, from {source}")


def _judge_far_route(place: RouterPlace, facts: NetworkFacts) -> DoctorItem:
    """Over a bearer: the laptop is not at the router, so some route of its own has to lead there."""
    taken = facts.taken
    look = f"is the VPN, or the way over {place.bearer}, up on this laptop?"
    if taken is None:
        return _item("route", Verdict.FAIL, f"no route to {place.address}", look)
    if facts.matching and all(each.target == "default" for each in facts.matching) and place.address.is_private:
        return _item("route", Verdict.FAIL, f"only the default route leads to {place.address}: {_shown(taken)}", look)
    judged = _admitted(place, taken, ())
    return judged if judged.verdict is Verdict.PASS else _item("route", judged.verdict, judged.measured, look)


def _judge_other_ports(place: RouterPlace, facts: NetworkFacts, port: LaptopPort | None) -> DoctorItem:
    """A second interface, Wi-Fi most often, whose network is the router's too: answers get lost there."""
    found, commands = [], []
    for each in facts.ports:
        if port is not None and each.name == port.name:
            continue
        for address in each.addresses:
            if address.network.overlaps(place.network) and each.name != "lo":
                found.append(f"{each.name} has {address}")
                commands.append(_sudo("ip", "address", "del", address, "dev", each.name))
    named = {port.name if port is not None else ""}
    for route in facts.matching:
        inside = route.target != "default" and route.port not in named
        if inside and not any(f"{route.port} has" in text for text in found):
            found.append(f"{route.target} goes to {_shown(route)}")
            commands.append(_sudo("ip", "route", "del", route.target, "dev", route.port))
    if found:
        return _item("other ports", Verdict.WARN, f"{'; '.join(found)}: in the router's network too", commands=commands)
    return _item("other ports", Verdict.PASS, f"none reaches into {place.network}")


def _judge_default_route(place: RouterPlace, facts: NetworkFacts, port: LaptopPort | None) -> DoctorItem:
    """Whose links this laptop's own traffic takes: updates and mail over a satellite are dear."""
    connected = {each.name for each in _reaching(place, facts)}
    through = [
        route for route in facts.defaults if port is not None and route.port == port.name and route.port in connected
    ]
    if through:
        by = [("default", *(("via", route.gateway) if route.gateway else ()), "dev", route.port) for route in through]
        return _item(
            "default route",
            Verdict.WARN,
            f"{through[0].port}: this laptop's updates and mail would go over the site's links",
            commands=[_sudo("ip", "route", "del", *words) for words in by],
        )
    if not facts.defaults:
        return _item("default route", Verdict.PASS, "none: no other traffic of this laptop goes to the site")
    return _item("default route", Verdict.PASS, f"{_shown(facts.defaults[0])}")


def why_not_contacted(place: RouterPlace, way: Sequence[DoctorItem]) -> str | None:
    """Why the router is left alone; None: one connection may be opened."""
    if any(item.name in ("port", "route") and item.verdict is Verdict.FAIL for item in way):
        return "not contacted: the way to it is not right yet"
    return f"not contacted: {place.bearer} is paid by the byte" if place.metered else None


@dataclass(frozen=True, slots=True)
class RouterAnswer:
    """What one TLS connection has shown."""

    trouble: str | None
    """Why there was none."""
    certificate: str = ""
    """SHA-256."""
    valid_from: datetime | None = None
    valid_until: datetime | None = None


def ask_router(place: RouterPlace) -> RouterAnswer:
    """Open one TLS connection to the router's API, look at its certificate, close: nobody logs in."""
    endpoint = Endpoint(str(place.address), place.api_port, "", Secret(""), None, connect_timeout_s=_CONNECT_S)
    try:
        shown = asyncio.run(shown_certificate(endpoint))
        read = x509.load_der_x509_certificate(shown)
    except (Unreachable, OSError, ValueError) as error:
        return RouterAnswer(str(error))
    digest = hashlib.sha256(shown).hexdigest()
    return RouterAnswer(None, digest, read.not_valid_before_utc, read.not_valid_after_utc)


def judge_router(place: RouterPlace, answer: RouterAnswer, now: datetime | None = None) -> tuple[DoctorItem, ...]:
    """Whether it answers, who it is, and whether both clocks can be right."""
    if answer.trouble is not None:
        hint = f"look at the power of {place.router}, and at the cable in {place.plug}"
        return (_item("router", Verdict.FAIL, answer.trouble, hint),)
    return (_judge_identity(place, answer), _judge_dates(place, answer, now or datetime.now(UTC)))


def _judge_identity(place: RouterPlace, answer: RouterAnswer) -> DoctorItem:
    trust = [f"provision trust site={place.site}"]
    if place.pin is None:
        return _item("router", Verdict.WARN, f"{place.router} answers, and its certificate is not known", "", trust)
    if place.pin.replace(":", "").lower() != answer.certificate:
        return _item(
            "router",
            Verdict.FAIL,
            f"what answers at {place.address} shows another certificate than {place.router}",
            "only if the router was renewed or replaced on purpose:",
            trust,
        )
    return _item("router", Verdict.PASS, f"{place.router} answers, with the known certificate; nobody logged in")


def _judge_dates(place: RouterPlace, answer: RouterAnswer, now: datetime) -> DoctorItem:
    begins, ends = answer.valid_from, answer.valid_until
    if begins is None or ends is None:
        return _item("dates", Verdict.INCONCLUSIVE, f"the certificate of {place.router} has no dates")
    measured = f"its certificate is valid from {begins:%Y-%m-%d} to {ends:%Y-%m-%d}; here it is {now:%Y-%m-%d}"
    if now < begins:
        return _item("dates", Verdict.FAIL, measured, "set this laptop's clock", ["sudo timedatectl set-ntp true"])
    if now > ends:
        return _item("dates", Verdict.WARN, measured, "renew it, or set this laptop's clock if that is wrong")
    return _item("dates", Verdict.PASS, measured)
