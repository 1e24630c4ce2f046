"""A declared computer or router as a member of the VPN: the inventory says what it is and which address it has."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.suggest import nearest
from atlantis_netcfg.declaration.model import Gateway, Router
from atlantis_netcfg.operations.vpn._check import shown
from atlantis_netcfg.vpn import names
from atlantis_netcfg.vpn.authority import CLIENT_DAYS, EnrolmentRequest
from atlantis_netcfg.vpn.client import site_link
from atlantis_netcfg.vpn.identity import KeyType, Kind, Link, Wrap

if TYPE_CHECKING:
    from ipaddress import IPv4Address

    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.operations.vpn._check import Check

__all__ = ["computers", "request_of_host"]


def request_of_host(declaration: Declaration, check: Check) -> EnrolmentRequest | None:
    """The wish; None where something is wrong, which `check` has kept."""
    for word in ("partner", "device", "kind", "vehicle", "address"):
        if check.words[word] is not None:
            check.wrong(f"`{word}=` does not go with `host=`", "the inventory says it of a declared computer")
    host = _declared(declaration, check)
    link, wrap = check.choice("link", list(Link)), check.choice("wrap", list(Wrap))
    key, days = check.choice("key", list(KeyType)), check.days()
    if host is None or check.checked(lambda: names.check_name(host.name, "host")) is None:
        return None
    router = isinstance(host.device, Router)
    return EnrolmentRequest(
        name=host.name,
        kind=Kind.ROUTER if router else Kind.HOST,
        partner=None,
        device=host.name,
        address=computers(declaration)[host.name],
        link=link or site_link(declaration, host.site),
        wrap=wrap or _usual_wrap(host),
        key=key or (KeyType.RSA if router else KeyType.EC),
        days=days or CLIENT_DAYS,
    )


def _usual_wrap(host: Host) -> Wrap:
    """A gateway's Ubuntu 20.04 has OpenVPN 2.4, which knows the shared key alone (facts 10)."""
    return Wrap.TLS_CRYPT if isinstance(host.device, Gateway) else Wrap.TLS_CRYPT_V2


def _declared(declaration: Declaration, check: Check) -> Host | None:
    typed, inside = str(check.words["host"]), computers(declaration)
    if typed in inside:
        return declaration.hosts[typed]
    there = f"those in the VPN: {', '.join(inside)}"
    if typed in declaration.hosts:
        check.wrong(f"`{typed}` is no client of the VPN: it has no tunnel address, or it is the server", there)
        return None
    near = nearest(typed, inside)
    check.wrong(f"there is no host {shown(typed)} in the inventory", f"did you mean `host={near}`?" if near else there)
    return None


def computers(declaration: Declaration) -> dict[str, IPv4Address]:
    """The declared computers that are clients of the server, with their tunnel addresses."""
    found = {name: _tunnel_address(host) for name, host in declaration.hosts.items()}
    server = declaration.pilot.vpn.server
    return {name: address for name, address in found.items() if address is not None and name != server}


def _tunnel_address(host: Host) -> IPv4Address | None:
    if isinstance(host.device, Router):
        return host.device.vpn_client.address if host.device.vpn_client is not None else None
    return getattr(host.device, "vpn_address", None)
