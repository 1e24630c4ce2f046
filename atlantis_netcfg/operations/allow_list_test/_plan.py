"""What is tried, and how: pure, from the declaration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers.satellite import Expected, Probe
from atlantis_netcfg.declaration.model import Transport
from atlantis_netcfg.declaration.satellite_allow_list import NTP_PORT, allowed

if TYPE_CHECKING:
    from atlantis_netcfg.declaration.model import AllowedTarget, Bearer, Pilot

__all__ = ["BUDGET_BYTES", "ECHO_BYTES", "HELD", "Task", "expected_bytes", "session_bytes", "tasks"]

BUDGET_BYTES = 20_000
"""What a proof may send and receive over the satellite, counted by the router's own port counters."""
ECHO_BYTES = 84
"""One echo request as an IP packet with RouterOS' 56 bytes of data; its answer is as long."""
_ROUND_BYTES = {Probe.ICMP: 2 * ECHO_BYTES, Probe.TCP: 180, Probe.TIME: 2 * 76}
"""A round of 5 s: half a TCP connection of about six segments of 60 bytes, or one question for the time."""
HELD = (Probe.TCP, Probe.TIME)
"""What can only be tried with rows on the router for a moment."""
_READ, _READ_TARGET, _READ_LINK = 1_800, 350, 350
"""Bytes of one reading of the counters above TLS, question and answer: rules of each target, routes of each link.

Measured on emulated routers: 3.1 kB with 3 targets and 2 links, 3.8 kB with 3 links; a test holds the sum.
"""
_LOGIN, _TERMINAL, _PING, _ROWS = 100, 700, 200, 2_000
_NO_TCP = "a TCP connection needs a row of netwatch for a moment: add --try-all"
_NO_TIME = "the time client has to be made to ask over it, which needs a routing rule for a moment: add --try-all"
_FOLLOWS = "the router sends to the VPN's address over the best link, which is not the satellite now"
_QUIET = "the satellite does not carry the traffic now, so nothing asks this target over it"
_NO_UDP = "silence of UDP proves nothing, and nothing of the router's asks this target; try it by hand"


@dataclass(frozen=True, slots=True)
class Task:
    """One target and the way to try it."""

    name: str
    target: str
    """As a person would say it: `203.0.113.2 udp 1194`."""
    address: str
    port: int | None
    transport: str
    expected: Expected
    probe: Probe
    why_not: str = ""
    """Why there is no way; of probe `none` only."""


def tasks(pilot: Pilot, bearer: Bearer, *, active: bool, try_all: bool = False) -> tuple[Task, ...]:
    """What is to be tried over a satellite link; `active`: whether it carries the site's traffic now.

    `try_all`: rows may be added to the router for a moment.
    """
    how = _How(pilot, active, try_all)
    reached = (_task(target, Expected.REACHED, how) for target in allowed(pilot, bearer))
    refused = (_task(target, Expected.REFUSED, how) for target in bearer.refused_probes)
    return (*reached, *refused)


@dataclass(frozen=True, slots=True)
class _How:
    """What decides by which way a target is tried."""

    pilot: Pilot
    active: bool
    try_all: bool

    def elsewhere(self, target: AllowedTarget) -> bool:
        """Whether the router would send to it over another link."""
        return target.address == self.pilot.vpn.endpoint and not self.active

    def tells_time(self, target: AllowedTarget) -> bool:
        """Whether it is a time server of the pilot."""
        servers = {server.address for server in self.pilot.time_servers}
        return target.port == NTP_PORT and target.address in servers


def expected_bytes(planned: tuple[Task, ...], rounds: int) -> int:
    """What is sent and received at most; what is only counted costs nothing more than it does anyway."""
    return sum(_ROUND_BYTES.get(task.probe, 0) * rounds for task in planned)


def session_bytes(planned: tuple[Task, ...], rounds: int, links: int, *, open_filter: bool) -> tuple[int, int]:
    """What the session to the router carries at most, above TLS: what it always does, and the asking by turns.

    `links`: bearers of the site, each of which has its routes.
    """
    reached = [task for task in planned if task.expected is Expected.REACHED]
    read = _READ + _READ_TARGET * len(reached) + _READ_LINK * links
    turns = {task.probe for task in reached if task.probe not in (Probe.NONE, *HELD)}
    refused = sum(task.expected is Expected.REFUSED and task.probe is Probe.ICMP for task in planned)
    held = any(task.probe in HELD for task in planned)
    opened = refused if open_filter else 0
    always = _LOGIN + _TERMINAL + (2 + 2 * refused + opened + held) * (read + _PING) + (opened + held) * _ROWS
    by_turns = rounds * ((1 + (turns != {Probe.ICMP})) * bool(turns) + opened + held) * (read + _PING)
    return always, by_turns


def _task(target: AllowedTarget, expected: Expected, how: _How) -> Task:
    probe, why_not = _probe(target, expected, how)
    words = str(target.address) if target.port is None else f"{target.address} {target.transport} {target.port}"
    return Task(target.name, words, str(target.address), target.port, target.transport.value, expected, probe, why_not)


def _probe(target: AllowedTarget, expected: Expected, how: _How) -> tuple[Probe, str]:
    if target.port is None:
        return (Probe.NONE, _FOLLOWS) if how.elsewhere(target) else (Probe.ICMP, "")
    if target.transport is Transport.TCP:
        if not how.try_all:
            return Probe.NONE, _NO_TCP
        return (Probe.NONE, _FOLLOWS) if how.elsewhere(target) else (Probe.TCP, "")
    if expected is Expected.REFUSED:
        return Probe.NONE, _NO_UDP
    return _answering(target, how)


def _answering(target: AllowedTarget, how: _How) -> tuple[Probe, str]:
    """How an allowed UDP target is tried: by the answers that something of the router's own gets."""
    if how.tells_time(target) and (how.try_all or not how.active):
        return (Probe.TIME, "") if how.try_all else (Probe.NONE, _NO_TIME)
    if not how.active:
        return Probe.NONE, _QUIET
    tunnel = (target.address, target.port) == (how.pilot.vpn.endpoint, how.pilot.vpn.port)
    return (Probe.TUNNEL if tunnel else Probe.UDP_COUNTER), ""
