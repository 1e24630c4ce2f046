"""Rules for management access: how the toolkit reaches a RouterOS device, and that its firewall admits it.

Also that hosts.yml and the devices agree on what every host is, and rules for the time zone and time servers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError, available_timezones

from atlantis_netcfg.core.errors import nearest
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import _draft, model
from atlantis_netcfg.inventory._hosts import KIND_GROUPS
from atlantis_netcfg.inventory.findings import Finding, suggest
from atlantis_netcfg.inventory.rules.networks import example_in, why_unusable

if TYPE_CHECKING:
    from collections.abc import Iterator
    from ipaddress import IPv4Address


_LAN = "lan"


def technician_in_network(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that the technician's address is in the management network."""
    for name, site in draft.sites.items():
        if why := why_unusable(site.management.technician, site.management.network):
            message = msg(f"the technician's address {arg(site.management.technician)} {arg(why)}")
            hint = example_in(site.management.network)
            yield draft.finding_at(_draft.Part("site", name), ("management", "technician"), message, hint)


def technician_admitted(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that the devices' firewall admits the technician's laptop."""
    for name, site in draft.sites.items():
        outside = why_unusable(site.management.technician, site.management.network)
        if outside is None and not any(site.management.technician in network for network in site.management.admit):
            message = msg(
                "the firewall of the routers would drop the technician: no prefix contains "
                f"{arg(site.management.technician)}"
            )
            hint = msg(f"add {arg(site.management.network)}")
            yield draft.finding_at(_draft.Part("site", name), ("management", "admit"), message, hint)


def vpn_admitted(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that a device managed through the tunnel admits the infrastructure's tunnel addresses."""
    if draft.pilot is None:
        return
    pool = draft.pilot.vpn.infrastructure
    for name, site in draft.sites.items():
        if _is_reached_by_tunnel(draft, name) and not any(pool.subnet_of(prefix) for prefix in site.management.admit):
            message = msg(
                f"the firewall of the routers would drop management through the VPN: no prefix contains {arg(pool)}"
            )
            yield draft.finding_at(_draft.Part("site", name), ("management", "admit"), message, msg(f"add {arg(pool)}"))


def _is_reached_by_tunnel(draft: _draft.Draft, site: str) -> bool:
    site_router = draft.router_of(site)
    if site_router is not None and site_router[1].vpn_client is not None:
        return True
    return any(place == site and access.via != _LAN for _, place, access in _accesses(draft))


def _accesses(draft: _draft.Draft) -> Iterator[tuple[str, str, model.Access]]:
    """Yield host, site and access of every device that the toolkit configures."""
    for host, device in draft.devices.items():
        if isinstance(device, model.Router | model.Switch | model.Cpe):
            yield host, draft.layout.hosts[host], device.access


def partners_kept_out(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a prefix that lets a partner's robots manage the pilot's routers."""
    if draft.pilot is None:
        return
    network = draft.pilot.vpn.infrastructure
    for name, site in draft.sites.items():
        for index, prefix in enumerate(site.management.admit):
            pools = {partner: item.vpn_pool for partner, item in draft.partners.items()}
            inside = [
                partner for partner, pool in pools.items() if pool.overlaps(prefix) and not pool.overlaps(network)
            ]
            if inside:
                message = msg(f"{arg(prefix)} would let partners manage the routers: {arg(join(', ', inside))}")
                hint = "admit only the management network and the infrastructure pool of the VPN"
                yield draft.finding_at(_draft.Part("site", name), ("management", "admit", index), message, hint)


def router_in_network(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that a router's management address is in the management network."""
    for host, name, router in draft.valid_devices(model.Router):
        site = draft.sites.get(name)
        if site is not None and (why := why_unusable(router.access.address, site.management.network)):
            message = msg(
                f"the management address {arg(router.access.address)} {arg(why)}, the management network of "
                f"`{arg(name)}`"
            )
            hint = example_in(site.management.network)
            yield draft.finding_at(_draft.Part("device", host), ("access", "address"), message, hint)


def switch_in_lan(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that a switch's address is in the LAN and not assigned by DHCP to anyone else."""
    for host, name, switch in draft.valid_devices(model.Switch):
        site, address, part = draft.sites.get(name), switch.access.address, _draft.Part("device", host)
        if site is None:
            continue
        if why := why_unusable(address, site.lan.network):
            message = msg(f"the management address {arg(address)} {arg(why)}, the LAN of `{arg(name)}`")
            yield draft.finding_at(part, ("access", "address"), message, example_in(site.lan.network))
        elif site.lan.dhcp.first <= address <= site.lan.dhcp.last:
            message = msg(
                f"the management address {arg(address)} of `{arg(host)}` is inside the DHCP range of `{arg(name)}`"
            )
            hint = msg(f"choose one outside {arg(site.lan.dhcp.first)} to {arg(site.lan.dhcp.last)}")
            yield draft.finding_at(part, ("access", "address"), message, hint)


def via_known(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that `via` is the management port or a link of the site."""
    for host, name, access in _accesses(draft):
        site = draft.sites.get(name)
        if site is not None and access.via not in _link_names(site):
            message, hint = (
                msg(f"`{arg(access.via)}` is not a link of `{arg(name)}`"),
                suggest(access.via, _link_names(site), none=""),
            )
            yield draft.finding_at(_draft.Part("device", host), ("access", "via"), message, hint)


def _link_names(site: model.Site) -> list[str]:
    return [_LAN, *(link.name for link in site.bearers)]


RULES: tuple[_draft.Rule, ...] = (
    technician_in_network,
    technician_admitted,
    vpn_admitted,
    partners_kept_out,
    router_in_network,
    switch_in_lan,
    via_known,
)

_GROUP_OF = {kind: group for group, kind in KIND_GROUPS.items()}


def check_groups(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that a host is in the group of its kind: playbooks select hosts by group."""
    for host, mark in draft.layout.marks.items():
        kind, result = draft.layout.kinds.get(host), draft.kind_of(host)
        if kind is None and host not in draft.layout.misspelt:
            hint = msg(
                f"add `{arg(host)}:` below `{arg(_GROUP_OF[result])}:`"
                if result is not None
                else "add it below its kind of device"
            )
            yield Finding.at(mark, msg(f"`{arg(host)}` is in no group of devices"), hint)
        elif kind is not None and result is not None and kind != result:
            group = draft.layout.kind_marks[host]
            message = msg(
                f"`{arg(host)}` is a {arg(result)}, but is in group `{arg(_GROUP_OF[kind])}` "
                f"({arg(group.file)}:{arg(group.line)})"
            )
            hint = msg(f"move it to `{arg(_GROUP_OF[result])}`, or write `kind: {arg(kind)}`")
            yield draft.finding_at(_draft.Part("device", host), ("kind",), message, hint)


def one_router(draft: _draft.Draft) -> Iterator[Finding]:
    """Require one router per site: it holds the LAN, every link and the management network."""
    for site, mark in draft.layout.sites.items():
        here = [host for host, place in draft.layout.hosts.items() if place == site]
        routers = [host for host in here if draft.kind_of(host) == "router"]
        unclear = any(draft.kind_of(host) is None for host in here)
        if not routers and not unclear:
            message = msg(f"site `{arg(site)}` has no router" if here else f"site `{arg(site)}` has no hosts")
            yield Finding.at(mark, message, "add its router, below the site and below `routers:`")
        for second in routers[1:]:
            message = msg(f"site `{arg(site)}` has a second router, the first is `{arg(routers[0])}`")
            yield Finding.at(draft.layout.marks[second], message, "a site has one router: make this a separate site")


GROUPS_RULES: tuple[_draft.Rule, ...] = (check_groups, one_router)


def zone(draft: _draft.Draft) -> Iterator[Finding]:
    """Require an IANA time zone, as RouterOS does; skip the check on a machine without the zone database."""
    if draft.pilot is None or _is_time_zone(draft.pilot.time_zone):
        return
    zones = available_timezones()
    if zones:
        near = nearest(draft.pilot.time_zone, zones)
        hint = msg(f"did you mean `{arg(near)}`?" if near else "example of a time zone: Europe/Lisbon")
        yield draft.finding_at(
            _draft.Part("pilot"), ("time_zone",), msg(f"time zone `{arg(draft.pilot.time_zone)}` does not exist"), hint
        )


def _is_time_zone(name: str) -> bool:
    try:
        ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError):  # OSError: a folder of the database, like `Europe`
        return False
    return True


def servers(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a time server that is listed twice."""
    if draft.pilot is None:
        return
    name_by_address: dict[IPv4Address, str] = {}
    for index, time_server in enumerate(draft.pilot.time_servers):
        if time_server.address in name_by_address:
            message = msg(
                f"{arg(time_server.address)} is already the address of {arg(name_by_address[time_server.address])}"
            )
            yield draft.finding_at(
                _draft.Part("pilot"), ("time_servers", index, "address"), message, "name another server"
            )
        name_by_address.setdefault(time_server.address, time_server.name)


CLOCK_RULES: tuple[_draft.Rule, ...] = (zone, servers)
