"""Addresses and network cards belong to one device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.declaration._draft import Draft, Part, Rule
from atlantis_netcfg.declaration.model import (
    BearerKind,
    ControlCentre,
    Cpe,
    Gateway,
    LteRouter,
    Router,
    SatelliteTerminal,
    VpnServer,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.declaration.findings import Finding
    from atlantis_netcfg.declaration.model import Bearer, Device, Site

__all__ = ["RULES"]


@dataclass(frozen=True, slots=True)
class _Use:
    """A value, and whose it is. One owner may use it in more than one place."""

    value: str
    owner: str
    part: Part
    path: tuple[str | int, ...]


def addresses(draft: Draft) -> Iterator[Finding]:
    """No two devices have one address."""
    yield from _twice(draft, _addresses(draft), "address")


def macs(draft: Draft) -> Iterator[Finding]:
    """No two devices have one MAC address. A robot keeps its own, and its name, at every site."""
    yield from _twice(draft, _macs(draft), "MAC address")


def _twice(draft: Draft, uses: Iterator[_Use], what: str) -> Iterator[Finding]:
    first: dict[str, _Use] = {}
    result: set[tuple[str, str]] = set()
    for use in uses:
        known = first.setdefault(use.value, use)
        if known.owner != use.owner and (use.value, use.owner) not in result:
            result.add((use.value, use.owner))
            where = draft.where(known.part, *known.path)
            message = f"{use.value} of {use.owner} is already the {what} of {known.owner} ({where})"
            yield draft.wrong(use.part, use.path, message, f"give each its own {what}")


def _addresses(draft: Draft) -> Iterator[_Use]:
    for host, device in draft.devices.items():
        part = Part("device", host)
        yield from (_Use(str(value), _owner(draft, host), part, path) for value, path in _of_device(device))
    for name, site in draft.sites.items():
        yield from _of_site(draft, name, site)


def _of_site(draft: Draft, name: str, site: Site) -> Iterator[_Use]:
    part, router = Part("site", name), _router(draft, name)
    yield _Use(str(site.lan.gateway), router, part, ("lan", "gateway"))
    for index, bearer in enumerate(site.bearers):
        yield _Use(str(bearer.address), router, part, ("bearers", index, "address"))
        yield _Use(str(bearer.gateway), _far_end(draft, name, bearer), part, ("bearers", index, "gateway"))
    for index, link in enumerate(site.served_links):
        yield _Use(str(link.address), router, part, ("served_links", index, "address"))
    yield _Use(str(site.management.technician), f"the technician at `{name}`", part, ("management", "technician"))
    for index, reservation in enumerate(site.lan.reservations):
        here = draft.layout.hosts.get(reservation.name) == name
        owner = f"`{reservation.name}`" if here else f"reservation `{reservation.name}`"
        path = ("lan", "reservations", index, "address")
        device = draft.devices.get(reservation.name)
        is_reported = (
            here and isinstance(device, Gateway | VpnServer | ControlCentre) and device.address != reservation.address
        )
        if not is_reported:  # what contradicts its own host is told by the rules of the LAN
            yield _Use(str(reservation.address), owner, part, path)


def _router(draft: Draft, site: str) -> str:
    found = draft.router_of(site)
    return f"`{found[0]}`" if found is not None else f"the router of `{site}`"


def _owner(draft: Draft, host: str) -> str:
    site = draft.layout.hosts[host]
    return _router(draft, site) if isinstance(draft.devices[host], Router) else f"`{host}`"


def _far_end(draft: Draft, name: str, bearer: Bearer) -> str:
    """Who answers at the bearer's gateway: the box at this end, or the router that serves the link."""
    for host, box in draft.devices.items():
        if not isinstance(box, LteRouter | SatelliteTerminal) or draft.layout.hosts[host] != name:
            continue
        if box.address == bearer.gateway:
            return f"`{host}`"
    if bearer.kind is BearerKind.WIFI_PTP:
        for other, site in draft.sites.items():
            if any((link.network, link.address) == (bearer.network, bearer.gateway) for link in site.served_links):
                return _router(draft, other)
    return f"the gateway of link `{bearer.name}` at `{name}`"


def _of_device(device: Device) -> Iterator[tuple[object, tuple[str, ...]]]:
    if isinstance(device, Router | Cpe):
        yield device.access.address, ("access", "address")
    else:
        yield device.address, ("address",)
    if isinstance(device, Router) and device.vpn_client is not None:
        yield device.vpn_client.address, ("vpn_client", "address")
    if isinstance(device, Gateway | VpnServer | ControlCentre) and device.vpn_address is not None:
        yield device.vpn_address, ("vpn_address",)


def _macs(draft: Draft) -> Iterator[_Use]:
    for host, device in draft.devices.items():
        if device.mac is not None:
            yield _Use(device.mac, f"`{host}`", Part("device", host), ("mac",))
    for name, site in draft.sites.items():
        for index, reservation in enumerate(site.lan.reservations):
            device_here = (
                draft.devices.get(reservation.name) if draft.layout.hosts.get(reservation.name) == name else None
            )
            if device_here is None or device_here.mac in {None, reservation.mac}:  # else told by the rules of the LAN
                yield _Use(
                    reservation.mac, f"`{reservation.name}`", Part("site", name), ("lan", "reservations", index, "mac")
                )


RULES: tuple[Rule, ...] = (addresses, macs)
