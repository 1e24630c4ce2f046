"""Part `openvpn_client`: files on a gateway computer that make it a VPN member.

Configuration and identity are two files. `atlantis.conf` is compared and shown like any other; it includes
`atlantis.identity`, with OpenVPN's inline blocks, which exist in that file only, mode 0600. A client refused by the
server keeps retrying (facts 7), so a member revoked by mistake reconnects without a visit to the site.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.computers import parts
from atlantis_netcfg.inventory import model
from atlantis_netcfg.routeros.render import environment
from atlantis_netcfg.vpn.identity import RENEGOTIATION_S, TIMERS, MemberLink

if TYPE_CHECKING:
    from ipaddress import IPv4Address
    from pathlib import Path

    from atlantis_netcfg.inventory import Host, Inventory

CONF = "/etc/openvpn/client/atlantis.conf"
IDENTITY = "/etc/openvpn/client/atlantis.identity"
"""Certificates and keys of the gateway, as written by `enrolment_package.identity_file`."""
SERVICE = "openvpn-client@atlantis.service"

_DROP_IN = f"/etc/systemd/system/{SERVICE}.d/atlantis.conf"
_INTERFACE = "tun0"
_RETRY_MAX_S = {MemberLink.FIBRE: 300, MemberLink.LTE: 300, MemberLink.SATELLITE: 900}
"""Longest pause between two attempts: a refused attempt costs 12 kB (facts 9)."""
_RESTART_S = {MemberLink.FIBRE: 10, MemberLink.LTE: 30, MemberLink.SATELLITE: 300}
"""Pause after the server has disconnected the client, which ends the program."""


@dataclass(frozen=True, slots=True)
class OpenvpnClient:
    """Packages and files that the role installs; for a gateway without VPN address, what is removed."""

    packages: tuple[parts.Package, ...]
    configuration: parts.Configuration
    identity: Path | None
    """Local file whose content belongs in `IDENTITY`; None: the gateway keeps its own."""

    def as_dict(self) -> dict[str, Any]:
        """Return the parameters of the role's modules."""
        packages = [{"name": package.name, "version": package.version} for package in self.packages]
        secret = None if self.identity is None else {"path": IDENTITY, "mode": "0600", "from": str(self.identity)}
        return {
            "packages": {"packages": packages},
            "configure": self.configuration.as_dict(),
            "identity": secret,
        }


def openvpn_client(inventory: Inventory, host: Host, identity: Path | None) -> OpenvpnClient:
    """Build the part; pure. `identity` is a file of this computer or None; it is not read here."""
    if _tunnel_address(host) is None:
        absent_files = (CONF, _DROP_IN, IDENTITY)
        unit = parts.Unit(SERVICE, enabled=False, active=False)
        return OpenvpnClient((), parts.Configuration(absent=absent_files, units=(unit,)), None)
    runs = True if identity is not None else None
    return OpenvpnClient(
        packages=(parts.Package("openvpn"),),
        configuration=parts.Configuration(
            files=(parts.File(CONF, _conf(inventory, host)), parts.File(_DROP_IN, _drop_in(inventory, host))),
            units=(parts.Unit(SERVICE, enabled=runs, active=runs, after=(CONF, _DROP_IN, IDENTITY)),),
            brought=() if identity is not None else (parts.UserSuppliedFile(IDENTITY, _missing_identity_text(host)),),
        ),
        identity=identity,
    )


_LINKS = {
    model.Pace.FAST: MemberLink.FIBRE,
    model.Pace.MOBILE: MemberLink.LTE,
    model.Pace.SATELLITE: MemberLink.SATELLITE,
}


def site_link(inventory: Inventory, site: str) -> MemberLink:
    """Return the slowest link kind of a site's tunnel: satellite before 4G before the rest."""
    return _LINKS[max((link.kind.traits.pace for link in inventory.sites[site].bearers), default=model.Pace.FAST)]


def _tunnel_address(host: Host) -> IPv4Address | None:
    return host.device.vpn_address if isinstance(host.device, model.SiteComputer) else None


def _missing_identity_text(host: Host) -> str:
    return (
        f"{host.name} has no identity of the VPN, neither there nor on this computer: its tunnel does not come up. "
        f"Type `provision vpn onboard device={host.name}` where the authority is, or `provision vpn accept file=FILE` "
        "with what the control centre has handed out, then the same again"
    )


def _conf(inventory: Inventory, host: Host) -> str:
    vpn = inventory.pilot.vpn
    link = site_link(inventory, host.site)
    ping_s, ping_restart_s = TIMERS[link]
    udp = vpn.transport is model.Transport.UDP
    view = {
        "name": host.name,
        "proto": "udp4" if udp else "tcp4-client",
        "remote": _remote(inventory, host),
        "port": vpn.port,
        "interface": _INTERFACE,
        "server": vpn.server,
        "identity": IDENTITY,
        "retry_max_s": _RETRY_MAX_S[link],
        "ping_s": ping_s,
        "ping_restart_s": ping_restart_s,
        "renegotiation_s": RENEGOTIATION_S,
        "slow": link is MemberLink.SATELLITE,
        "exit_notify": udp,
    }
    return environment().get_template("openvpn/client.conf.j2").render(client=view)


def _remote(inventory: Inventory, host: Host) -> IPv4Address:
    """Return the server's address as seen by the host: the public one, or in the server's own site its LAN address."""
    server = inventory.hosts[inventory.pilot.vpn.server]
    if server.site == host.site and isinstance(server.device, model.VpnServer):
        return server.device.address
    return inventory.pilot.vpn.endpoint


def _drop_in(inventory: Inventory, host: Host) -> str:
    view = {"restart_s": _RESTART_S[site_link(inventory, host.site)], "identity": IDENTITY}
    return environment().get_template("openvpn/client-service.conf.j2").render(client=view)
