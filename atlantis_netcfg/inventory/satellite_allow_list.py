"""What may pass over a satellite link: derived from the declaration, plus what a person adds.

Derived are the VPN's public endpoint and the pilot's time servers (UDP 123), because a site that is left with its
satellite needs both: TLS refuses certificates while the clock is wrong. So is the far end of measurements. The
declaration names no DNS servers (the router asks none, see templates/routeros/parts/dns.rsc.j2), so none is derived.
`allow` of the bearer holds additions. Canaries of a satellite pass as well: the router's own pings to them, and nothing
of the LAN.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.inventory import model

if TYPE_CHECKING:
    from collections.abc import Iterable
    from ipaddress import IPv4Address


NTP_PORT = 123
"""RFC 5905; UDP."""
VPN_TARGET = "VPN server"
"""What the derived entry of the VPN is called."""
FAR_END_TARGET = "far end of measurements"
"""What the derived entry of `pilot.qualify` is called."""


def derive_targets(pilot: model.Pilot) -> tuple[model.AllowedTarget, ...]:
    """What every satellite link of the pilot admits, whatever its `allow` says."""
    vpn = pilot.vpn
    tunnel = model.AllowedTarget(
        name=VPN_TARGET,
        address=vpn.endpoint,
        dns_name=vpn.endpoint_name,
        port=vpn.port,
        transport=vpn.transport,
    )
    times = (
        model.AllowedTarget(name=server.name, address=server.address, port=NTP_PORT, transport=model.Transport.UDP)
        for server in pilot.time_servers
    )
    far_end_target = far_end(pilot)
    return (tunnel, *times) if far_end_target is None else (tunnel, *times, far_end_target)


def far_end(pilot: model.Pilot) -> model.AllowedTarget | None:
    """Where measurements are answered, at the control centre's public address; None: nobody has declared it."""
    if (qualify := pilot.qualify) is None:
        return None
    address = qualify.address or pilot.vpn.endpoint
    return model.AllowedTarget(name=FAR_END_TARGET, address=address, port=qualify.port, transport=model.Transport.UDP)


def allowed_targets(pilot: model.Pilot, bearer: model.Bearer) -> tuple[model.AllowedTarget, ...]:
    """Everything that a satellite link admits, what is derived first; nothing for other links."""
    if not bearer.kind.traits.allow_list:
        return ()
    canaries = (model.AllowedTarget(name=f"canary {address}", address=address) for address in bearer.canaries)
    return (*derive_targets(pilot), *bearer.allow, *canaries)


def admits(
    targets: Iterable[model.AllowedTarget], address: IPv4Address, port: int | None, transport: model.Transport
) -> bool:
    """Whether one of the targets lets it pass; `port` None stands for the address as a whole, with ICMP."""
    return any(
        target.address == address and (target.port is None or (target.port == port and target.transport is transport))
        for target in targets
    )
