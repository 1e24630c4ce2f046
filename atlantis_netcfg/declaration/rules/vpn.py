"""The VPN: its server, the way in to it, and its clients."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.declaration._draft import Draft, Part, Rule
from atlantis_netcfg.declaration._near import choices, meant
from atlantis_netcfg.declaration._vault import SealedSecret
from atlantis_netcfg.declaration.model import ControlCentre, Gateway, Router, VpnServer
from atlantis_netcfg.declaration.rules._subnet import example_in, why_unusable
from atlantis_netcfg.declaration.rules.networks import claims

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.declaration.findings import Finding

__all__ = ["RULES"]

_LAN_KINDS = frozenset({"gateway", "vpn_server", "control_centre"})
_PASSWORD_BYTES = 1000


def server(draft: Draft) -> Iterator[Finding]:
    """The server is a host that can run it."""
    if draft.pilot is None:
        return
    host = draft.pilot.vpn.server
    servers = [name for name in draft.layout.hosts if draft.kind_of(name) == "vpn_server"]
    kind = draft.kind_of(host)
    if host not in draft.layout.hosts:
        message, hint = f"there is no host `{host}`", meant(host, servers, none="add a host of group vpn_servers")
        yield draft.wrong(Part("pilot"), ("vpn", "server"), message, hint)
    elif kind not in {None, "vpn_server"}:
        hint = f"name a vpn_server: {choices(servers) or 'there is none'}"
        yield draft.wrong(Part("pilot"), ("vpn", "server"), f"`{host}` is a {kind}", hint)


def one_server(draft: Draft) -> Iterator[Finding]:
    """One computer is the server: a second one would hold the same keys, and nobody would be told of it."""
    if draft.pilot is None or draft.kind_of(draft.pilot.vpn.server) != "vpn_server":
        return
    for host, _, _ in draft.boxes(VpnServer):
        if host != draft.pilot.vpn.server:
            message = f"`{host}` is a VPN server, and the pilot's is `{draft.pilot.vpn.server}`"
            hint = "take it out of vpn_servers, or name it in `pilot.vpn.server`"
            yield draft.wrong(Part("device", host), ("kind",), message, hint)


def way_in(draft: Draft) -> Iterator[Finding]:
    """The router of the server's site forwards the VPN's port to it."""
    if draft.pilot is None or draft.kind_of(draft.pilot.vpn.server) != "vpn_server":
        return
    vpn = draft.pilot.vpn
    found = draft.router_of(draft.layout.hosts[vpn.server])
    if found is None:
        return
    host, router = found
    desired = f"{{transport: {vpn.transport}, port: {vpn.port}, to: {vpn.server}}}"
    same = [entry for entry in router.forwards if (entry.transport, entry.port) == (vpn.transport, vpn.port)]
    if any(forward.to == vpn.server for forward in same):
        return
    unknown = [index for index, item in enumerate(router.forwards) if item.to not in draft.layout.hosts]
    if not unknown:
        message = f"no forward of `{host}` leads {vpn.transport} port {vpn.port} to the VPN server `{vpn.server}`"
        yield draft.wrong(Part("device", host), ("forwards",), message, f"write {desired}")


def forwards(draft: Draft) -> Iterator[Finding]:
    """A forward leads to a host of the router's own LAN, and a port leads to one host."""
    for host, site, router in draft.boxes(Router):
        part, seen = Part("device", host), dict[tuple[str, int], int]()
        here = [name for name, at in draft.layout.hosts.items() if at == site and draft.kind_of(name) in _LAN_KINDS]
        for index, forward in enumerate(router.forwards):
            if forward.to not in draft.layout.hosts:
                message, hint = f"there is no host `{forward.to}`", meant(forward.to, here, none="add it to hosts.yml")
                yield draft.wrong(part, ("forwards", index, "to"), message, hint)
            elif forward.to not in here and draft.kind_of(forward.to) is not None:
                message = f"`{forward.to}` is not in the LAN of `{site}`"
                hint = f"hosts of that LAN: {choices(here) or 'none'}"
                yield draft.wrong(part, ("forwards", index, "to"), message, hint)
            first = seen.setdefault((forward.transport, forward.port), index)
            if first != index:
                line = draft.mark(part, "forwards", first, "port").line
                message = f"{forward.transport} port {forward.port} is forwarded twice, first in line {line}"
                yield draft.wrong(part, ("forwards", index, "port"), message, "a port leads to one host")


def endpoint_outside(draft: Draft) -> Iterator[Finding]:
    """The public address of the server is not reached through its own tunnel, and is no private one of a site."""
    if draft.pilot is None:
        return
    endpoint = draft.pilot.vpn.endpoint
    for claim in claims(draft):
        inner = claim.path[0] in {"vpn", "lan", "management", "served_links"}
        if inner and endpoint in claim.network:
            where = draft.where(claim.part, *claim.path)
            message = f"the VPN's endpoint {endpoint} is inside {claim.what}, {claim.network} ({where})"
            hint = "name the public address at which the sites reach the server"
            yield draft.wrong(Part("pilot"), ("vpn", "endpoint"), message, hint)


def tunnel_addresses(draft: Draft) -> Iterator[Finding]:
    """Routers, gateways and servers have tunnel addresses of the infrastructure's pool."""
    if draft.pilot is None:
        return
    pool = draft.pilot.vpn.infrastructure
    for host, device in draft.devices.items():
        path: tuple[str, ...] = ("vpn_address",)
        address = device.vpn_address if isinstance(device, Gateway | VpnServer | ControlCentre) else None
        if isinstance(device, Router) and device.vpn_client is not None:
            path, address = ("vpn_client", "address"), device.vpn_client.address
        if address is not None and (why := why_unusable(address, pool)):
            message = f"the tunnel address {address} of `{host}` {why}, the infrastructure's pool"
            yield draft.wrong(Part("device", host), path, message, example_in(pool))


def users(draft: Draft) -> Iterator[Finding]:
    """Every router has a VPN user and a certificate of its own, so that one can be revoked."""
    seen: dict[str, str] = {}
    for host, _, router in draft.boxes(Router):
        if router.vpn_client is None:
            continue
        first = seen.setdefault(router.vpn_client.user, host)
        if first != host:
            where = draft.where(Part("device", first), "vpn_client", "user")
            message = f"`{router.vpn_client.user}` is already the VPN user of `{first}` ({where})"
            yield draft.wrong(Part("device", host), ("vpn_client", "user"), message, f"write `user: {host}`")


def password_length(draft: Draft) -> Iterator[Finding]:
    """RouterOS takes at most 1000 bytes, since 7.18 (MikroTik manual, OpenVPN)."""
    for host, _, router in draft.boxes(Router):
        client = router.vpn_client
        if client is None or isinstance(client.password, SealedSecret):
            continue
        if len(client.password.reveal().encode()) > _PASSWORD_BYTES:
            message = f"the VPN password has more than {_PASSWORD_BYTES} bytes"
            yield draft.wrong(Part("device", host), ("vpn_client", "password"), message, "choose a shorter one")


RULES: tuple[Rule, ...] = (
    server,
    one_server,
    way_in,
    forwards,
    endpoint_outside,
    tunnel_addresses,
    users,
    password_length,
)
