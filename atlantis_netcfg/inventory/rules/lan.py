"""Rules for a site's LAN: its gateway, the DHCP range, reservations, and the hosts in it.

Also unique addresses and MAC addresses.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import _draft, model
from atlantis_netcfg.inventory.rules.networks import example_in, why_unusable

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.inventory.findings import Finding

_MOST_PREFIX = 29


def gateway_in_network(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that the router's LAN address is a usable address of the LAN."""
    for name, site in draft.sites.items():
        if why := why_unusable(site.lan.gateway, site.lan.network):
            message = msg(f"the gateway {arg(site.lan.gateway)} {arg(why)}")
            yield draft.finding_at(_draft.Part("site", name), ("lan", "gateway"), message, example_in(site.lan.network))


def network_has_room(draft: _draft.Draft) -> Iterator[Finding]:
    """Require a LAN large enough for a router, a gateway computer and robots."""
    for name, site in draft.sites.items():
        if site.lan.network.prefixlen > _MOST_PREFIX:
            message = msg(f"{arg(site.lan.network)} is too small for a LAN")
            hint = msg(f"{arg(site.lan.network.supernet(new_prefix=24))} has room for 254")
            yield draft.finding_at(_draft.Part("site", name), ("lan", "network"), message, hint)


def dhcp_range(draft: _draft.Draft) -> Iterator[Finding]:
    """Require a DHCP range inside the LAN, not reversed and without the router's address."""
    for name, site in draft.sites.items():
        lan, part = site.lan, _draft.Part("site", name)
        outside = False
        for key, address in (("first", lan.dhcp.first), ("last", lan.dhcp.last)):
            if why := why_unusable(address, lan.network):
                outside = True
                message = msg(f"the {arg(key)} address {arg(address)} of the DHCP range {arg(why)}")
                yield draft.finding_at(part, ("lan", "dhcp", key), message, example_in(lan.network))
        if outside:
            continue
        if lan.dhcp.first > lan.dhcp.last:
            message = msg(f"the DHCP range is reversed: {arg(lan.dhcp.first)} comes after {arg(lan.dhcp.last)}")
            hint = msg(f"first: {arg(lan.dhcp.last)}, last: {arg(lan.dhcp.first)}")
            yield draft.finding_at(part, ("lan", "dhcp", "first"), message, hint)
        elif lan.dhcp.first <= lan.gateway <= lan.dhcp.last:
            message = msg(f"the DHCP range contains the address of the router itself, {arg(lan.gateway)}")
            yield draft.finding_at(
                part, ("lan", "dhcp", "first"), message, msg(f"start after {arg(lan.gateway)}, or end before it")
            )


def reservations_in_network(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that a reserved address is in the LAN and outside the dynamic DHCP range."""
    for name, site in draft.sites.items():
        dhcp = site.lan.dhcp
        for index, reservation in enumerate(site.lan.reservations):
            path = ("lan", "reservations", index, "address")
            if why := why_unusable(reservation.address, site.lan.network):
                message = msg(
                    f"the reserved address {arg(reservation.address)} of `{arg(reservation.name)}` {arg(why)}"
                )
                yield draft.finding_at(_draft.Part("site", name), path, message, example_in(site.lan.network))
            elif dhcp.first <= reservation.address <= dhcp.last:
                message = msg(
                    f"the reserved address {arg(reservation.address)} of `{arg(reservation.name)}` is inside the DHCP "
                    "range"
                )
                hint = msg(f"choose one outside {arg(dhcp.first)} to {arg(dhcp.last)}")
                yield draft.finding_at(_draft.Part("site", name), path, message, hint)


def reservation_names(draft: _draft.Draft) -> Iterator[Finding]:
    """Require unique names among a site's reservations."""
    for name, site in draft.sites.items():
        index_by_name: dict[str, int] = {}
        for index, reservation in enumerate(site.lan.reservations):
            first = index_by_name.setdefault(reservation.name, index)
            if first != index:
                part = _draft.Part("site", name)
                line = draft.mark(part, "lan", "reservations", first, "name").line
                message = msg(f"`{arg(reservation.name)}` is reserved twice, first in line {arg(line)}")
                yield draft.finding_at(part, ("lan", "reservations", index, "name"), message, "remove one of the two")


def reservations_of_hosts(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that a reservation named after a host agrees with that host."""
    for name, site in draft.sites.items():
        for index, reservation in enumerate(site.lan.reservations):
            device = draft.devices.get(reservation.name)
            if draft.layout.hosts.get(reservation.name) != name or not isinstance(device, model.LanBox):
                continue
            part, path, of_host = (
                _draft.Part("site", name),
                ("lan", "reservations", index),
                _draft.Part("device", reservation.name),
            )
            if device.address != reservation.address:
                text = msg(f"`{arg(reservation.name)}` has the reservation {arg(reservation.address)}")
                message = msg(f"{arg(text)}, but {arg(draft.where(of_host, 'address'))} says {arg(device.address)}")
                yield draft.finding_at(part, (*path, "address"), message, "make both equal")
            if device.mac is not None and device.mac != reservation.mac:
                message = msg(
                    f"`{arg(reservation.name)}` is reserved for {arg(reservation.mac)}, but "
                    f"{arg(draft.where(of_host, 'mac'))} says {arg(device.mac)}"
                )
                yield draft.finding_at(part, (*path, "mac"), message, "make both equal")


def hosts_in_network(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that a LAN host's address is in the LAN and not assigned by DHCP to anyone else."""
    for host, name, device in draft.valid_devices(model.LanBox):
        site = draft.sites.get(name)
        if site is None:
            continue
        part, dhcp = _draft.Part("device", host), site.lan.dhcp
        if why := why_unusable(device.address, site.lan.network):
            message = msg(f"the address {arg(device.address)} of `{arg(host)}` {arg(why)}, the LAN of `{arg(name)}`")
            yield draft.finding_at(part, ("address",), message, example_in(site.lan.network))
        elif dhcp.first <= device.address <= dhcp.last and all(
            reservation.name != host for reservation in site.lan.reservations
        ):
            message = msg(
                f"the address {arg(device.address)} of `{arg(host)}` is inside the DHCP range of `{arg(name)}`"
            )
            hint = msg(f"choose one outside {arg(dhcp.first)} to {arg(dhcp.last)}")
            yield draft.finding_at(part, ("address",), message, hint)


RULES: tuple[_draft.Rule, ...] = (
    gateway_in_network,
    network_has_room,
    dhcp_range,
    reservations_in_network,
    reservation_names,
    reservations_of_hosts,
    hosts_in_network,
)


@dataclass(frozen=True, slots=True)
class _AddressUse:
    """An address or MAC address and its owner, who may use it in more than one place."""

    value: str
    owner: str
    part: _draft.Part
    path: tuple[str | int, ...]


def addresses(draft: _draft.Draft) -> Iterator[Finding]:
    """Require unique device addresses."""
    yield from _find_duplicates(draft, _addresses(draft), "address")


def macs(draft: _draft.Draft) -> Iterator[Finding]:
    """Require unique MAC addresses; a robot keeps its MAC address and name at every site."""
    yield from _find_duplicates(draft, _macs(draft), "MAC address")


def _find_duplicates(draft: _draft.Draft, uses: Iterator[_AddressUse], what: str) -> Iterator[Finding]:
    first: dict[str, _AddressUse] = {}
    result: set[tuple[str, str]] = set()
    for use in uses:
        first_use = first.setdefault(use.value, use)
        if first_use.owner != use.owner and (use.value, use.owner) not in result:
            result.add((use.value, use.owner))
            where = draft.where(first_use.part, *first_use.path)
            message = msg(
                f"{arg(use.value)} of {arg(use.owner)} is already the {arg(what)} of {arg(first_use.owner)} "
                f"({arg(where)})"
            )
            yield draft.finding_at(use.part, use.path, message, msg(f"give each its own: {arg(what)}"))


def _addresses(draft: _draft.Draft) -> Iterator[_AddressUse]:
    for host, device in draft.devices.items():
        part = _draft.Part("device", host)
        yield from (
            _AddressUse(str(value), _owner(draft, host), part, path) for value, path in _device_addresses(device)
        )
    for name, site in draft.sites.items():
        yield from _site_addresses(draft, name, site)


def _site_addresses(draft: _draft.Draft, name: str, site: model.Site) -> Iterator[_AddressUse]:
    part, router = _draft.Part("site", name), _router(draft, name)
    yield _AddressUse(str(site.lan.gateway), router, part, ("lan", "gateway"))
    for index, site_link in enumerate(site.bearers):
        yield _AddressUse(str(site_link.address), router, part, ("bearers", index, "address"))
        yield _AddressUse(str(site_link.gateway), _far_end(draft, name, site_link), part, ("bearers", index, "gateway"))
    for index, link in enumerate(site.served_links):
        yield _AddressUse(str(link.address), router, part, ("served_links", index, "address"))
    yield _AddressUse(
        str(site.management.technician), msg(f"the technician at `{arg(name)}`"), part, ("management", "technician")
    )
    for index, reservation in enumerate(site.lan.reservations):
        here = draft.layout.hosts.get(reservation.name) == name
        owner = msg(f"`{arg(reservation.name)}`" if here else f"reservation `{arg(reservation.name)}`")
        path = ("lan", "reservations", index, "address")
        device = draft.devices.get(reservation.name)
        is_reported = here and isinstance(device, model.LanBox) and device.address != reservation.address
        if not is_reported:  # what contradicts its own host is told by the rules of the LAN
            yield _AddressUse(str(reservation.address), owner, part, path)


def _router(draft: _draft.Draft, site: str) -> str:
    site_router = draft.router_of(site)
    return msg(f"`{arg(site_router[0])}`" if site_router is not None else f"the router of `{arg(site)}`")


def _owner(draft: _draft.Draft, host: str) -> str:
    site = draft.layout.hosts[host]
    return _router(draft, site) if isinstance(draft.devices[host], model.Router) else f"`{host}`"


def _far_end(draft: _draft.Draft, name: str, site_link: model.Link) -> str:
    """Return the owner of a link's gateway address: the box at this end, or the router that serves the link."""
    for host, box in draft.devices.items():
        if not isinstance(box, model.LteRouter | model.SatelliteTerminal) or draft.layout.hosts[host] != name:
            continue
        if box.address == site_link.gateway:
            return f"`{host}`"
    if site_link.kind.traits.bridge:
        for other, site in draft.sites.items():
            if any(
                (link.network, link.address) == (site_link.network, site_link.gateway) for link in site.served_links
            ):
                return _router(draft, other)
    return msg(f"the gateway of link `{arg(site_link.name)}` at `{arg(name)}`")


def _device_addresses(device: model.Device) -> Iterator[tuple[object, tuple[str, ...]]]:
    if isinstance(device, model.Router | model.Switch | model.Cpe):
        yield device.access.address, ("access", "address")
    else:
        yield device.address, ("address",)
    if isinstance(device, model.Router) and device.vpn_client is not None:
        yield device.vpn_client.address, ("vpn_client", "address")
    if isinstance(device, model.LanBox) and device.vpn_address is not None:
        yield device.vpn_address, ("vpn_address",)


def _macs(draft: _draft.Draft) -> Iterator[_AddressUse]:
    for host, device in draft.devices.items():
        if device.mac is not None:
            yield _AddressUse(device.mac, f"`{host}`", _draft.Part("device", host), ("mac",))
    for name, site in draft.sites.items():
        for index, reservation in enumerate(site.lan.reservations):
            device_here = (
                draft.devices.get(reservation.name) if draft.layout.hosts.get(reservation.name) == name else None
            )
            if device_here is None or device_here.mac in {None, reservation.mac}:  # else told by the rules of the LAN
                yield _AddressUse(
                    reservation.mac,
                    f"`{reservation.name}`",
                    _draft.Part("site", name),
                    ("lan", "reservations", index, "mac"),
                )


UNIQUE_ADDRESSES_RULES: tuple[_draft.Rule, ...] = (addresses, macs)


def classes_have_a_queue(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a traffic class at a site without a thin link: there the router queues nothing."""
    for name, site in draft.sites.items():
        if any(link.thin for link in site.bearers):
            continue
        for index, row in enumerate(site.lan.reservations):
            if row.traffic is not model.TrafficClass.CONTROL:
                message = msg(
                    f"`{arg(row.name)}` counts as {arg(row.traffic)}, but `{arg(name)}` has no thin link where that "
                    "matters"
                )
                path = ("lan", "reservations", index, "traffic")
                hint = "remove `traffic:`; a thin link is a satellite, or sends less than 2 Mbit/s (`rate.up_kbps`)"
                yield draft.finding_at(_draft.Part("site", name), path, message, hint)


WARNINGS: tuple[_draft.Rule, ...] = (classes_have_a_queue,)
