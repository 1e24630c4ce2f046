"""Requests that the real machine of a rehearsed gateway answers, and why the simulation answers the others.

A machine is in the joined network of a rehearsal: its addresses, its routes and what passes its tunnel are real.
"""

from __future__ import annotations

import re
from ipaddress import AddressValueError, IPv4Address, IPv4Network
from typing import Final

from atlantis_netcfg.checklist import probes

MACHINE: Final = ""
"""Limit of a request that the machine answers: none."""
_DHCP = "DHCP: servers of emulated routers do not answer packets; offers to the gateway are emulated"
_NEIGHBOURS = "neighbours: machines have other network cards than the inventory; the gateway's neighbours are emulated"
_DDS = "DDS: no ROS 2 program runs on a machine; the gateway's participants are emulated"
_FILES = "addresses after a restart: a machine keeps its network; the gateway's network files are emulated"
_CLOCK = "clock: a machine has this computer's; what sets the gateway's clock is emulated"
_RADIOS = "radios: a machine has none; the gateway's are emulated"
_VEHICLES = "vehicles: none is in the joined network; their streams, replies and declared programs are emulated"

REQUESTS: Final[tuple[tuple[re.Pattern[str], str], ...]] = (
    # command or type of the request, limit of the rehearsal
    (re.compile(r"ip -j addr show"), MACHINE),
    (re.compile(r"ip -j route show"), MACHINE),
    (re.compile(r"ip -j route get VPN"), MACHINE),
    (re.compile(r"ping .* -I tun0 VPN"), MACHINE),
    (re.compile(r"openssl storeutl .*"), MACHINE),
    (re.compile(r"ReflectRequest"), MACHINE),
    (re.compile(r"RouterSolicitRequest"), MACHINE),
    (re.compile(r"DhcpDiscoverRequest"), _DHCP),
    (re.compile(r"ip -j neigh show.*"), _NEIGHBOURS),
    (re.compile(r"DdsDiscoverRequest|cat /proc/net/udp"), _DDS),
    (re.compile(r"cat /etc/.*"), _FILES),
    (re.compile(r"timedatectl .*|chronyc .*"), _CLOCK),
    (re.compile(r"iw .*|ip -j addr show dev .*"), _RADIOS),
    (re.compile(r".*"), _VEHICLES),
)
"""Pattern of a request, and its limit; the first match applies. `VPN` stands for an address in the VPN."""


def limit_of(question: probes.Question, vpn: IPv4Network) -> str:
    """Return why the simulation answers a request to the gateway; `MACHINE` if its machine does."""
    words = question.argv if isinstance(question, probes.RunProgram) else (type(question).__name__,)
    text = " ".join("VPN" if _is_inside(word, vpn) else word for word in words)
    return next(limit for pattern, limit in REQUESTS if pattern.fullmatch(text))


def gateway_limits(probe: probes.Probe, vpn: IPv4Network) -> tuple[str, ...]:
    """Return the limit of each request of a probe to the gateway."""
    return tuple(limit_of(request, vpn) for request in probe.asks() if request.place is probes.Place.GATEWAY)


def _is_inside(word: str, network: IPv4Network) -> bool:
    try:
        return IPv4Address(word) in network
    except AddressValueError:
        return False
