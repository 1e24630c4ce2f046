"""Identities for a rehearsal, from a temporary CA that is not stored; and a server that accepts one of them."""

from __future__ import annotations

import shutil
import socket
import subprocess
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from atlantis_netcfg.core import errors, processes, temporary
from atlantis_netcfg.core.messages import arg
from atlantis_netcfg.inventory.model import Router, SiteComputer
from atlantis_netcfg.runs import write_atomically
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.client import site_link
from atlantis_netcfg.vpn.enrolment_package.profile import identity_file, inline
from atlantis_netcfg.vpn.identity import Certificate, CertificateStatus, Identity, KeyType, Member, MemberKind, Wrap

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from ipaddress import IPv4Address
    from pathlib import Path

    from atlantis_netcfg.inventory import Host, Inventory

NOT_REHEARSED = ("VPN: clients run with rehearsal identities, and no server responds to them",)
_DAYS = 397


def rehearsed_identity(inventory: Inventory, host: Host, wrap: Wrap = Wrap.TLS_CRYPT_V2) -> Identity:
    """Return the identity of an inventory computer or router. Raises UsageError if it is not a VPN member."""
    address = _address(host)
    if address is None:
        raise errors.UsageError(
            f"{arg(host.name)} has no address in the VPN", hint=f"add one in host_vars/{arg(host.name)}.yml"
        )
    router = isinstance(host.device, Router)
    kind = KeyType.RSA if router else KeyType.EC
    now, key = datetime.now(UTC), pki.new_key(kind)
    ca = pki.new_ca("rehearsal", now)
    client_certificate = pki.new_client(ca, key.public_key(), host.name, pki.new_serial(), _DAYS, now)
    certificate = Certificate(
        common_name=host.name,
        serial=client_certificate.serial_number,
        sha256=pki.sha256(client_certificate),
        not_before=client_certificate.not_valid_before_utc,
        not_after=client_certificate.not_valid_after_utc,
        wrap=wrap,
        key=kind,
        standing=CertificateStatus.ISSUED,
    )
    member = Member(
        name=host.name,
        kind=MemberKind.ROUTER if router else MemberKind.HOST,
        partner=None,
        device=host.name,
        address=address,
        link=site_link(inventory, host.site),
        vehicle=None,
        certificates=(certificate,),
    )
    is_shared = wrap is Wrap.TLS_CRYPT
    wrap_key = pki.shared_key() if is_shared else pki.client_key(pki.server_key(), f"cn={host.name}".encode())
    return Identity(
        member, certificate, pki.cert_pem(ca.certificate), pki.cert_pem(client_certificate), pki.key_pem(key), wrap_key
    )


@contextmanager
def vpn_server(identity: Identity) -> Iterator[int]:
    """Run a real OpenVPN server on the loopback, without tunnel, with that identity's shared key; yield its port."""
    program = shutil.which("openvpn", path=processes.program_path())
    if program is None:
        raise errors.NoMatchError("not rehearsed: OpenVPN is not installed on this computer", hint="install openvpn")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port: int = free.getsockname()[1]
    with temporary.folder("vpn") as folder:
        write_atomically(folder / "conf", inline(identity).reveal().encode())
        words = f"--config {folder}/conf --tls-server --dh none --dev null --proto udp4 --local 127.0.0.1 --port {port}"
        command = [program, *words.split(), "--data-ciphers", "AES-256-GCM", "--ping-exit", "600"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:  # noqa: S603 - our words
            try:
                if not any("link local" in line for line in process.stdout or ()):
                    raise errors.NetcfgError("the rehearsal's OpenVPN did not start")
                yield port
            finally:
                process.terminate()


def identities(inventory: Inventory, hosts: Iterable[Host], folder: Path) -> Path:
    """Write the identities of member hosts where a request expects them; return the folder."""
    (folder / "hosts").mkdir(mode=0o700, parents=True)
    for host in hosts:
        if _address(host) is not None:
            text = identity_file(rehearsed_identity(inventory, host)).reveal()
            write_atomically(folder / "hosts" / f"{host.name}.identity", text.encode())
    return folder


def _address(host: Host) -> IPv4Address | None:
    device = host.device
    if isinstance(device, Router):
        return None if device.vpn_client is None else device.vpn_client.address
    return device.vpn_address if isinstance(device, SiteComputer) else None
