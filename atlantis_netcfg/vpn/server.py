"""Part `openvpn_server`: files on the control centre's computer that make it the VPN server.

There are two kinds of files. Those of `server_conf` and `system_files` (units, loading of the firewall, the record of
when members were last seen, kernel settings) depend on the inventory alone: the tunnel restarts when they change. The
live files (`live_files`) also depend on the list of members: OpenVPN reads them at the next handshake, the kernel at a
reload, and all sessions continue. Source of every line: facts 3 to 9.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.computers import parts
from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory.model import Router, VpnServer
from atlantis_netcfg.routeros.render import environment, template_folder
from atlantis_netcfg.vpn import identity
from atlantis_netcfg.vpn.policy import TABLE, firewall

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from ipaddress import IPv4Address, IPv4Network
    from pathlib import Path

    from atlantis_netcfg.inventory import Host, Inventory

FOLDER = "/etc/openvpn/atlantis"
CONF = "/etc/openvpn/server/atlantis.conf"
SERVICE = "openvpn-server@atlantis.service"
FIREWALL = "/etc/atlantis/vpn.nft"
SEEN_FILE = "/var/lib/atlantis/vpn/seen.json"
"""`{"format": 1, "seen": {common name: {"last": seconds since 1970, "real": address:port, "address": …}}}`."""

FLOOR: Mapping[str, Any] = {
    "package": "openvpn",
    "program": "/usr/sbin/openvpn",
    "branches": [
        {"branch": "2.6", "upstream": "2.6.21", "packages": ["2.6.14-0+deb12u2"]},
        {"branch": "2.7", "upstream": "2.7.5", "packages": []},
    ],
}
"""Facts 11: below it, an authenticated client can keep its session despite a disconnect order, or stop the server."""

NO_CONF = "this openvpn does not know an option of it: `openvpn --version` on the server tells which one it is"

_UNITS = "/etc/systemd/system"
_DROP_IN = f"{_UNITS}/{SERVICE}.d/atlantis.conf"
_FIREWALL_UNIT = "atlantis-vpn-firewall.service"
_SEEN_TIMER = "atlantis-vpn-seen.timer"
_SEEN_SERVICE = "atlantis-vpn-seen.service"
_GUARD = f"{_UNITS}/atlantis-vpn-guard.service"
_UPGRADES = "/etc/apt/apt.conf.d/60-atlantis-upgrades"
"""Loaded after Debian's and Ubuntu's own settings, which select only the security updates."""
_UPGRADE_DROP_IN = f"{_UNITS}/apt-daily-upgrade.service.d/atlantis-vpn.conf"
_UPGRADE_TIMERS = ("apt-daily.timer", "apt-daily-upgrade.timer")
"""The first fetches the package lists, the second installs."""
_SEEN_PROGRAM = "/usr/local/lib/atlantis/vpn_seen.py"
_SYSCTL = "/etc/sysctl.d/60-atlantis-vpn.conf"

_NO_REDIRECTS = 'for interface in /proc/sys/net/ipv4/conf/*/send_redirects; do echo 0 > "$interface" || exit; done'
_FROM_OTHER_ROUTERS = tuple(
    f"{family}.conf.{interface}.{key}"
    for family, keys in (
        ("ipv4", ("accept_redirects", "secure_redirects")),
        ("ipv6", ("accept_redirects", "accept_ra")),
    )
    for key in keys
    for interface in ("all", "default", "*")
)
"""Kernel settings that accept routes from undeclared routers."""
KERNEL_STEPS = (
    parts.ConvergeStep("let the kernel forward for the VPN", ("sysctl", "-q", "-p", _SYSCTL), (_SYSCTL,)),
    parts.ConvergeStep("send members no ICMP redirects", ("sh", "-c", _NO_REDIRECTS), (_SYSCTL,)),
)


def system_files() -> Iterator[parts.File]:
    """Yield the system files, without OpenVPN's own configuration; the same for every pilot."""
    yield parts.File(
        _SYSCTL,
        "# The VPN server routes between its members, as far as its firewall lets it.\nnet.ipv4.ip_forward = 1\n"
        "# Nobody is told of a way past it: an ICMP redirect would send members to each other.\n"
        "net.ipv4.conf.all.send_redirects = 0\nnet.ipv4.conf.default.send_redirects = 0\n"
        "# Of interfaces that are there before this is read; a program that knows no pattern leaves it out.\n"
        "-net.ipv4.conf.*.send_redirects = 0\n"
        "# And nobody changes its own routes.\n" + "".join(f"-net.{key} = 0\n" for key in _FROM_OTHER_ROUTERS),
    )
    yield parts.File(_DROP_IN, _render("hardening.conf.j2"))
    yield parts.File(f"{_UNITS}/{_FIREWALL_UNIT}", _render("firewall.service.j2", firewall=FIREWALL))
    program = (template_folder() / "openvpn" / "vpn_seen.py").read_text(encoding="utf-8")
    yield parts.File(_SEEN_PROGRAM, program, mode="0755")
    yield parts.File(f"{_UNITS}/nftables.service.d/atlantis-vpn.conf", _render("nftables.conf.j2", firewall=FIREWALL))
    yield parts.File(_UPGRADES, _render("apt-upgrades.conf.j2"))
    yield parts.File(_UPGRADE_DROP_IN, _render("upgraded.conf.j2", service=SERVICE))
    yield parts.File(_GUARD, _render("guard.service.j2", firewall=FIREWALL, table=TABLE))
    yield parts.File(f"{_UNITS}/{_SEEN_SERVICE}", _render("seen.service.j2", program=_SEEN_PROGRAM))
    yield parts.File(f"{_UNITS}/{_SEEN_TIMER}", _render("seen.timer.j2"))


def system_units(keys: tuple[str, ...]) -> tuple[parts.Unit, ...]:
    """Return the units: the firewall, and the tunnel, the only one restarted if `keys` or configuration change."""
    firewall = parts.Unit(_FIREWALL_UNIT, enabled=True, active=True, after=(FIREWALL,), reload=True)
    tunnel = parts.Unit(SERVICE, enabled=True, active=True, after=(CONF, _DROP_IN, *keys))
    seen_timer = parts.Unit(_SEEN_TIMER, enabled=True, active=True, after=(f"{_UNITS}/{_SEEN_TIMER}",))
    return firewall, tunnel, seen_timer, *(parts.Unit(name, enabled=True, active=True) for name in _UPGRADE_TIMERS)


def _render(template: str, **values: object) -> str:
    return environment().get_template(f"openvpn/{template}").render(**values)


CCD = f"{FOLDER}/ccd"
"""Folder with one file for each accepted certificate, by its common name; only we write it."""
INTERFACE = "tun0"
MANAGEMENT = "/run/atlantis-vpn/management.sock"
"""Socket that accepts one client at a time: a second one hangs silently (facts 5)."""
STATUS = "/run/atlantis-vpn/status"
"""Status file, version 3, rewritten in place every 10 s."""

_CURRENT = """\
installed=$(dpkg-query -W -f '${Version}' openvpn)
archived=$(LC_ALL=C apt-cache policy openvpn | sed -n 's/^ *Candidate: //p')
dpkg --compare-versions "$installed" ge "$archived"
"""
IS_CURRENT = parts.Check(
    ("sh", "-c", _CURRENT),
    "the installed OpenVPN is older than the one in the archive of its system",
    "on the server: `apt-get update && apt-get install --only-upgrade openvpn`, then `systemctl restart "
    f"{SERVICE}`; members connect again by themselves",
)
"""Check against the server's package lists."""
PACKAGES = ("conntrack", "nftables", "openssl", "openvpn", "python3", "unattended-upgrades")
_CIPHERS = ("AES-256-GCM", "CHACHA20-POLY1305", "AES-128-GCM")
_COMMON_NAME = re.compile(r"[a-z0-9](?:[a-z0-9-]{0,46}[a-z0-9])?(?:\.[1-9][0-9]{0,5})?")
_CERT = f"{FOLDER}/server.crt"
_CA = f"{FOLDER}/ca.crt"
_SECRETS = {
    f"{FOLDER}/server.key": "server/server.key",
    f"{FOLDER}/tls-crypt-v2.key": "server/tls-crypt-v2.key",
    f"{FOLDER}/tls-crypt.key": "server/tls-crypt.key",
}
"""Maps a path on the server to the path in the authority's folder."""

_LIST = f"{FOLDER}/crl.pem"
_SIGNATURE_CHECK = """\
ca=$2
ours() { echo "$ca" | openssl crl -in "$1" -CAfile /dev/stdin -verify -noout 2>&1; }
number() { told=$(openssl crl -in "$1" -crlnumber -noout 2>/dev/null) && told=${told#*=} && echo $((0x${told#0x})); }
serials() { openssl crl -in "$1" -text -noout | sed -n "s/^ *Serial Number: //p"; }
ours "$1" | tee /dev/stderr | grep -qx "verify OK" || exit
ours "$3" | grep -qx "verify OK" && here=$(number "$3") || exit 0
cmp -s "$1" "$3" && exit
new=$(number "$1") || exit
lost=$({ serials "$1"; echo; serials "$3"; } | awk '!NF { old = 1 } !old { new[$1] } old && NF && !($1 in new)' | wc -l)
[ "$new" -gt "$here" ] && [ "$lost" = 0 ] && exit
echo "list $here is in its place, and this is list $new, which lacks $lost of those that are revoked there" >&2
exit 1
"""
"""`openssl crl -verify` exits with 0 in any case. An older list would admit members revoked by a later one. So would

one from a restored copy of the authority, which reuses the numbers of lists that it does not know.
"""
_FOREIGN = (
    "it is not signed by this authority, or older than the one on the server: with it a revoked member could connect. "
    "See `provision vpn status`, and run the same command again"
)


@dataclass(frozen=True, slots=True)
class OpenvpnServer:
    """Packages and files that the role installs."""

    packages: tuple[parts.Package, ...]
    configuration: parts.Configuration
    secrets: Mapping[str, Path]
    """Maps a path on the server to the authority's file whose content belongs there; the content is not included."""

    def as_dict(self) -> dict[str, Any]:
        """Return the parameters of the role's modules."""
        packages = [{"name": package.name, "version": package.version} for package in self.packages]
        return {
            "packages": {"packages": packages},
            "floor": dict(FLOOR),
            "configure": self.configuration.as_dict(),
            "secrets": {path: str(source) for path, source in self.secrets.items()},
        }


def openvpn_server(
    inventory: Inventory, host: Host, membership: identity.MembershipList, authority: Path
) -> OpenvpnServer:
    """Build the part; reads public files of the authority's folder. Raises UsageError if one is missing."""
    ca, cert = (_read(authority, name).decode("ascii") for name in ("ca.crt", "server/server.crt"))
    crl = _read(authority, "crl.pem")
    secrets = {path: authority / source for path, source in _SECRETS.items()}
    for source in secrets.values():
        if not source.is_file():
            raise _missing(authority, str(source.relative_to(authority)))
    text = server_conf(inventory, host)
    files = (
        parts.File(_CA, ca),
        parts.File(_CERT, cert),
        parts.File(CONF, text, validate=("openvpn", "--config", "%s", "--show-ciphers"), hint=NO_CONF),
        *system_files(),
        *live_files(inventory, membership, crl, ca=ca),
    )
    return OpenvpnServer(
        packages=tuple(parts.Package(name) for name in PACKAGES),
        configuration=parts.Configuration(
            directories=(parts.Directory(FOLDER, mode="0750"), parts.Directory(CCD, mode="0750")),
            files=files,
            only=(CCD,),
            steps=KERNEL_STEPS,
            units=system_units((_CA, _CERT, *_SECRETS)),
            checks=(IS_CURRENT,),
        ),
        secrets=secrets,
    )


def live_files(
    inventory: Inventory, membership: identity.MembershipList, crl: bytes, *, ca: str = ""
) -> tuple[parts.File, ...]:
    """Return files that change while the tunnel is up: members' settings, revocation list, and firewall.

    With `ca`, its certificate in PEM, the server checks the list against it before using it.
    """
    validation = ("sh", "-c", _SIGNATURE_CHECK, "sh", "%s", ca, _LIST) if ca else ()
    return (
        *(
            parts.File(f"{CCD}/{certificate.common_name}", ccd(member, certificate, inventory), mode="0640")
            for member, certificate in sorted(membership.certificates(), key=lambda pair: pair[1].common_name)
            if certificate.good
        ),
        parts.File(_LIST, crl.decode("ascii"), validate=validation, hint=_FOREIGN if ca else ""),
        parts.File(FIREWALL, firewall(inventory, membership), mode="0600", validate=("nft", "-c", "-f", "%s")),
    )


def server_conf(inventory: Inventory, host: Host) -> str:
    """Render the server's own configuration; from the inventory alone, so that no enrolment restarts the tunnel."""
    vpn = inventory.pilot.vpn
    device = host.device
    assert isinstance(device, VpnServer)  # noqa: S101 - callers give the server
    udp = vpn.transport.value == "udp"
    ping_s, ping_restart_s = identity.TIMERS[identity.MemberLink.FIBRE]
    local = tunnel_address(inventory, host)
    view = {
        "proto": "udp4" if udp else "tcp4-server",
        "local": device.address,
        "port": vpn.port,
        "interface": INTERFACE,
        "address": local,
        "next_hop": next(address for address in vpn.network.hosts() if address != local),
        "netmask": vpn.network.netmask,
        "folder": FOLDER,
        "routes": tuple(network for name in inventory.hosts for network in _behind(inventory, name)),
        "ciphers": ":".join(
            sorted(_CIPHERS, key=lambda cipher: cipher.replace("-", "") != _normalize_cipher(vpn.cipher))
        ),
        "force_cookie": vpn.force_cookie,
        "max_clients": vpn.max_clients,
        "new_clients_per_10_s": vpn.new_clients_per_10_s,
        "ping_s": ping_s,
        "renegotiation_s": identity.RENEGOTIATION_S,
        "ping_restart_s": ping_restart_s,
        "exit_notify": udp,
        "management": MANAGEMENT,
        "status": STATUS,
    }
    return environment().get_template("openvpn/server.conf.j2").render(server=view)


def ccd(member: identity.Member, certificate: identity.Certificate, inventory: Inventory) -> str:
    """Render OpenVPN's file for a certificate name: address, timers, and the networks behind the member.

    Raises UsageError for an invalid file name, and for an address outside the VPN: OpenVPN completes a partial address
    to somebody else's (facts 6).
    """
    vpn = inventory.pilot.vpn
    if not _COMMON_NAME.fullmatch(certificate.common_name):
        raise UsageError(f"`{arg(certificate.common_name)!a}` is no common name of this authority", hint=_BROKEN)
    if member.address not in vpn.network:
        raise UsageError(
            f"{arg(member.address)} of {arg(member.name)} is outside the VPN's network {arg(vpn.network)}",
            hint="put `pilot.vpn.network` back to what it was, or revoke the member",
        )
    view = {
        "address": member.address,
        "netmask": vpn.network.netmask,
        "networks": tuple(_behind(inventory, member.name)) if member.partner is None else (),
        "timers": identity.TIMERS[member.link] if member.link is not identity.MemberLink.FIBRE else None,
    }
    return environment().get_template("openvpn/ccd.j2").render(member=view)


_BROKEN = "the ledger is not as this toolkit writes it: `provision vpn audit`"


def tunnel_address(inventory: Inventory, host: Host) -> IPv4Address:
    """Return the server's own VPN address. Raises UsageError if the inventory has none."""
    device = host.device
    address = device.vpn_address if isinstance(device, VpnServer) else None
    if address is None:
        raise UsageError(
            f"the VPN server {arg(host.name)} has no address in its own VPN",
            hint=f"write `vpn_address:` in host_vars/{arg(host.name)}.yml, one of "
            f"{arg(inventory.pilot.vpn.infrastructure)}",
        )
    return address


def _normalize_cipher(cipher: str) -> str:
    return cipher.replace("-", "").upper()


def _behind(inventory: Inventory, name: str) -> Iterator[IPv4Network]:
    """Yield the networks behind a member: for a router that is its site's VPN end, LAN and management port."""
    host = inventory.hosts.get(name)
    if host is None or not isinstance(host.device, Router) or host.device.vpn_client is None:
        return
    site = inventory.sites[host.site]
    yield from (site.lan.network, site.management.network)


def _read(authority: Path, name: str) -> bytes:
    try:
        return (authority / name).read_bytes()
    except FileNotFoundError:
        raise _missing(authority, name) from None


def _missing(authority: Path, name: str) -> UsageError:
    return UsageError(
        msg(f"the VPN has no authority on this computer: there is no {arg(name)} in {arg(authority)}"),
        hint=msg("create one: `provision vpn init`; if a colleague has it, do not copy it: let them run this"),
    )
