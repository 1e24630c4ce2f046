"""A healthy computer in a LAN, from plain values: what a gateway of a site looks like when all is well."""

from __future__ import annotations

from ipaddress import IPv4Interface
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.linux._spec import (
    AddressSpec,
    ComputerSpec,
    EchoSpec,
    InterfaceSpec,
    NeighbourSpec,
    OfferSpec,
    RouteSpec,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["lan_computer"]

_CARD = "02:00:5E:00:FA:01"
"""Of no real device."""


def lan_computer(  # noqa: PLR0913 - each is one value of a declaration
    name: str,
    *,
    address: str,
    mac: str | None,
    router: tuple[str, str],
    others: Mapping[str, str],
    tunnel: str | None = None,
    server: str | None = None,
    interface: str = "eth0",
) -> ComputerSpec:
    """`address` with its prefix length; `router` and `others`: address and MAC; `tunnel`: own address in the VPN.

    `mac`: None where nobody has declared it; `server`: address of the VPN's server in the tunnel. Everybody answers
    pings, and the router alone offers addresses.
    """
    there = {router[0]: router[1], **others}
    interfaces = [InterfaceSpec(name=interface, mac=mac or _CARD, addresses=(AddressSpec(address=address),))]
    echoes = dict.fromkeys(there, EchoSpec())
    if tunnel is not None:
        interfaces.append(InterfaceSpec(name="tun0", addresses=(AddressSpec(address=tunnel),)))
    if server is not None:
        echoes[server] = EchoSpec(rtt_ms=62.0)
    first = IPv4Interface(address).network.network_address + 100
    return ComputerSpec(
        name=name,
        interfaces=tuple(interfaces),
        routes=(RouteSpec(via=router[0], dev=interface),),
        neighbours=tuple(NeighbourSpec(address=ip, dev=interface, mac=card) for ip, card in there.items()),
        echoes=echoes,
        files={"/etc/resolv.conf": f"nameserver {router[0]}\n"},
        dhcp={interface: (OfferSpec(server=router[0], mac=router[1], address=str(first), router=router[0]),)},
    )
