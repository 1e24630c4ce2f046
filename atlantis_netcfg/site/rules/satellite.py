"""What may pass over the satellite: everything else is dropped at the router, because airtime is dear."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.site._draft import Draft, Part, Rule
from atlantis_netcfg.site.model import BearerKind, Transport

if TYPE_CHECKING:
    from collections.abc import Iterator
    from ipaddress import IPv4Address

    from atlantis_netcfg.site.findings import Finding
    from atlantis_netcfg.site.model import AllowedTarget, Bearer

__all__ = ["RULES"]

_NTP = 123


def only_on_satellites(draft: Draft) -> Iterator[Finding]:
    """`allow` means something on a satellite only, and a satellite needs it."""
    for name, site in draft.sites.items():
        for index, bearer in enumerate(site.bearers):
            satellite = bearer.kind is BearerKind.SATELLITE
            if bearer.allow and not satellite:
                message = f"link `{bearer.name}` is {bearer.kind}: an allow-list is for satellites only"
                yield draft.wrong(Part("site", name), ("bearers", index, "allow"), message, "remove `allow:`")
            if satellite and not bearer.allow:
                message = f"the satellite link `{bearer.name}` allows nothing, so nothing would pass"
                hint = "add `allow:` with the VPN's endpoint and the time servers"
                yield draft.wrong(Part("site", name), ("bearers", index), message, hint)


def admits_the_vpn(draft: Draft) -> Iterator[Finding]:
    """Without the VPN the site is out of reach when only the satellite is left."""
    if draft.pilot is None:
        return
    vpn = draft.pilot.vpn
    for name, index, bearer in _satellites(draft):
        if not _admitted(bearer.allow, vpn.endpoint, vpn.port, vpn.transport):
            message = f"`{bearer.name}` does not admit the VPN: {vpn.endpoint} port {vpn.port} {vpn.transport}"
            hint = _entry("VPN server", vpn.endpoint, vpn.port, vpn.transport)
            yield draft.wrong(Part("site", name), ("bearers", index, "allow"), message, hint)


def admits_the_time(draft: Draft) -> Iterator[Finding]:
    """Without time no VPN: a router has no battery clock and starts in the past, where no certificate is valid yet."""
    if draft.pilot is None:
        return
    for name, index, bearer in _satellites(draft):
        for server in draft.pilot.time_servers:
            if not _admitted(bearer.allow, server.address, _NTP, Transport.UDP):
                message = f"`{bearer.name}` does not admit the time server {server.name}; with a wrong clock TLS fails"
                hint = _entry(server.name, server.address, _NTP, Transport.UDP)
                yield draft.wrong(Part("site", name), ("bearers", index, "allow"), message, hint)


def each_once(draft: Draft) -> Iterator[Finding]:
    """No destination stands twice."""
    for name, index, bearer in _satellites(draft):
        seen: set[tuple[IPv4Address, int | None, Transport]] = set()
        for place, target in enumerate(bearer.allow):
            key = (target.address, target.port, target.transport)
            if key in seen:
                message = f"`{bearer.name}` admits {target.address} twice in the same way"
                yield draft.wrong(Part("site", name), ("bearers", index, "allow", place), message, "remove one")
            seen.add(key)


def _satellites(draft: Draft) -> Iterator[tuple[str, int, Bearer]]:
    for name, site in draft.sites.items():
        for index, bearer in enumerate(site.bearers):
            if bearer.kind is BearerKind.SATELLITE and bearer.allow:
                yield name, index, bearer


def _admitted(allow: tuple[AllowedTarget, ...], address: IPv4Address, port: int, transport: Transport) -> bool:
    return any(
        target.address == address and (target.port is None or (target.port == port and target.transport is transport))
        for target in allow
    )


def _entry(name: str, address: IPv4Address, port: int, transport: Transport) -> str:
    return f"add {{name: {name}, address: {address}, port: {port}, transport: {transport}}}"


RULES: tuple[Rule, ...] = (only_on_satellites, admits_the_vpn, admits_the_time, each_once)
