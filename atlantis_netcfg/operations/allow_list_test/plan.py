"""The plan of an allow-list test: targets, probes, and what is read from the router."""

from __future__ import annotations

import asyncio
import socket
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceError, NoMatchError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.packets import ECHO_BYTES
from atlantis_netcfg.inventory import model, satellite_allow_list
from atlantis_netcfg.links import satellite
from atlantis_netcfg.links.policy import ROUTE_PROPERTIES
from atlantis_netcfg.links.standing_traffic import NTP_BYTES
from atlantis_netcfg.routeros.api import Command, Reply

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.routeros._types import Row


MARK = "atlantis: for a proof, taken back after it"
"""Comment of the temporary rows, by which a person can identify them."""
BUDGET_BYTES = 20_000
"""Maximum number of bytes of a test over the satellite in both directions, by the router's port counters."""
_ROUND_BYTES = {
    satellite.SatelliteProbe.ICMP: 2 * ECHO_BYTES,
    satellite.SatelliteProbe.TCP: 180,
    satellite.SatelliteProbe.TIME: 2 * NTP_BYTES,
}
"""Bytes of a 5 s round: half a TCP connection of about six segments of 60 bytes, or one NTP request and response."""
VPN_BYTES = 6 * 600
"""Requests to the VPN server: 390 bytes, and a response that is sent twice if the server keeps the session."""
TEMPORARY_ROWS = (satellite.SatelliteProbe.TCP, satellite.SatelliteProbe.TIME, satellite.SatelliteProbe.VPN)
"""Probes that need temporary rows on the router."""
_READ, _READ_TARGET, _READ_LINK = 1_800, 350, 350
"""Bytes of one counter reading above TLS, request and response: fixed, per target (rules), per link (routes).

Measured on emulated routers: 3.1 kB with 3 targets and 2 links, 3.8 kB with 3 links; a test checks the sum.
"""
_LOGIN, _TERMINAL, _PING, _ROWS = 100, 700, 200, 2_000
_NO_TCP = "a TCP connection needs a temporary netwatch row"
_NO_VPN = "this computer's test over that link needs a temporary routing rule"
_NO_TIME = "a time request over it needs a temporary routing rule"
_FOLLOWS = "the router reaches the VPN server over the best link, which is not the satellite now"
_QUIET = "the satellite is not the active link now, so nothing contacts this target over it"
_NO_UDP = "no UDP response proves nothing, and the router itself does not use this target; test it by hand"


@dataclass(frozen=True, slots=True)
class Task:
    """One target and how it is probed."""

    name: str
    target: str
    """Readable target: `203.0.113.2 udp 1194`."""
    address: str
    port: int | None
    transport: str
    expectation: satellite.ExpectedOutcome
    probe: satellite.SatelliteProbe
    why_not: str = ""
    """Why the target cannot be probed; only for probe `none`."""
    hint: str = ""
    """What would make the probe possible."""


def tasks(pilot: model.Pilot, link: model.Link, *, active: bool, try_all: bool = False) -> tuple[Task, ...]:
    """Return the probes of a satellite link; `active`: it carries the site's traffic now.

    `try_all`: rows may be added to the router temporarily. The far end of measurements is left to `provision measure
    link`: it responds only to holders of its key, and a router has none.
    """
    how = _ProbeContext(pilot, link.name, active, try_all)
    far_target = satellite_allow_list.far_end(pilot)
    allowed_tasks = (
        _task(target, satellite.ExpectedOutcome.REACHED, how)
        for target in satellite_allow_list.allowed_targets(pilot, link)
        if target != far_target
    )
    blocked_tasks = (_task(target, satellite.ExpectedOutcome.REFUSED, how) for target in link.refused_probes)
    return (*allowed_tasks, *blocked_tasks)


@dataclass(frozen=True, slots=True)
class _ProbeContext:
    """The facts that decide how a target is probed."""

    pilot: model.Pilot
    link: str
    active: bool
    try_all: bool

    def hint(self, why_not: str) -> str:
        """Return the command that makes a target testable; empty if there is none."""
        if why_not in {_NO_TCP, _NO_TIME, _NO_VPN}:
            return "`provision measure satellite site=… --try-all` tests it"
        if why_not in {_QUIET, _FOLLOWS}:
            return msg(
                f"`provision links use site=… link={arg(self.link)} for=10m --unproved` makes it the active link; then "
                "run the same command again"
            )
        return ""

    def uses_other_link(self, target: model.AllowedTarget) -> bool:
        """Return whether the router would use another link for the target."""
        return target.address == self.pilot.vpn.endpoint and not self.active

    def is_time_server(self, target: model.AllowedTarget) -> bool:
        """Return whether the target is a time server of the pilot."""
        servers = {server.address for server in self.pilot.time_servers}
        return target.port == satellite_allow_list.NTP_PORT and target.address in servers


def expected_bytes(all_tasks: tuple[Task, ...], rounds: int) -> int:
    """Return the upper limit of bytes sent and received; targets that are only counted add nothing."""
    return sum(_ROUND_BYTES.get(task.probe, 0) * rounds for task in all_tasks)


def reading_bytes(all_tasks: tuple[Task, ...], links: int) -> int:
    """Return the upper limit of bytes for one reading of the counters, above TLS."""
    allowed_count = sum(task.expectation is satellite.ExpectedOutcome.REACHED for task in all_tasks)
    return _READ + _READ_TARGET * allowed_count + _READ_LINK * links


def session_bytes(all_tasks: tuple[Task, ...], rounds: int, links: int, *, open_filter: bool) -> tuple[int, int]:
    """Return the session's upper limits of bytes above TLS: the fixed part, and the part of the probe rounds.

    `links`: links of the site, each of which has its routes.
    """
    allowed_tasks = [task for task in all_tasks if task.expectation is satellite.ExpectedOutcome.REACHED]
    read = reading_bytes(all_tasks, links)
    turns = {task.probe for task in allowed_tasks if task.probe not in (satellite.SatelliteProbe.NONE, *TEMPORARY_ROWS)}
    blocked_count = sum(
        task.expectation is satellite.ExpectedOutcome.REFUSED and task.probe is satellite.SatelliteProbe.ICMP
        for task in all_tasks
    )
    temporary = any(task.probe in TEMPORARY_ROWS for task in all_tasks)
    open_count = blocked_count if open_filter else 0
    always = (
        _LOGIN
        + _TERMINAL
        + (2 + 2 * blocked_count + open_count + temporary) * (read + _PING)
        + (open_count + temporary) * _ROWS
    )
    by_turns = (
        rounds
        * ((1 + (turns != {satellite.SatelliteProbe.ICMP})) * bool(turns) + open_count + temporary)
        * (read + _PING)
    )
    return always, by_turns


def _task(target: model.AllowedTarget, expectation: satellite.ExpectedOutcome, how: _ProbeContext) -> Task:
    probe, why_not = _probe(target, expectation, how)
    words = str(target.address) if target.port is None else f"{target.address} {target.transport} {target.port}"
    return Task(
        target.name,
        words,
        str(target.address),
        target.port,
        target.transport.value,
        expectation,
        probe,
        why_not,
        how.hint(why_not),
    )


def _probe(
    target: model.AllowedTarget, expectation: satellite.ExpectedOutcome, how: _ProbeContext
) -> tuple[satellite.SatelliteProbe, str]:
    if target.port is None:
        return (
            (satellite.SatelliteProbe.NONE, _FOLLOWS)
            if how.uses_other_link(target)
            else (satellite.SatelliteProbe.ICMP, "")
        )
    if target.transport is model.Transport.TCP:
        if not how.try_all:
            return satellite.SatelliteProbe.NONE, _NO_TCP
        return satellite.SatelliteProbe.TCP, ""
    if expectation is satellite.ExpectedOutcome.REFUSED:
        return satellite.SatelliteProbe.NONE, _NO_UDP
    return _answering(target, how)


def _answering(target: model.AllowedTarget, how: _ProbeContext) -> tuple[satellite.SatelliteProbe, str]:
    """Return how an allowed UDP target is probed: by responses to the router's own requests."""
    if how.is_time_server(target) and (how.try_all or not how.active):
        return (satellite.SatelliteProbe.TIME, "") if how.try_all else (satellite.SatelliteProbe.NONE, _NO_TIME)
    tunnel = (target.address, target.port) == (how.pilot.vpn.endpoint, how.pilot.vpn.port)
    if not how.active and tunnel:
        return (satellite.SatelliteProbe.VPN, "") if how.try_all else (satellite.SatelliteProbe.NONE, _NO_VPN)
    if not how.active:
        return satellite.SatelliteProbe.NONE, _QUIET
    return (satellite.SatelliteProbe.TUNNEL if tunnel else satellite.SatelliteProbe.UDP_COUNTER), ""


_TRUE = frozenset({"true", "yes"})
_RULE = ".id,chain,action,comment,packets,src-address,src-port,dst-address,dst-port,protocol"


@dataclass(frozen=True, slots=True)
class CounterReading:
    """The router's counters at one moment: packets and bytes since creation or reset."""

    port_bytes: int
    """Bytes in both directions."""
    port_name: str
    """Current name of the port, which is identified by its default name."""
    rules: tuple[Row, ...]
    """Rules of the satellite's two firewall chains."""
    routes: tuple[Row, ...]
    tunnels: tuple[Row, ...]

    def chain(self, name: str) -> tuple[Row, ...]:
        """Return the rules of a chain, in their order."""
        return tuple(row for row in self.rules if row.get("chain") == name)

    @property
    def tunnel_up(self) -> bool | None:
        """Whether one of the router's OpenVPN tunnels runs; None if it has none."""
        return any(row.get("running") in _TRUE for row in self.tunnels) if self.tunnels else None

    def drop_count(self, chain: str) -> int:
        """Return the packets counted by the drop rules of a chain."""
        return sum(_number(row, "packets") for row in self.chain(chain) if row.get("action") == "drop")

    def answers(self, chain: str, task: Task) -> int:
        """Return the packets received from a target, by the rule that admits its responses."""
        return self._packet_count(chain, task, "src")

    def questions(self, chain: str, task: Task) -> int:
        """Return the packets sent to a target, by the rule that admits them."""
        return self._packet_count(chain, task, "dst")

    def went_out(self, chain: str, task: Task, before: CounterReading) -> bool | None:
        """Return whether packets to a target were counted since `before`; None if no rule counts them."""
        if not any(self._is_rule(row, task, "dst") for row in self.chain(chain)):
            return None
        return self.questions(chain, task) > before.questions(chain, task)

    def _packet_count(self, chain: str, task: Task, side: str) -> int:
        return sum(_number(row, "packets") for row in self.chain(chain) if self._is_rule(row, task, side))

    @staticmethod
    def _is_rule(row: Row, task: Task, side: str) -> bool:
        """Return whether a rule admits and counts a target's packets."""
        unique = {f"{side}-address": task.address, f"{side}-port": str(task.port), "protocol": task.transport}
        return row.get("action") == "return" and all(row.get(name) == value for name, value in unique.items())


def reads(port: str, chains: Sequence[str]) -> tuple[Command, ...]:
    """Return the read commands to send together; `read` parses the replies in this order."""
    both = (*(f"?chain={chain}" for chain in chains), "?#|")
    return (
        Command("/interface/print", ((".proplist", "name,default-name,rx-byte,tx-byte"),), (f"?default-name={port}",)),
        Command("/ip/firewall/filter/print", ((".proplist", _RULE),), both),
        Command("/ip/route/print", ((".proplist", ",".join(ROUTE_PROPERTIES)),), ("?dst-address=0.0.0.0/0",)),
        Command("/interface/ovpn-client/print", ((".proplist", "name,running"),)),
    )


def read(port: str, replies: Sequence[Reply]) -> CounterReading:
    """Parse the replies to `reads`; raise DeviceError if the port is missing or a read was refused."""
    interfaces, rules, routes, tunnels = (reply.check().rows for reply in replies)
    interface = next((row for row in interfaces if row.get("default-name") == port), None)
    if interface is None or "rx-byte" not in interface or "tx-byte" not in interface:
        raise DeviceError(
            f"the router reports no byte counters for port {arg(port)}; without them nothing is sent",
            hint=(
                "does the inventory have the right port for the satellite's cable? `provision report drift site=…` "
                "compares it"
            ),
        )
    return CounterReading(
        port_name=interface.get("name", port),
        port_bytes=_number(interface, "rx-byte") + _number(interface, "tx-byte"),
        rules=tuple(rules),
        routes=tuple(routes),
        tunnels=tuple(tunnels),
    )


def ping(address: str, source: str, count: int = 1) -> Command:
    """Return a ping from the link's own address; `/tool/ping` exists in all versions, `/ping` was removed in 7.23."""
    return Command("/tool/ping", (("address", address), ("src-address", source), ("count", str(count))))


def factory_ping(address: str, port: str) -> Command:
    """Return an ARP ping for an address on a port, given by its current name.

    It costs no airtime, and needs no address in that network.
    """
    return Command("/tool/ping", (("address", address), ("arp-ping", "yes"), ("interface", port), ("count", "2")))


def has_answer(reply: Reply) -> bool:
    """Return whether an echo reply was received; the router's refusal to send counts as none."""
    rows = reply.rows if reply.trap is None else ()
    return any(_number(row, "received") > 0 for row in rows)


def _number(row: Row, name: str) -> int:
    text = row.get(name, "")
    return int(text) if text.isdecimal() else 0


TIMEOUT_S = 10.0
"""Timeout in seconds for all DNS names together; a resolver that has not responded by then counts as silent."""


def named_targets(inventory: Inventory, site: str, link: model.Link) -> tuple[satellite.NamedTarget, ...]:
    """Return the entries of a link's allow-list that have a DNS name, including the VPN's."""
    return tuple(
        satellite.NamedTarget(
            target.name,
            target.dns_name,
            str(target.address),
            msg(
                "pilot.vpn in group_vars/all/pilot.yml"
                if target.name == satellite_allow_list.VPN_TARGET and target.address == inventory.pilot.vpn.endpoint
                else f"`allow` of `{arg(link.name)}` in group_vars/{arg(site)}.yml"
            ),
        )
        for target in satellite_allow_list.allowed_targets(inventory.pilot, link)
        if target.dns_name is not None
    )


def _ask(name: str) -> frozenset[str] | None:
    """Return a name's IPv4 addresses; empty if it does not exist, None if the lookup failed."""
    try:
        records = socket.getaddrinfo(name, None, family=socket.AF_INET, type=socket.SOCK_STREAM)
    except socket.gaierror as error:
        not_found_codes = (socket.EAI_NONAME, getattr(socket, "EAI_NODATA", socket.EAI_NONAME))
        return frozenset() if error.errno in not_found_codes else None
    except OSError:
        return None
    return frozenset(str(address[4][0]) for address in records)


async def resolve(
    names: Iterable[str],
    *,
    timeout_s: float = TIMEOUT_S,
    ask: Callable[[str], frozenset[str] | None] = _ask,
) -> Mapping[str, frozenset[str] | None]:
    """Resolve all names at once with this computer's resolver; None for a name that times out.

    A computer without network also reports that a name does not exist: the result is only as good as its resolver.
    """
    unique = tuple(dict.fromkeys(names))
    work = {name: asyncio.ensure_future(asyncio.to_thread(ask, name)) for name in unique}
    if work:
        await asyncio.wait(work.values(), timeout=timeout_s)
    result: dict[str, frozenset[str] | None] = {}
    for name, work_item in work.items():
        is_complete = work_item.done() and not work_item.cancelled()
        work_item.cancel()
        result[name] = work_item.result() if is_complete else None
    return result


class NothingToProve(NoMatchError):
    """The site has no such satellite link, or no router that could test it."""
