"""The authority of a rehearsal: made for it, in its folder, sealed by a passphrase that nobody is ever told."""

from __future__ import annotations

import hashlib
import secrets
from typing import TYPE_CHECKING

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.journal import write_atomically
from atlantis_netcfg.operations.vpn.members import server_names
from atlantis_netcfg.operations.vpn.requests import DeviceWords, computers, request_of
from atlantis_netcfg.vpn.authority.authority import Authority
from atlantis_netcfg.vpn.authority.model import HandoutFile
from atlantis_netcfg.vpn.enrolment_package.profile import identity_file

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.declaration import Declaration
    from atlantis_netcfg.vpn.identity import Identity

NOT_REHEARSED = (
    "the VPN: its authority, its keys and its members are made for the rehearsal; partners' devices are not among them",
    "the VPN's server: the port that its own router forwards, and the internet before it",
    "the VPN's server: its own firewall besides the VPN's, and whatever else runs on the real computer",
)
_WHO = "rehearsal"


def found(declaration: Declaration, folder: Path) -> Path:
    """Make it, with an identity for every declared host that is a client of the VPN; gives the folder."""
    passphrase = Secret(secrets.token_urlsafe(24))
    authority = Authority.init(folder, passphrase, server_names(declaration), _WHO)
    hosts = folder / "hosts"
    hosts.mkdir(mode=0o700, exist_ok=True)

    def deliver(identity: Identity) -> HandoutFile:
        path, data = hosts / f"{identity.member.name}.identity", identity_file(identity).reveal().encode()
        write_atomically(path, data)
        return HandoutFile(str(path), hashlib.sha256(data).hexdigest())

    with authority.unlocked(lambda: passphrase, _WHO) as signer:
        signer.issue([request_of(declaration, DeviceWords(host=name)) for name in computers(declaration)], deliver)
    return folder
