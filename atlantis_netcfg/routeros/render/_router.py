"""View and text of one router.

Also here: the VPN as seen by one router: its tunnel, if it has one, and the networks behind the VPN.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.routeros.render import _links, view
from atlantis_netcfg.routeros.render._cpe import access_point, radio_name
from atlantis_netcfg.routeros.render._environment import environment

if TYPE_CHECKING:
    from collections.abc import Iterator
    from ipaddress import IPv4Network

    from jinja2 import Template


def _server(inventory: view.InventoryView) -> view.DeclaredHost:
    name = inventory.pilot.vpn.server
    if name not in inventory.hosts:
        raise view.RenderError(
            f"pilot.vpn.server names host {arg(name)}, which is not in the inventory",
            hint="see group_vars/all/pilot.yml",
        )
    return inventory.hosts[name]


def server_in_lan(inventory: view.InventoryView, host: view.DeclaredHost) -> bool:
    """Return True if the VPN server is at the router's own site."""
    return _server(inventory).site == host.site


def tunnel(inventory: view.InventoryView, router: model.Router) -> view.TunnelView | None:
    """Return the router's end of the VPN; None if it is not a VPN client."""
    client, vpn = router.vpn_client, inventory.pilot.vpn
    if client is None:
        return None
    return view.TunnelView(
        interface=f"ovpn-{_server(inventory).site}",
        connect_to=vpn.endpoint_name,
        endpoint=str(vpn.endpoint),
        port=vpn.port,
        transport=vpn.transport.value,
        cipher=vpn.cipher,
        certificate=client.certificate,
        user=client.user,
        password=client.password,
    )


def remotes(inventory: view.InventoryView, host: view.DeclaredHost, interface: str | None) -> tuple[view.Remote, ...]:
    """Return the networks behind the VPN: via `interface`, via the VPN server in the LAN, or none."""
    server = _server(inventory)
    gateway = interface
    if server.site == host.site:
        gateway = view.address_in_site(server.device, inventory.sites[host.site])
    if gateway is None:
        return ()
    return tuple(view.Remote(name, network, gateway) for name, network in _networks(inventory, host.site))


def _networks(inventory: view.InventoryView, here: str) -> Iterator[tuple[str, str]]:
    """Yield every network to which a reply may go: tunnel addresses, other LANs, and admitted managers."""
    yield "tunnel addresses", str(inventory.pilot.vpn.network)
    admit = inventory.sites[here].management.admit
    for name, site in sorted(inventory.sites.items()):
        if name == here:
            continue
        yield msg(f"{arg(name)} LAN"), str(site.lan.network)
        if any(prefix.overlaps(site.management.network) for prefix in admit):
            yield msg(f"{arg(name)} management"), str(site.management.network)


def managers(inventory: view.InventoryView, host: view.DeclaredHost, interface: str | None) -> Iterator[view.Managers]:
    """Yield who may manage the router, and from where; `interface` is its end of the VPN.

    A prefix is admitted where it belongs: at the technician's port, in the LAN, behind the VPN. A prefix of none of our
    networks comes in by a link. Without a route into the VPN nobody from it is admitted.
    """
    site = inventory.sites[host.site]
    local = (("", "MGMT", [site.management.network]), (" in the LAN", "LAN", [site.lan.network]))
    others = [item for name, item in inventory.sites.items() if name != host.site]
    behind = [inventory.pilot.vpn.network, *(network for other in others for network in _inner_networks(other))]
    way_in = "VPN" if interface is not None else "LAN" if server_in_lan(inventory, host) else ""
    for prefix in site.management.admit:
        has_network = False
        for way, interfaces, networks in (*local, (" by the VPN", way_in, behind)):
            for network in (network for network in networks if network.overlaps(prefix)):
                has_network = True
                if interfaces:
                    both = max(prefix, network, key=lambda entry: entry.prefixlen)
                    yield view.Managers(way, interfaces, str(both))
        if not has_network:
            yield view.Managers(" from outside", "WAN", str(prefix))


def _inner_networks(site: model.Site) -> tuple[IPv4Network, ...]:
    return site.lan.network, site.management.network


def forwards(
    inventory: view.InventoryView, host: view.DeclaredHost, router: model.Router
) -> tuple[view.PortForward, ...]:
    """Return the port forwards of our outer addresses: from the inventory, and for the measurement far end."""
    site, qualify = inventory.sites[host.site], inventory.pilot.qualify
    ports = [(forward.to, forward.transport, forward.port) for forward in router.forwards]
    if qualify is not None and _find_host(inventory, host, qualify.reflector).site == host.site:
        ports.append((qualify.reflector, model.Transport.UDP, qualify.port))
    return tuple(
        view.PortForward(
            name=name,
            transport=transport.value,
            port=port,
            to=view.address_in_site(_find_host(inventory, host, name).device, site),
        )
        for name, transport, port in ports
    )


def _find_host(inventory: view.InventoryView, host: view.DeclaredHost, name: str) -> view.DeclaredHost:
    if name not in inventory.hosts:
        raise view.RenderError(f"{arg(host.name)} forwards a port to {arg(name)}, which is not in the inventory")
    return inventory.hosts[name]


def router(inventory: view.InventoryView, host: view.DeclaredHost) -> str:
    """Render the desired text of one router, secrets in clear: never print it. Raises RenderError."""
    return _template().render(router=router_view(inventory, host))


@cache
def _template() -> Template:
    """Return the template, compiled once per process: that takes ten times as long as rendering."""
    return environment().get_template("routeros/router.rsc.j2")


def router_view(inventory: view.InventoryView, host: view.DeclaredHost) -> view.RouterView:
    """Prepare the template data. Raises RenderError."""
    device, site = view.router_of(host), inventory.sites[host.site]
    own_tunnel = tunnel(inventory, device)
    return view.RouterView(
        name=host.name,
        title=site.title,
        time_zone=inventory.pilot.time_zone,
        time_servers=tuple(
            view.NamedAddress(server.name, str(server.address)) for server in inventory.pilot.time_servers
        ),
        bridge=view.BRIDGE,
        ports=_links.ports(device),
        lan=_lan(inventory, host, device),
        management=_management(host.name, site, device),
        managers=tuple(managers(inventory, host, own_tunnel.interface if own_tunnel else None)),
        uplinks=_links.uplinks(host.name, device, site, inventory.pilot),
        classes=tuple(_traffic_classes(site)),
        served_links=_links.served_links(host.name, device, site),
        tunnel=own_tunnel,
        server_in_lan=server_in_lan(inventory, host),
        remotes=remotes(inventory, host, own_tunnel.interface if own_tunnel else None),
        vpn_network=str(inventory.pilot.vpn.network),
        dds_ports=_dds_ports(inventory.pilot),
        names=tuple(_names(inventory, host.site)),
        forwards=forwards(inventory, host, device),
        access_point=None if device.access_point is None else access_point(device.access_point),
        switches=tuple(
            view.NamedAddress(other.name, str(other.device.access.address))
            for other in view.hosts_of(inventory, host.site)
            if isinstance(other.device, model.Switch)
        ),
    )


def prerequisites(inventory: view.InventoryView, host: view.DeclaredHost) -> tuple[view.Prerequisite, ...]:
    """Return the ports and certificates that must exist on the device because its text refers to them."""
    device = view.router_of(host)
    own_tunnel = tunnel(inventory, device)
    certificates = [view.Prerequisite("/certificate", _links.API_CERTIFICATE, "service api-ssl uses it")]
    if own_tunnel is not None:
        reason = msg(f"{arg(own_tunnel.interface)} authenticates with it")
        certificates.append(view.Prerequisite("/certificate", own_tunnel.certificate, reason))
    return (
        *certificates,
        *(
            view.Prerequisite(
                "/interface/ethernet", port.name, msg(f"the inventory has it as a port for {arg(port.purpose)}")
            )
            for port in _links.ports(device)
        ),
        *_radio_prerequisites(device),
    )


def _radio_prerequisites(device: model.Router) -> Iterator[view.Prerequisite]:
    if device.access_point is not None:
        menus = device.access_point.menus
        yield view.Prerequisite(
            f"/interface/{menus}", radio_name(menus), "the inventory has it as an access point for vehicles"
        )


def _dds_ports(pilot: model.Pilot) -> str | None:
    return None if pilot.dds is None else f"{pilot.dds.ports[0]}-{pilot.dds.ports[-1]}"


def _lan(inventory: view.InventoryView, here: view.DeclaredHost, device: model.Router) -> view.LanView:
    lan = inventory.sites[here.site].lan
    return view.LanView(
        address=_links.in_network(lan.gateway, lan.network),
        network=str(lan.network),
        gateway=str(lan.gateway),
        domain=lan.domain,
        hosts=tuple(
            view.NamedAddress(host.name, str(host.device.address))
            for host in view.hosts_of(inventory, here.site)
            if isinstance(host.device, model.LanBox)
        ),
        ports=tuple(port.name for port in device.ports if port.use == "lan"),
        pool=f"{lan.dhcp.first}-{lan.dhcp.last}",
        lease_time_s=lan.dhcp.lease_minutes * 60,
        reservations=tuple(view.NamedAddress(row.name, str(row.address), row.mac) for row in lan.reservations),
    )


_QUEUES = {model.TrafficClass.TELEMETRY: (3, 5), model.TrafficClass.IMAGES: (5, 10), model.TrafficClass.BULK: (7, 20)}
"""Priority and share; control has 1 and a half, the rest 8 and a tenth (templates/routeros/parts/queues.rsc.j2)."""


def _traffic_classes(site: model.Site) -> Iterator[view.ClassView]:
    for kind, (priority, share) in _QUEUES.items():
        hosts = tuple(
            view.NamedAddress(row.name, str(row.address)) for row in site.lan.reservations if row.traffic is kind
        )
        if hosts:
            yield view.ClassView(kind.value, priority, share, hosts)


def _management(name: str, site: model.Site, device: model.Router) -> view.ManagementView:
    return view.ManagementView(
        port=_links.management_port(name, device),
        address=_links.in_network(device.access.address, site.management.network),
        network=str(site.management.network),
        admit=tuple(str(prefix) for prefix in site.management.admit),
        api_port=device.access.port,
        certificate=_links.API_CERTIFICATE,
    )


def _names(inventory: view.InventoryView, here: str) -> Iterator[view.NamedAddress]:
    """Yield the router's DNS entries: hosts and reservations of the site, and the VPN endpoint."""
    site, vpn = inventory.sites[here], inventory.pilot.vpn
    host_addresses = {host.name: view.address_in_site(host.device, site) for host in view.hosts_of(inventory, here)}
    reservation_addresses = {row.name: str(row.address) for row in site.lan.reservations}
    for name, address in sorted((reservation_addresses | host_addresses).items()):
        yield view.NamedAddress(f"{name}.{site.lan.domain}", address)
    yield view.NamedAddress(vpn.endpoint_name, str(vpn.endpoint))
