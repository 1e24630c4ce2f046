"""The VPN as one router sees it: its own tunnel if it has one, and the networks that lie behind the VPN."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.render._declared import RenderError, address_in_site
from atlantis_netcfg.render.view import Forwarded, Managers, Remote, Tunnel

if TYPE_CHECKING:
    from collections.abc import Iterator
    from ipaddress import IPv4Network

    from atlantis_netcfg.declaration.model import Router, Site
    from atlantis_netcfg.render._declared import Declared, DeclaredHost

__all__ = ["forwards", "managers", "remotes", "server_in_lan", "tunnel"]


def _server(declaration: Declared) -> DeclaredHost:
    name = declaration.pilot.vpn.server
    if name not in declaration.hosts:
        raise RenderError(
            f"no host is called {name}, which pilot.vpn.server names",
            hint="see group_vars/all/pilot.yml",
        )
    return declaration.hosts[name]


def server_in_lan(declaration: Declared, host: DeclaredHost) -> bool:
    """Tell whether the VPN server stands at the router's own site."""
    return _server(declaration).site == host.site


def tunnel(declaration: Declared, router: Router) -> Tunnel | None:
    """Return the router's end of the VPN, if it is one."""
    client, vpn = router.vpn_client, declaration.pilot.vpn
    if client is None:
        return None
    return Tunnel(
        interface=f"ovpn-{_server(declaration).site}",
        connect_to=vpn.endpoint_name,
        endpoint=str(vpn.endpoint),
        port=vpn.port,
        transport=vpn.transport.value,
        cipher=vpn.cipher,
        certificate=client.certificate,
        user=client.user,
        password=client.password,
    )


def remotes(declaration: Declared, host: DeclaredHost, interface: str | None) -> tuple[Remote, ...]:
    """Return the networks behind the VPN: through `interface`, or by way of the server in the LAN, or none at all."""
    server = _server(declaration)
    gateway = interface
    if server.site == host.site:
        gateway = address_in_site(server.device, declaration.sites[host.site])
    if gateway is None:
        return ()
    return tuple(Remote(name, network, gateway) for name, network in _networks(declaration, host.site))


def _networks(declaration: Declared, here: str) -> Iterator[tuple[str, str]]:
    """Yield every network that an answer may go to: tunnel addresses, other LANs, and managers that are admitted."""
    yield "tunnel addresses", str(declaration.pilot.vpn.network)
    admit = declaration.sites[here].management.admit
    for name, site in sorted(declaration.sites.items()):
        if name == here:
            continue
        yield f"{name} LAN", str(site.lan.network)
        if any(prefix.overlaps(site.management.network) for prefix in admit):
            yield f"{name} management", str(site.management.network)


def managers(declaration: Declared, host: DeclaredHost, interface: str | None) -> Iterator[Managers]:
    """Yield who may manage the router, and where they come from; `interface` is its end of the VPN.

    A prefix counts where it is: at the technician's port, in the LAN, behind the VPN. One of no network of ours comes
    by a link. Without a way into the VPN nobody of it is admitted.
    """
    site = declaration.sites[host.site]
    local = (("", "MGMT", [site.management.network]), (" in the LAN", "LAN", [site.lan.network]))
    others = [item for name, item in declaration.sites.items() if name != host.site]
    behind = [declaration.pilot.vpn.network, *(network for other in others for network in _inner(other))]
    way_in = "VPN" if interface is not None else "LAN" if server_in_lan(declaration, host) else ""
    for prefix in site.management.admit:
        found = False
        for way, interfaces, networks in (*local, (" by the VPN", way_in, behind)):
            for network in (network for network in networks if network.overlaps(prefix)):
                found = True
                if interfaces:
                    both = max(prefix, network, key=lambda entry: entry.prefixlen)
                    yield Managers(way, interfaces, str(both))
        if not found:
            yield Managers(" from outside", "WAN", str(prefix))


def _inner(site: Site) -> tuple[IPv4Network, ...]:
    return site.lan.network, site.management.network


def forwards(declaration: Declared, host: DeclaredHost, router: Router) -> tuple[Forwarded, ...]:
    """Return the ports of our outer addresses that lead inside."""
    site = declaration.sites[host.site]
    return tuple(
        Forwarded(
            name=forward.to,
            transport=forward.transport.value,
            port=forward.port,
            to=address_in_site(_named(declaration, host, forward.to).device, site),
        )
        for forward in router.forwards
    )


def _named(declaration: Declared, host: DeclaredHost, name: str) -> DeclaredHost:
    if name not in declaration.hosts:
        raise RenderError(f"{host.name} forwards a port to {name}, and no host is called so")
    return declaration.hosts[name]
