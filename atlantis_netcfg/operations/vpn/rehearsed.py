"""Identities for a rehearsal: of a CA that exists for it alone, which nobody keeps and no server knows."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.declaration.model import Router, SiteComputer
from atlantis_netcfg.journal import write_atomically
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.client import site_link
from atlantis_netcfg.vpn.enrolment_package.profile import identity_file
from atlantis_netcfg.vpn.identity import Certificate, CertificateStatus, Identity, KeyType, Member, MemberKind, Wrap

if TYPE_CHECKING:
    from collections.abc import Iterable
    from ipaddress import IPv4Address
    from pathlib import Path

    from atlantis_netcfg.declaration import Declaration, Host

NOT_REHEARSED = ("the VPN: clients run with identities of the rehearsal, and no server answers them",)
_DAYS = 397


def rehearsed_identity(declaration: Declaration, host: Host) -> Identity:
    """Of a declared computer or router. Raises UsageError if it is no member of the VPN."""
    address = _address(host)
    if address is None:
        raise UsageError(f"{host.name} has no address in the VPN", hint=f"declare one in host_vars/{host.name}.yml")
    router = isinstance(host.device, Router)
    kind = KeyType.RSA if router else KeyType.EC
    now, key = datetime.now(UTC), pki.new_key(kind)
    ca = pki.new_ca("rehearsal", now)
    made = pki.new_client(ca, key.public_key(), host.name, pki.new_serial(), _DAYS, now)
    certificate = Certificate(
        common_name=host.name,
        serial=made.serial_number,
        sha256=pki.sha256(made),
        not_before=made.not_valid_before_utc,
        not_after=made.not_valid_after_utc,
        wrap=Wrap.TLS_CRYPT_V2,
        key=kind,
        standing=CertificateStatus.ISSUED,
    )
    member = Member(
        name=host.name,
        kind=MemberKind.ROUTER if router else MemberKind.HOST,
        partner=None,
        device=host.name,
        address=address,
        link=site_link(declaration, host.site),
        vehicle=None,
        certificates=(certificate,),
    )
    wrap = pki.client_key(pki.server_key(), f"cn={host.name}".encode())
    return Identity(member, certificate, pki.cert_pem(ca.certificate), pki.cert_pem(made), pki.key_pem(key), wrap)


def identities(declaration: Declaration, hosts: Iterable[Host], folder: Path) -> Path:
    """Lay the identities of those that are members where a request looks for them; gives the folder."""
    (folder / "hosts").mkdir(mode=0o700, parents=True)
    for host in hosts:
        if _address(host) is not None:
            text = identity_file(rehearsed_identity(declaration, host)).reveal()
            write_atomically(folder / "hosts" / f"{host.name}.identity", text.encode())
    return folder


def _address(host: Host) -> IPv4Address | None:
    device = host.device
    if isinstance(device, Router):
        return None if device.vpn_client is None else device.vpn_client.address
    return device.vpn_address if isinstance(device, SiteComputer) else None
