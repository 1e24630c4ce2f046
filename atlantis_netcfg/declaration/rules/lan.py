"""The LAN of a site: its gateway, the DHCP range, reservations, and the hosts that stand in it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.declaration._draft import Draft, Part, Rule
from atlantis_netcfg.declaration.model import ControlCentre, Gateway, VpnServer
from atlantis_netcfg.declaration.rules._subnet import example_in, why_unusable

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.declaration.findings import Finding

__all__ = ["RULES", "LanHost"]

LanHost = Gateway | VpnServer | ControlCentre
_LAN_HOSTS = (Gateway, VpnServer, ControlCentre)
_MOST_PREFIX = 29


def gateway_in_network(draft: Draft) -> Iterator[Finding]:
    """The router's own address is a usable one of its LAN."""
    for name, site in draft.sites.items():
        if why := why_unusable(site.lan.gateway, site.lan.network):
            message = f"the gateway {site.lan.gateway} {why}"
            yield draft.wrong(Part("site", name), ("lan", "gateway"), message, example_in(site.lan.network))


def network_has_room(draft: Draft) -> Iterator[Finding]:
    """A LAN holds a router, a gateway computer and robots."""
    for name, site in draft.sites.items():
        if site.lan.network.prefixlen > _MOST_PREFIX:
            message = f"{site.lan.network} is too small for a LAN"
            hint = f"{site.lan.network.supernet(new_prefix=24)} has room for 254"
            yield draft.wrong(Part("site", name), ("lan", "network"), message, hint)


def dhcp_range(draft: Draft) -> Iterator[Finding]:
    """The range is inside the LAN, not reversed, and without the router."""
    for name, site in draft.sites.items():
        lan, part = site.lan, Part("site", name)
        outside = False
        for key, address in (("first", lan.dhcp.first), ("last", lan.dhcp.last)):
            if why := why_unusable(address, lan.network):
                outside = True
                message = f"the DHCP range's {key} address {address} {why}"
                yield draft.wrong(part, ("lan", "dhcp", key), message, example_in(lan.network))
        if outside:
            continue
        if lan.dhcp.first > lan.dhcp.last:
            message = f"the DHCP range is reversed: {lan.dhcp.first} comes after {lan.dhcp.last}"
            hint = f"first: {lan.dhcp.last}, last: {lan.dhcp.first}"
            yield draft.wrong(part, ("lan", "dhcp", "first"), message, hint)
        elif lan.dhcp.first <= lan.gateway <= lan.dhcp.last:
            message = f"the DHCP range holds the router's own address {lan.gateway}"
            yield draft.wrong(part, ("lan", "dhcp", "first"), message, f"begin after {lan.gateway}, or end before it")


def reservations_in_network(draft: Draft) -> Iterator[Finding]:
    """A reserved address is in the LAN and outside the range that goes to anybody."""
    for name, site in draft.sites.items():
        dhcp = site.lan.dhcp
        for index, reservation in enumerate(site.lan.reservations):
            path = ("lan", "reservations", index, "address")
            if why := why_unusable(reservation.address, site.lan.network):
                message = f"the reserved address {reservation.address} of `{reservation.name}` {why}"
                yield draft.wrong(Part("site", name), path, message, example_in(site.lan.network))
            elif dhcp.first <= reservation.address <= dhcp.last:
                message = f"the reserved address {reservation.address} of `{reservation.name}` is inside the DHCP range"
                hint = f"choose one outside {dhcp.first} to {dhcp.last}"
                yield draft.wrong(Part("site", name), path, message, hint)


def reservation_names(draft: Draft) -> Iterator[Finding]:
    """A name stands once in a site's reservations."""
    for name, site in draft.sites.items():
        seen: dict[str, int] = {}
        for index, reservation in enumerate(site.lan.reservations):
            first = seen.setdefault(reservation.name, index)
            if first != index:
                part = Part("site", name)
                line = draft.mark(part, "lan", "reservations", first, "name").line
                message = f"`{reservation.name}` is reserved twice, first in line {line}"
                yield draft.wrong(part, ("lan", "reservations", index, "name"), message, "remove one of the two")


def reservations_of_hosts(draft: Draft) -> Iterator[Finding]:
    """A reservation with a host's name says the same as the host."""
    for name, site in draft.sites.items():
        for index, reservation in enumerate(site.lan.reservations):
            device = draft.devices.get(reservation.name)
            if draft.layout.hosts.get(reservation.name) != name or not isinstance(device, _LAN_HOSTS):
                continue
            part, path, of_host = Part("site", name), ("lan", "reservations", index), Part("device", reservation.name)
            if device.address != reservation.address:
                reserved = f"`{reservation.name}` is reserved {reservation.address}"
                message = f"{reserved}, but {draft.where(of_host, 'address')} says {device.address}"
                yield draft.wrong(part, (*path, "address"), message, "make both the same")
            if device.mac is not None and device.mac != reservation.mac:
                message = (
                    f"`{reservation.name}` is reserved for {reservation.mac}, but {draft.where(of_host, 'mac')} says"
                )
                yield draft.wrong(part, (*path, "mac"), f"{message} {device.mac}", "make both the same")


def hosts_in_network(draft: Draft) -> Iterator[Finding]:
    """A host of the LAN has an address of it that DHCP gives to nobody else."""
    for model in _LAN_HOSTS:
        for host, name, device in draft.boxes(model):
            site = draft.sites.get(name)
            if site is None:
                continue
            part, dhcp = Part("device", host), site.lan.dhcp
            if why := why_unusable(device.address, site.lan.network):
                message = f"the address {device.address} of `{host}` {why}, the LAN of `{name}`"
                yield draft.wrong(part, ("address",), message, example_in(site.lan.network))
            elif dhcp.first <= device.address <= dhcp.last and all(
                reservation.name != host for reservation in site.lan.reservations
            ):
                message = f"the address {device.address} of `{host}` is inside the DHCP range of `{name}`"
                hint = f"choose one outside {dhcp.first} to {dhcp.last}"
                yield draft.wrong(part, ("address",), message, hint)


RULES: tuple[Rule, ...] = (
    gateway_in_network,
    network_has_room,
    dhcp_range,
    reservations_in_network,
    reservation_names,
    reservations_of_hosts,
    hosts_in_network,
)
