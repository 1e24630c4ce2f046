"""Common code of the site checks: the site, their requests, the rows and addresses of results, and findings.

An incomplete result becomes a finding that reports it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Interface
from typing import TYPE_CHECKING, Any, cast

from atlantis_netcfg.checklist import report
from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, conjunction, join, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.links import LinkFinding
from atlantis_netcfg.links.status import Query
from atlantis_netcfg.routeros.render import RouterView, router_view

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from atlantis_netcfg.inventory import Host, Inventory


def good(code: str, message: str) -> LinkFinding:
    """Return a passing finding."""
    return LinkFinding(Verdict.PASS, code, message)


def warn(code: str, message: str, hint: str) -> LinkFinding:
    """Return a warning: it works, but a person should check it."""
    return LinkFinding(Verdict.WARN, code, message, hint)


def fail(code: str, message: str, hint: str) -> LinkFinding:
    """Return a failing finding."""
    return LinkFinding(Verdict.FAIL, code, message, hint)


def unknown(code: str, message: str, hint: str) -> LinkFinding:
    """Return an inconclusive finding."""
    return LinkFinding(Verdict.INCONCLUSIVE, code, message, hint)


def silent(who: str, trouble: base.Trouble, words: str) -> LinkFinding:
    """Return the finding for an incomplete response, from which nothing follows."""
    code, message, hint = _SILENT.get(trouble, _SILENT[base.Trouble.SILENT])
    text = msg(message.format(who=arg(who)))
    return unknown(code, msg(f"{arg(text)}: {arg(words)}") if words else text, msg(hint.format(who=arg(who))))


_SILENT = {
    base.Trouble.NO_PLACE: (
        "not-reached",
        "{who} was not reachable, so this was not checked",
        "check that {who} is switched on, and that this computer is in its management network",
    ),
    base.Trouble.SILENT: (
        "no-answer",
        "{who} did not respond in time",
        "repeat the check; if nothing changes, restart {who}",
    ),
    base.Trouble.DENIED: (
        "denied",
        "{who} denies permission for this check",
        "log in to {who} as root, or as an account that may use sudo without a password",
    ),
    base.Trouble.MISSING: (
        "no-program",
        "{who} lacks what this check needs",
        "apply the site's configuration once, which installs what a gateway computer needs",
    ),
    base.Trouble.BUSY: (
        "in-use",
        "another program on {who} uses what this check needs",
        "end the other program, or repeat the check in a minute",
    ),
}


def unreadable(who: str, what: str) -> LinkFinding:
    """Return the finding for a response that cannot be parsed."""
    return unknown(
        "unreadable",
        msg(f"{arg(who)} reports {arg(what)} in an unknown form"),
        msg(f"repeat the check; if nothing changes, check {arg(who)} manually"),
    )


def read(what: str, value: str) -> report.Evidence:
    """Return evidence read from the device, verbatim."""
    return report.Evidence(type=report.EvidenceType.READ, what=what, value=value)


def measured_evidence(what: str, value: str) -> report.Evidence:
    """Return evidence measured by this tool."""
    return report.Evidence(type=report.EvidenceType.MEASURED, what=what, value=value)


def declared_evidence(what: str, value: str) -> report.Evidence:
    """Return evidence from the inventory."""
    return report.Evidence(type=report.EvidenceType.DECLARED, what=what, value=value)


def join_words(words: Iterable[str]) -> str:
    """Join words: `a`, `a and b`, `a, b and c`."""
    every = list(words)
    return conjunction(filter(None, (join(", ", every[:-1]), *every[-1:])))


_TRUE = frozenset({"true", "yes"})
_GONE_STATES = frozenset({"FAILED", "INCOMPLETE"})
_STALE = "STALE"
"""State of an entry in the kernel; RouterOS has the same `status` in lower case."""


@dataclass(frozen=True, slots=True)
class InterfaceAddress:
    """An address of an interface."""

    interface: str
    address: IPv4Interface
    is_leased: bool
    """Whether a DHCP server assigned it, and may withdraw it."""
    dead: bool = False
    """Whether it is disabled or invalid."""
    flags: tuple[str, ...] = ()
    """Flags that a declared address does not have."""


@dataclass(frozen=True, slots=True)
class Neighbour:
    """The MAC address that responded for an address."""

    address: str
    mac: str
    """In lower case."""
    interface: str
    seen_by: str
    fresh: bool = True
    """False: the entry is old and has not been verified since."""


def yes(row: Mapping[str, str], flag: str) -> bool:
    """Return whether a flag of a row is set."""
    return row.get(flag) in _TRUE


def is_address(text: str) -> bool:
    """Return whether a text is an IPv4 address."""
    try:
        IPv4Address(text)
    except ValueError:
        return False
    return True


def rows(answer: base.Answer, who: str, what: str, key: str) -> tuple[Mapping[str, str], ...] | LinkFinding:
    """Return the rows of a RouterOS menu; rows of which none has the `key` are not of that menu."""
    if not isinstance(answer, base.Rows):
        return unreadable(who, what)
    if answer.trouble is not None:
        return silent(who, answer.trouble, answer.words)
    if answer.rows is None:
        text = msg(f": {arg(answer.words)}" if answer.words else "")
        hint = msg(f"this RouterOS version may not support it: check {arg(who)} manually")
        return unknown("refused", msg(f"{arg(who)} does not report {arg(what)}{arg(text)}"), hint)
    if answer.rows and not any(key in row for row in answer.rows):
        return unreadable(who, what)
    return answer.rows


def get_output(answer: base.Answer, who: str) -> str | LinkFinding:
    """Return the output of a program that succeeded, otherwise a finding."""
    if not isinstance(answer, base.CommandResult):
        return unreadable(who, "itself")
    if answer.trouble is not None:
        return silent(who, answer.trouble, answer.words)
    if answer.rc != 0:
        text = (answer.err.strip().splitlines() or [msg(f"exit code {arg(answer.rc)}")])[-1]
        return unknown(
            "program-failed",
            msg(f"a program on {arg(who)} failed: {arg(text[:160])}"),
            msg(f"try the same on {arg(who)} manually"),
        )
    return answer.out


def parse_json_list(answer: base.Answer, who: str, what: str) -> list[dict[str, Any]] | LinkFinding:
    """Read the JSON of iproute2: a list of objects."""
    text = get_output(answer, who)
    if isinstance(text, LinkFinding):
        return text
    try:
        result = json.loads(text or "[]")
    except (ValueError, RecursionError):
        return unreadable(who, what)
    if not isinstance(result, list) or not all(isinstance(item, dict) for item in result):
        return unreadable(who, what)
    return result


def addresses(answer: base.Answer, who: str) -> tuple[InterfaceAddress, ...] | LinkFinding:
    """Return addresses of a computer (`ip -j addr show`) or router (`/ip/address`); at least one is expected."""
    result: Iterable[Mapping[str, Any]] | LinkFinding
    if isinstance(answer, base.Rows):
        result = rows(answer, who, "its addresses", "address")
        current = () if isinstance(result, LinkFinding) else tuple(_of_router(result))
    else:
        result = parse_json_list(answer, who, "its addresses")
        current = () if isinstance(result, LinkFinding) else tuple(_parse_computer_addresses(result))
    if isinstance(result, LinkFinding):
        return result
    known_addresses = tuple(item for item in current if item is not None)
    return (
        known_addresses
        if known_addresses and len(known_addresses) == len(current)
        else unreadable(who, "its addresses")
    )


def _of_router(router_rows: Iterable[Mapping[str, str]]) -> Iterable[InterfaceAddress | None]:
    """Parse rows of a router; yield None for a row that cannot be parsed."""
    for row in router_rows:
        address = _interface(row.get("address"))
        if address is None:
            yield None
        else:
            flags = tuple(flag for flag in ("disabled", "invalid", "dynamic") if yes(row, flag))
            dead = "disabled" in flags or "invalid" in flags
            yield InterfaceAddress(row.get("interface", "?"), address, "dynamic" in flags, dead=dead, flags=flags)


def _parse_computer_addresses(result: list[dict[str, Any]]) -> Iterable[InterfaceAddress | None]:
    for row in result:
        for entry in row.get("addr_info") or ():
            if isinstance(entry, dict) and entry.get("family") == "inet":
                address = _interface(f"{entry.get('local')}/{entry.get('prefixlen')}")
                interface_address = (
                    InterfaceAddress(str(row.get("ifname", "?")), address, entry.get("dynamic") is True)
                    if address
                    else None
                )
                yield interface_address


def _interface(text: str | None) -> IPv4Interface | None:
    try:
        return IPv4Interface(text or "")
    except ValueError:
        return None


def neighbours(answer: base.Answer, who: str) -> tuple[Neighbour, ...] | LinkFinding:
    """Return neighbours: of a computer from `ip -j neigh show`, of a router from `/ip/arp`."""
    if isinstance(answer, base.Rows):
        arp_rows = rows(answer, who, "its ARP table", "address")
        return arp_rows if isinstance(arp_rows, LinkFinding) else tuple(_arp(arp_rows, who))
    result = parse_json_list(answer, who, "its neighbours")
    return result if isinstance(result, LinkFinding) else tuple(_neigh(result, who))


def _arp(arp_rows: Iterable[Mapping[str, str]], who: str) -> Iterable[Neighbour]:
    for row in arp_rows:
        address, mac = row.get("address", ""), row.get("mac-address", "")
        status = row.get("status", "").upper()
        is_gone = (
            yes(row, "disabled")
            or yes(row, "invalid")
            or row.get("complete") in {"false", "no"}
            or status in _GONE_STATES
        )
        if mac and not is_gone and is_address(address):
            yield Neighbour(address, mac.lower(), row.get("interface", "?"), who, status != _STALE)


def _neigh(result: list[dict[str, Any]], who: str) -> Iterable[Neighbour]:
    for row in result:
        address, mac, state = str(row.get("dst", "")), row.get("lladdr"), row.get("state") or ()
        if isinstance(mac, str) and is_address(address) and not _GONE_STATES & set(state):
            yield Neighbour(address, mac.lower(), str(row.get("dev", "?")), who, _STALE not in state)


def offers(answer: base.Answer, who: str) -> tuple[base.DhcpOffer, ...] | LinkFinding:
    """Return the offers of DHCP servers, or a finding."""
    if not isinstance(answer, base.DhcpOffers):
        return unreadable(who, "DHCP servers")
    if answer.trouble is not None:
        return silent(who, answer.trouble, answer.words)
    return answer.offers


def routers(answer: base.Answer, who: str) -> tuple[base.RouterAdvertisement, ...] | LinkFinding:
    """Return the advertised IPv6 routers, or a finding."""
    if not isinstance(answer, base.RouterAdvertisements):
        return unreadable(who, "IPv6 routers")
    if answer.trouble is not None:
        return silent(who, answer.trouble, answer.words)
    return answer.routers


def link_status(answer: base.Answer, who: str) -> Mapping[str, Any] | LinkFinding:
    """Return the status of a link, or a finding."""
    if not isinstance(answer, base.LinkStatusResult):
        return unreadable(who, "its links")
    if answer.trouble is not None:
        return silent(who, answer.trouble, answer.words)
    if answer.link is None:
        return unreadable(who, "its links")
    return answer.link


def active_link(site: OwnSite, results: Mapping[str, base.Answer]) -> model.Link | None:
    """Return the active link, of several the least preferred one; None if the router does not report it."""
    for link in reversed(site.site_config.bearers):
        answer = results.get(f"look {link.name}")
        if isinstance(answer, base.LinkStatusResult) and answer.link is not None and answer.link.get("active"):
            return link
    return None


@dataclass(frozen=True, slots=True)
class ComputerReadings:
    """The gateway computer, or the control centre, as in the inventory."""

    name: str
    device: model.ServerComputer

    @property
    def kind(self) -> str:
        """Type of the computer, for titles."""
        return "control centre" if isinstance(self.device, model.ControlCentre) else "gateway computer"

    @property
    def interface(self) -> str:
        """LAN interface: its name if the inventory has it, otherwise its address."""
        interface_name = self.device.network.interface if self.device.network is not None else None
        if interface_name is None and self.device.image is not None:
            interface_name = self.device.image.interface
        return interface_name or str(self.device.address)

    @property
    def is_leased(self) -> bool:
        """Whether the computer gets its address from a DHCP reservation."""
        return self.device.image is not None and self.device.image.address_by is model.AddressBy.DHCP


@dataclass(frozen=True, slots=True)
class OwnSite:
    """A site, with its router and its gateway computer."""

    inventory: Inventory
    name: str
    site_config: model.Site
    router: Host | None
    view: RouterView | None
    """View of the router."""
    gateway: ComputerReadings | None

    @property
    def device(self) -> model.Router:
        """Router model of the inventory; only for a site with a router."""
        assert self.router is not None  # noqa: S101 - steps are made for sites with a router
        return cast("model.Router", self.router.device)

    @property
    def hosts(self) -> tuple[str, ...]:
        """Names of the hosts that the checks concern."""
        return tuple(item.name for item in (self.router, self.gateway) if item is not None)


def own_site(cell: base.Cell) -> OwnSite:
    """Find router and gateway computer."""
    router, gateway = cell.router, cell.gateway
    return OwnSite(
        inventory=cell.inventory,
        name=cell.site,
        site_config=cell.site_config,
        router=router,
        view=None if router is None else router_view(cell.inventory, router),
        gateway=None
        if gateway is None
        else ComputerReadings(gateway.name, cast("model.ServerComputer", gateway.device)),
    )


def step(
    name: str, title: str, probe: base.Probe | None, concerns: tuple[str, ...] = (), unless: str = ""
) -> base.Step:
    """Return the step of an automatic check; `unless` is the reason why there is nothing to check at this site."""
    return base.Step(
        name=name,
        title=title,
        kind=report.ItemKind.AUTOMATIC,
        phase=report.Phase.BENCH,
        probe=None if unless else probe,
        unless=unless,
        concerns=concerns,
    )


def by_hand(name: str, title: str, do: str, look_for: str, concerns: tuple[str, ...]) -> base.Step:
    """Return the step of a check that applies but that no program can do at this site: a person does it."""
    return base.Step(
        name=name,
        title=title,
        kind=report.ItemKind.PERSON,
        phase=report.Phase.BENCH,
        do=do,
        look_for=look_for,
        concerns=concerns,
    )


def ask(name: str, site: OwnSite, menu: str, *properties: str) -> tuple[base.RouterOsQuery, ...]:
    """Request rows of a menu from the router; empty if the site has no router."""
    if site.router is None:
        return ()
    return (base.RouterOsQuery(name, site.router.name, Query(menu, "print", proplist=properties)),)


def run(name: str, site: OwnSite, command: str, within_s: float = 20.0) -> tuple[base.RunProgram, ...]:
    """Run a program on the gateway computer; empty if the site has no gateway."""
    return (
        (base.RunProgram(name, base.Place.GATEWAY, tuple(command.split()), within_s),)
        if site.gateway is not None
        else ()
    )


def link_requests(site: OwnSite) -> tuple[base.LinkStatusRequest, ...]:
    """Return status requests for all links of the site, named `look` and the link's name."""
    return (
        tuple(base.LinkStatusRequest(msg(f"look {arg(link.name)}"), link.name) for link in site.site_config.bearers)
        if site.router
        else ()
    )
