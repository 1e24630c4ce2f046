"""Traffic that may pass over a satellite link: derived from the inventory, plus additions by a person.

Derived are the VPN's public endpoint and the pilot's time servers (UDP 123), because a site that has only its
satellite left needs both: TLS refuses certificates while the clock is wrong. The far end of measurements is derived
too. The inventory names no DNS servers (the router uses none, see templates/routeros/parts/dns.rsc.j2), so none is
derived. `allow` of the link holds additions. Probe targets of a satellite pass as well: the router's own pings to
them, and nothing from the LAN.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.inventory import model

if TYPE_CHECKING:
    from collections.abc import Iterable
    from ipaddress import IPv4Address


NTP_PORT = 123
"""UDP port of NTP (RFC 5905)."""
VPN_TARGET = "VPN server"
"""Name of the derived entry for the VPN."""
FAR_END_TARGET = "far end of measurements"
"""Name of the derived entry for `pilot.qualify`."""


def derive_targets(pilot: model.Pilot) -> tuple[model.AllowedTarget, ...]:
    """Return the targets that every satellite link of the pilot admits, regardless of its `allow`."""
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
    """Return the far end of measurements at the control centre's public address; None if not configured."""
    if (qualify := pilot.qualify) is None:
        return None
    address = qualify.address or pilot.vpn.endpoint
    return model.AllowedTarget(name=FAR_END_TARGET, address=address, port=qualify.port, transport=model.Transport.UDP)


def allowed_targets(pilot: model.Pilot, link: model.Link) -> tuple[model.AllowedTarget, ...]:
    """Return all targets that a satellite link admits, derived ones first; empty for other links."""
    if not link.kind.traits.allow_list:
        return ()
    probe_targets = (model.AllowedTarget(name=f"canary {address}", address=address) for address in link.canaries)
    return (*derive_targets(pilot), *link.allow, *probe_targets)


def admits(
    targets: Iterable[model.AllowedTarget], address: IPv4Address, port: int | None, transport: model.Transport
) -> bool:
    """Return whether a target admits this traffic; `port` None means the whole address, including ICMP."""
    return any(
        target.address == address and (target.port is None or (target.port == port and target.transport is transport))
        for target in targets
    )
