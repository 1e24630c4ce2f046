"""RouterOS as a VPN member: support by version, the file to import, and the script of an enrolment package.

Sources: MikroTik manual, OpenVPN; the command trees of 7.9 to 7.24 (facts 10). A tls-crypt key cannot be set: it is
part of an imported `.ovpn` and is never shown, so an interface configured by hand cannot reach our server. Nothing here
was tested on a real router (docs/vpn.md).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.inventory.model import Transport
from atlantis_netcfg.routeros.render import environment, router_view
from atlantis_netcfg.routeros.rsc import quote

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.vpn.identity import Identity

INTERFACE = "ovpn-atlantis"
"""Interface name on a partner's router; our routers have the declared name."""
SINCE = Version(7, 17)
USER_MAX = 27
"""Maximum characters of a user, which RouterOS requires even with a certificate, and which our server ignores."""

_IMPORT_SINCE = Version(7, 9)
_UDP_SINCE = Version(7, 0)
_LACKS = (
    (_UDP_SINCE, "knows OpenVPN over TCP alone, with none of the server's ciphers and without tls-crypt"),
    (_IMPORT_SINCE, "cannot import an OpenVPN configuration, and tls-crypt comes by that way alone"),
    (SINCE, "knows no tls-crypt, without which the server does not answer"),
)
_AUTH = "sha256"
"""tls-crypt requires it, and from 7.17 on a GCM cipher may have it."""


class RouterTooOld(DeviceError):
    """This RouterOS version cannot be a VPN member; nothing was changed on the router."""


@dataclass(frozen=True, slots=True)
class Tunnel:
    """The desired state of a router's tunnel interface after the import."""

    name: str
    connect_to: str
    port: int
    protocol: str
    cipher: str
    user: str
    password: Secret
    comment: str
    certificate: str
    """Name of the client's certificate on the device."""

    def values(self) -> Mapping[str, str]:
        """Return the values that can be set and read back; the password is omitted, as the server ignores it."""
        return {
            "name": self.name,
            "connect-to": self.connect_to,
            "port": str(self.port),
            "protocol": self.protocol,
            "mode": "ip",
            "user": self.user,
            "certificate": self.certificate,
            "verify-server-certificate": "yes",
            "tls-version": "only-1.2",
            "cipher": self.cipher,
            "auth": _AUTH,
            "route-nopull": "yes",
            "add-default-route": "no",
            "use-peer-dns": "no",
            "comment": self.comment,
            "disabled": "no",
        }


def check_version(version: Version, *, where: str = "the router", upgrade: str = "") -> None:
    """Raise RouterTooOld for a version that cannot be a member; `upgrade` replaces the hint."""
    for since, why in _LACKS:
        if version < since:
            raise RouterTooOld(
                f"{where} runs RouterOS {version}, which {why}; {SINCE} is the first that can be in the VPN",
                hint=upgrade or f"upgrade it to RouterOS {SINCE} or later, then try again",
            )


def find_tunnel(inventory: Inventory, host: Host) -> Tunnel | None:
    """Return the tunnel of one of our routers; None if it is not its site's end of the VPN."""
    tunnel = router_view(inventory, host).tunnel
    if tunnel is None:
        return None
    return Tunnel(
        name=tunnel.interface,
        connect_to=tunnel.connect_to,
        port=tunnel.port,
        protocol=tunnel.transport,
        cipher=tunnel.cipher,
        user=tunnel.user,
        password=tunnel.password,
        comment="atlantis: VPN",
        certificate=tunnel.certificate,
    )


def handed_out(inventory: Inventory, identity: Identity) -> Tunnel:
    """Return the tunnel of a partner's router. Its user is the member's name, truncated to RouterOS's limit."""
    vpn = inventory.pilot.vpn
    return Tunnel(
        name=INTERFACE,
        connect_to=vpn.endpoint_name,
        port=vpn.port,
        protocol=vpn.transport.value,
        cipher=vpn.cipher,
        user=identity.member.name[:USER_MAX],
        password=Secret(""),
        comment=f"VPN of {inventory.pilot.name}",
        certificate=identity.certificate.common_name,
    )


def profile(inventory: Inventory, identity: Identity) -> Secret:
    """Return the `.ovpn` for RouterOS, with options from its manual only, as it refuses unknown ones."""
    vpn = inventory.pilot.vpn
    view = {
        "title": f"VPN of {inventory.pilot.name}: {identity.member.name}, for RouterOS {SINCE} and later.",
        "proto": "udp" if vpn.transport is Transport.UDP else "tcp",
        "remote": vpn.endpoint_name,
        "port": vpn.port,
        "cipher": _openvpn(vpn.cipher),
        "blocks": _blocks(identity),
    }
    return Secret(environment().get_template("openvpn/routeros.ovpn.j2").render(view=view))


def script(inventory: Inventory, identity: Identity, file: str) -> str:
    """Return the `.rsc` script: import `file`, rename and configure the interface, remove the file; no secrets.

    It can be run again: leftovers of an earlier run under the same names are removed first.
    """
    tunnel = handed_out(inventory, identity)
    values = {name: text for name, text in tunnel.values().items() if name != "certificate"}
    settings = " ".join(f"{name}={quote(text)}" for name, text in sorted(values.items()))
    view = {"file": file, "tunnel": tunnel, "settings": settings, "since": SINCE}
    return environment().get_template("openvpn/routeros.rsc.j2").render(view=view)


def mark(identity: Identity) -> str:
    """Return a MAC address that shows on the router with which identity an interface was imported.

    In mode `ip` no packet carries this address. Routers generate a random one, so an interface created anew has
    another.
    """
    text = f"{identity.certificate.sha256} {identity.wrap_key.reveal()}"
    digest = hashlib.sha256(text.encode()).digest()[:5]
    return ":".join(f"{byte:02X}" for byte in (0x02, *digest))


def _blocks(identity: Identity) -> Secret:
    wrap = str(identity.certificate.wrap)
    result = (("ca", identity.ca), ("cert", identity.cert), ("key", identity.key.reveal()))
    blocks = (*result, (wrap, identity.wrap_key.reveal()))
    return Secret("\n".join(f"<{name}>\n{text.strip()}\n</{name}>" for name, text in blocks))


def _openvpn(cipher: str) -> str:
    """Convert a RouterOS cipher such as `aes256-gcm` to OpenVPN's name."""
    return f"{cipher[:3]}-{cipher[3:]}".upper()
