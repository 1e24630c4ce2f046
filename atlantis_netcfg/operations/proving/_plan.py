"""What is tried, and how: pure, from the declaration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers.satellite import Expected, Probe
from atlantis_netcfg.site.allowed import allowed
from atlantis_netcfg.site.model import Transport

if TYPE_CHECKING:
    from atlantis_netcfg.site.model import AllowedTarget, Bearer, Pilot

__all__ = ["BUDGET_BYTES", "ECHO_BYTES", "Task", "expected_bytes", "tasks"]

BUDGET_BYTES = 20_000
"""What a proof may send and receive over the satellite, counted by the router's own port counters."""
ECHO_BYTES = 84
"""One echo request as an IP packet with RouterOS' 56 bytes of data; its answer is as long."""
_NO_TCP = "RouterOS has no one-shot TCP connection over its API; try it by hand from the LAN"
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


def tasks(pilot: Pilot, bearer: Bearer, *, active: bool) -> tuple[Task, ...]:
    """What is to be tried over a satellite link; `active`: whether it carries the site's traffic now."""
    reached = (_task(target, Expected.REACHED, pilot, active=active) for target in allowed(pilot, bearer))
    refused = (_task(target, Expected.REFUSED, pilot, active=active) for target in bearer.refused_probes)
    return (*reached, *refused)


def expected_bytes(planned: tuple[Task, ...], rounds: int) -> int:
    """What the pings send and receive at most; what is only counted costs nothing more than it does anyway."""
    return sum(2 * ECHO_BYTES * rounds for task in planned if task.probe is Probe.ICMP)


def _task(target: AllowedTarget, expected: Expected, pilot: Pilot, *, active: bool) -> Task:
    probe, why_not = _probe(target, expected, pilot, active=active)
    words = str(target.address) if target.port is None else f"{target.address} {target.transport} {target.port}"
    return Task(target.name, words, str(target.address), target.port, target.transport.value, expected, probe, why_not)


def _probe(target: AllowedTarget, expected: Expected, pilot: Pilot, *, active: bool) -> tuple[Probe, str]:
    if target.port is None:
        blocked = target.address == pilot.vpn.endpoint and not active
        return (Probe.NONE, _FOLLOWS) if blocked else (Probe.ICMP, "")
    if target.transport is Transport.TCP:
        return Probe.NONE, _NO_TCP
    if expected is Expected.REFUSED:
        return Probe.NONE, _NO_UDP
    if not active:
        return Probe.NONE, _QUIET
    tunnel = (target.address, target.port) == (pilot.vpn.endpoint, pilot.vpn.port)
    return (Probe.TUNNEL if tunnel else Probe.UDP_COUNTER), ""
