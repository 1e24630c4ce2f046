"""A declared host's identity, out of its hand-out and into the folder from which the client's role takes it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.declaration.model import Router
from atlantis_netcfg.journal import write_atomically
from atlantis_netcfg.vpn.enrolment_package._archive import NotAHandOut
from atlantis_netcfg.vpn.enrolment_package._handout import open_handout
from atlantis_netcfg.vpn.enrolment_package._identity import NotAnIdentity, identity_file, read_identity

if TYPE_CHECKING:
    from datetime import datetime
    from ipaddress import IPv4Address
    from pathlib import Path

    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.vpn.identity import Identity

__all__ = ["Accepted", "accept", "host_identity"]

_ENDING = ".identity"


@dataclass(frozen=True, slots=True)
class Accepted:
    """What was taken."""

    identity: Identity
    path: Path
    already: bool
    """Whether the same was there before."""


def host_identity(authority: Path, host: str) -> Path:
    """Where the identity of a declared host is kept; its mode is 0600."""
    return authority / "hosts" / f"{host}{_ENDING}"


def accept(declaration: Declaration, data: bytes, secret: Secret, authority: Path, *, now: datetime) -> Accepted:
    """Open the hand-out of a declared host, check that it is of this declaration, and keep its identity.

    Raises WrongKey, NotAHandOut, NotAnIdentity; UsageError for a host that is not declared so, for an identity that
    has expired, and for one that is older than what is there.
    """
    identity = _identity(open_handout(data, secret))
    _check(declaration, identity, now)
    path = host_identity(authority, identity.member.name)
    already = _already(path, identity)
    if not already:
        for folder in (authority, path.parent):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        write_atomically(path, identity_file(identity).reveal().encode())
    return Accepted(identity, path, already)


def _identity(files: dict[str, str]) -> Identity:
    found = [text for name, text in files.items() if name.endswith(_ENDING)]
    if len(found) != 1:
        raise NotAHandOut("it is for a partner's device, and not for a computer of the inventory")
    return read_identity(found[0])


def _check(declaration: Declaration, identity: Identity, now: datetime) -> None:
    member, certificate = identity.member, identity.certificate
    host = declaration.hosts.get(member.name)
    if host is None or member.partner is not None:
        raise UsageError(
            f"the hand-out is for {member.name}, which is no host of this inventory",
            hint="take the inventory of the pilot that it was made for",
        )
    if (declared := _tunnel_address(host)) != member.address:
        raise UsageError(
            f"the hand-out gives {member.name} the address {member.address}; the inventory declares {declared}",
            hint="take the newest inventory, or ask for a new hand-out",
        )
    if now > certificate.not_after:
        raise UsageError(
            f"the certificate of {member.name} has expired on {certificate.not_after:%Y-%m-%d}",
            hint="look at this computer's clock, or ask the control centre to renew it",
        )


def _tunnel_address(host: Host) -> IPv4Address | None:
    """The address in the VPN that the inventory declares for a host."""
    if isinstance(host.device, Router):
        return host.device.vpn_client.address if host.device.vpn_client is not None else None
    return getattr(host.device, "vpn_address", None)


def _already(path: Path, identity: Identity) -> bool:
    """Whether the same is there. Raises UsageError if what is there is newer; what cannot be read is replaced."""
    try:
        there = read_identity(path.read_text(encoding="utf-8")).certificate
    except (FileNotFoundError, UnicodeDecodeError, NotAnIdentity):
        return False
    if there.not_before > identity.certificate.not_before:
        raise UsageError(
            f"a newer identity of {identity.member.name} is there already: {path}",
            hint="use the newest hand-out; to go back to this one, move that file away first",
        )
    return there == identity.certificate
