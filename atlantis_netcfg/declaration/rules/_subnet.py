"""Where an address stands in its network."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ipaddress import IPv4Address, IPv4Network

_POINT_TO_POINT = 31


def why_unusable(address: IPv4Address, network: IPv4Network) -> str | None:
    """Why a device of the network cannot have the address; None if it can. A /31 uses both of its two (RFC 3021)."""
    if address not in network:
        return f"is outside {network}"
    if network.prefixlen >= _POINT_TO_POINT:
        return None
    if address == network.network_address:
        return f"is the network's own address in {network}"
    if address == network.broadcast_address:
        return f"is the broadcast address of {network}"
    return None


def example_in(network: IPv4Network) -> str:
    """What to type for an address of the network."""
    if network.prefixlen >= _POINT_TO_POINT:
        return f"choose {network.network_address} or {network.broadcast_address}"
    return f"choose one from {network.network_address + 1} to {network.broadcast_address - 1}"
