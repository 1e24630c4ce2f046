"""A member's whole `.ovpn`: nothing beside it is needed, and nothing in it is for another member."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.declaration.model import Transport, VpnServer
from atlantis_netcfg.render import environment
from atlantis_netcfg.vpn.enrolment_package._identity import header, inline
from atlantis_netcfg.vpn.identity import Kind, Link, Wrap

if TYPE_CHECKING:
    from ipaddress import IPv4Address

    from atlantis_netcfg.declaration import Declaration
    from atlantis_netcfg.vpn.identity import Identity, Member

__all__ = ["day", "is_declared", "profile", "remote", "server_name"]

_RETRY_MAX_S = {Link.FIBRE: 300, Link.LTE: 300, Link.SATELLITE: 900}
"""`connect-retry`'s longest pause: a refused device costs 12 kB an attempt, more than a healthy one's day (facts 9)."""
_UNATTENDED = frozenset({Kind.ROBOT, Kind.ROUTER, Kind.HOST})


@dataclass(frozen=True, slots=True)
class _ProfileView:
    """What the template prints.

    `tun-mtu` is no part of it: both ends have to agree, OpenVPN below 2.6 and RouterOS do not take it from the server,
    and DDS messages of the pilot are small enough for every link (facts 9), while `mssfix` sees to TCP.
    """

    title: str
    header: str
    proto: str
    remote: IPv4Address
    port: int
    dev: str
    server: str
    old_words: bool
    unattended: bool
    retry_max_s: int
    slow: bool
    blocks: Secret


def profile(declaration: Declaration, identity: Identity) -> Secret:
    """The text of a member's `.ovpn`, for OpenVPN 2.5 and later.

    A shared tls-crypt key (`certificate.wrap`) is issued to clients that know no other, OpenVPN 2.4 among them: with it
    the profile uses words that 2.4 knows as well. Nothing else chooses between the two.
    """
    template = environment().get_template("handout/profile.ovpn.j2")
    return Secret(template.render(view=_view(declaration, identity)))


def server_name(declaration: Declaration) -> str:
    """Common name of the server's certificate, which every profile insists on: the inventory's name of the host."""
    return declaration.pilot.vpn.server


def is_declared(member: Member) -> bool:
    """Whether it is a host of the inventory: a role brings its identity there, and nobody installs it by hand."""
    return member.kind is Kind.HOST or (member.kind is Kind.ROUTER and member.partner is None)


def remote(declaration: Declaration, member: Member) -> IPv4Address:
    """Where a member reaches the server: at its public address, and a host of the server's own site in its LAN."""
    vpn = declaration.pilot.vpn
    server, host = declaration.hosts[vpn.server], declaration.hosts.get(member.name)
    beside = is_declared(member) and host is not None and host.site == server.site
    return server.device.address if beside and isinstance(server.device, VpnServer) else vpn.endpoint


def day(identity: Identity) -> str:
    """Last day on which the certificate is good for all of it, in UTC."""
    return f"{identity.certificate.not_after:%Y-%m-%d}"


def _view(declaration: Declaration, identity: Identity) -> _ProfileView:
    vpn, member = declaration.pilot.vpn, identity.member
    return _ProfileView(
        title=f"VPN of {declaration.pilot.name}: {member.name}, address {member.address}, until {day(identity)}.",
        header=header(identity),
        proto="udp4" if vpn.transport is Transport.UDP else "tcp4-client",
        remote=remote(declaration, member),
        port=vpn.port,
        dev="tun0" if member.kind is Kind.HOST else "tun",
        server=server_name(declaration),
        old_words=identity.certificate.wrap is Wrap.TLS_CRYPT,
        unattended=member.kind in _UNATTENDED,
        retry_max_s=_RETRY_MAX_S[member.link],
        slow=member.link is Link.SATELLITE,
        blocks=inline(identity),
    )
