"""Rules for the VPN: its server, the port forwarding to it, and its clients.

Also for partners in the VPN: unique names, existing services, and robots that exist.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import _draft, findings
from atlantis_netcfg.inventory._schema import DEVICES
from atlantis_netcfg.inventory._yaml import SealedSecret
from atlantis_netcfg.inventory.model import Device, LanBox, Router, Transport, VpnServer
from atlantis_netcfg.inventory.rules import networks

if TYPE_CHECKING:
    from collections.abc import Iterator
    from ipaddress import IPv4Address


_LAN_KINDS = frozenset(kind for kind, model in DEVICES.items() if issubclass(model, LanBox))
_PASSWORD_BYTES = 1000


def server(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require that the VPN server is a host that can run it."""
    if draft.pilot is None:
        return
    host = draft.pilot.vpn.server
    servers = [name for name in draft.layout.hosts if draft.kind_of(name) == "vpn_server"]
    kind = draft.kind_of(host)
    if host not in draft.layout.hosts:
        message, hint = (
            msg(f"host `{arg(host)}` does not exist"),
            findings.suggest(host, servers, none="add a host of group vpn_servers"),
        )
        yield draft.finding_at(_draft.Part("pilot"), ("vpn", "server"), message, hint)
    elif kind not in {None, "vpn_server"}:
        hint = msg(f"name a vpn_server: {arg(findings.choices(servers) or 'none available')}")
        yield draft.finding_at(_draft.Part("pilot"), ("vpn", "server"), msg(f"`{arg(host)}` is a {arg(kind)}"), hint)


def one_server(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Report a second VPN server: it would hold the same keys unnoticed."""
    if draft.pilot is None or draft.kind_of(draft.pilot.vpn.server) != "vpn_server":
        return
    for host, _, _ in draft.valid_devices(VpnServer):
        if host != draft.pilot.vpn.server:
            message = msg(f"`{arg(host)}` is a VPN server, but that of the pilot is `{arg(draft.pilot.vpn.server)}`")
            hint = "remove it from vpn_servers, or set it in `pilot.vpn.server`"
            yield draft.finding_at(_draft.Part("device", host), ("kind",), message, hint)


def require_port_forwarding(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require that the router of the server's site forwards the VPN's port to the server."""
    if draft.pilot is None or draft.kind_of(draft.pilot.vpn.server) != "vpn_server":
        return
    vpn = draft.pilot.vpn
    site_router = draft.router_of(draft.layout.hosts[vpn.server])
    if site_router is None:
        return
    host, router = site_router
    desired_forward = msg(f"{{transport: {arg(vpn.transport)}, port: {arg(vpn.port)}, to: {arg(vpn.server)}}}")
    same = [entry for entry in router.forwards if (entry.transport, entry.port) == (vpn.transport, vpn.port)]
    if any(forward.to == vpn.server for forward in same):
        return
    unknown = [index for index, item in enumerate(router.forwards) if item.to not in draft.layout.hosts]
    if not unknown:
        message = msg(
            f"`{arg(host)}` does not forward {arg(vpn.transport)} port {arg(vpn.port)} to the VPN server "
            f"`{arg(vpn.server)}`"
        )
        yield draft.finding_at(_draft.Part("device", host), ("forwards",), message, msg(f"add {arg(desired_forward)}"))


def shared_key_end(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Refuse `shared_key_until` over TCP: the server's kernel can recognise such packets over UDP only."""
    if draft.pilot is None or draft.pilot.vpn.shared_key_until is None or draft.pilot.vpn.transport is Transport.UDP:
        return
    message = "`shared_key_until` works only over UDP, but `transport` is tcp"
    yield draft.finding_at(
        _draft.Part("pilot"), ("vpn", "shared_key_until"), message, "remove it, or write `transport: udp`"
    )


def forwards(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require that a forward leads to a host of the router's own LAN, and each port to one host."""
    for host, site, router in draft.valid_devices(Router):
        part, index_by_port = _draft.Part("device", host), dict[tuple[str, int], int]()
        here = [name for name, at in draft.layout.hosts.items() if at == site and draft.kind_of(name) in _LAN_KINDS]
        for index, forward in enumerate(router.forwards):
            if forward.to not in draft.layout.hosts:
                message, hint = (
                    msg(f"host `{arg(forward.to)}` does not exist"),
                    findings.suggest(forward.to, here, none="add it to hosts.yml"),
                )
                yield draft.finding_at(part, ("forwards", index, "to"), message, hint)
            elif forward.to not in here and draft.kind_of(forward.to) is not None:
                message = msg(f"`{arg(forward.to)}` is not in the LAN of `{arg(site)}`")
                hint = msg(f"hosts of that LAN: {arg(findings.choices(here) or 'none')}")
                yield draft.finding_at(part, ("forwards", index, "to"), message, hint)
            first = index_by_port.setdefault((forward.transport, forward.port), index)
            if first != index:
                line = draft.mark(part, "forwards", first, "port").line
                message = msg(
                    f"{arg(forward.transport)} port {arg(forward.port)} is forwarded twice, first in line {arg(line)}"
                )
                yield draft.finding_at(part, ("forwards", index, "port"), message, "a port leads to one host")


def endpoint_outside(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require that the server's public address is outside the tunnel and outside the sites' private networks."""
    if draft.pilot is None:
        return
    endpoint = draft.pilot.vpn.endpoint
    for claim in networks.claims(draft):
        inner = claim.path[0] in {"vpn", "lan", "management", "served_links"}
        if inner and endpoint in claim.network:
            where = draft.where(claim.part, *claim.path)
            message = msg(
                f"the VPN endpoint {arg(endpoint)} is inside {arg(claim.what)}, {arg(claim.network)} ({arg(where)})"
            )
            hint = "set the public address at which the sites reach the server"
            yield draft.finding_at(_draft.Part("pilot"), ("vpn", "endpoint"), message, hint)


def tunnel_addresses(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require that routers, gateways and servers have tunnel addresses from the infrastructure pool."""
    if draft.pilot is None:
        return
    pool = draft.pilot.vpn.infrastructure
    for host, device in draft.devices.items():
        path: tuple[str, ...] = ("vpn_address",)
        address = device.vpn_address if isinstance(device, LanBox) else None
        if isinstance(device, Router) and device.vpn_client is not None:
            path, address = ("vpn_client", "address"), device.vpn_client.address
        if address is not None and (why := networks.why_unusable(address, pool)):
            message = msg(f"the tunnel address {arg(address)} of `{arg(host)}` {arg(why)}, the infrastructure pool")
            yield draft.finding_at(_draft.Part("device", host), path, message, networks.example_in(pool))


def users(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require a separate VPN user and certificate for every router, so that each can be revoked."""
    host_by_user: dict[str, str] = {}
    for host, _, router in draft.valid_devices(Router):
        if router.vpn_client is None:
            continue
        first = host_by_user.setdefault(router.vpn_client.user, host)
        if first != host:
            where = draft.where(_draft.Part("device", first), "vpn_client", "user")
            message = msg(f"`{arg(router.vpn_client.user)}` is already the VPN user of `{arg(first)}` ({arg(where)})")
            yield draft.finding_at(
                _draft.Part("device", host), ("vpn_client", "user"), message, msg(f"write `user: {arg(host)}`")
            )


def password_length(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require a password of at most 1000 bytes, RouterOS's limit since 7.18 (MikroTik manual, OpenVPN)."""
    for host, _, router in draft.valid_devices(Router):
        client = router.vpn_client
        if client is None or isinstance(client.password, SealedSecret):
            continue
        if len(client.password.reveal().encode()) > _PASSWORD_BYTES:
            message = msg(f"the VPN password has more than {arg(_PASSWORD_BYTES)} bytes")
            yield draft.finding_at(
                _draft.Part("device", host), ("vpn_client", "password"), message, "choose a shorter one"
            )


RULES: tuple[_draft.Rule, ...] = (
    server,
    one_server,
    require_port_forwarding,
    shared_key_end,
    forwards,
    endpoint_outside,
    tunnel_addresses,
    users,
    password_length,
)

_RESERVED_USERS = {
    "default": "the OpenVPN name for clients without a file of their own",
    "members": "the name for everybody in the server's firewall",
    "server": "the server itself",
}
_PILOT = _draft.Part("pilot")


def names(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Refuse reserved partner keys: the key prefixes its devices' names and names its firewall set."""
    for name in draft.partners:
        if name in _RESERVED_USERS:
            message = msg(f"a partner cannot be named `{arg(name)}`: in the VPN that is {arg(_RESERVED_USERS[name])}")
            part = _draft.Part("partner", name)
            yield draft.finding_at(part, (), message, "choose another key; `full_name` can be any name")


def sees(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require that the vehicles that a partner sees exist and are listed once."""
    vehicle_names = draft.names("vehicle")
    for name, partner in draft.partners.items():
        part = _draft.Part("partner", name)
        for index, vehicle in enumerate(partner.sees):
            if vehicle not in vehicle_names:
                hint = findings.suggest(vehicle, vehicle_names, none="add it to `vehicles`")
                yield draft.finding_at(part, ("sees", index), msg(f"vehicle `{arg(vehicle)}` does not exist"), hint)
            elif vehicle in partner.sees[:index]:
                yield draft.finding_at(
                    part, ("sees", index), msg(f"`{arg(vehicle)}` is twice in this list"), "remove one"
                )


def server_inside(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require an address in the VPN for its server."""
    if draft.pilot is None:
        return
    host = draft.pilot.vpn.server
    device = draft.devices.get(host)
    if isinstance(device, VpnServer) and device.vpn_address is None:
        message = msg(f"`{arg(host)}` runs the VPN but has no VPN address")
        hint = msg(f"set `vpn_address:` to one of {arg(draft.pilot.vpn.infrastructure)}")
        yield draft.finding_at(_draft.Part("device", host), (), message, hint)


def services(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require that a service's host has an address in the VPN."""
    if draft.pilot is None:
        return
    inside = [name for name, device in draft.devices.items() if _tunnel_address(device) is not None]
    for index, service in enumerate(draft.pilot.vpn.services):
        path = ("vpn", "services", index, "host")
        device = draft.devices.get(service.host)
        if service.host not in draft.layout.hosts:
            hint = findings.suggest(service.host, inside, none="add it to hosts.yml")
            yield draft.finding_at(_PILOT, path, msg(f"host `{arg(service.host)}` does not exist"), hint)
        elif device is not None and _tunnel_address(device) is None and service.host != draft.pilot.vpn.server:
            message = msg(f"partners reach services through the VPN, but `{arg(service.host)}` has no VPN address")
            yield draft.finding_at(
                _PILOT, path, message, msg(f"hosts that have one: {arg(findings.choices(inside) or 'none')}")
            )


def services_once(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require unique names of services, and one service per port of a host."""
    if draft.pilot is None:
        return
    ports, index_by_name = dict[tuple[str, str, int], int](), dict[str, int]()
    for index, service in enumerate(draft.pilot.vpn.services):
        path = ("vpn", "services", index)
        first = ports.setdefault((service.host, service.transport, service.port), index)
        if first != index:
            line = draft.mark(_PILOT, "vpn", "services", first, "port").line
            message = msg(
                f"{arg(service.transport)} port {arg(service.port)} of `{arg(service.host)}` is already used by a "
                f"service, in line {arg(line)}"
            )
            yield draft.finding_at(_PILOT, (*path, "port"), message, "remove one")
        elif (first := index_by_name.setdefault(service.name.casefold(), index)) != index:
            line = draft.mark(_PILOT, "vpn", "services", first, "name").line
            message = msg(f"`{arg(service.name)}` is already the name of a service, in line {arg(line)}")
            yield draft.finding_at(_PILOT, (*path, "name"), message, "give each its own name")


def _tunnel_address(device: Device) -> IPv4Address | None:
    if isinstance(device, Router):
        return device.vpn_client.address if device.vpn_client is not None else None
    return device.vpn_address if isinstance(device, LanBox) else None


PARTNERS_RULES: tuple[_draft.Rule, ...] = (names, sees, server_inside, services, services_once)
