"""An authority to try things on: founded once in a process, copied for each test, its CA key at hand."""

import atexit
import hashlib
import shutil
import tempfile
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from functools import cache
from ipaddress import IPv4Address, IPv4Network
from pathlib import Path
from typing import Any

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.runs import write_atomically
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.authority.authority import Authority, unseal_ca
from atlantis_netcfg.vpn.authority.model import EnrolmentFile, EnrolmentRequest, ServerNames
from atlantis_netcfg.vpn.authority.signer import Signer
from atlantis_netcfg.vpn.identity import Identity, MemberKind
from atlantis_netcfg.vpn.names import member_name

PASSPHRASE = Secret("six words that a die has chosen")
NAMES = ServerNames("vpn-server", ("vpn.example",), (IPv4Address("192.0.2.1"), IPv4Address("10.64.1.2")))
POOL = IPv4Network("10.8.16.0/24")


def wish(device: str, partner: str = "iqua", **fields: Any) -> EnrolmentRequest:  # noqa: ANN401 - fields of a wish
    """A robot of a partner, with an address of its pool."""
    given: dict[str, Any] = {"kind": MemberKind.ROBOT, "pool": POOL, **fields}
    return EnrolmentRequest(name=member_name(partner, device), partner=partner, device=device, **given)


def handed_to(folder: Path, identity: Identity) -> EnrolmentFile:
    """Write what a member gets, as the hand-out does."""
    place = folder / "handouts" / identity.certificate.common_name
    place.mkdir(mode=0o700, exist_ok=True)
    data = f"{identity.cert}{identity.key.reveal()}{identity.wrap_key.reveal()}".encode()
    write_atomically(place / "member.txt", data)
    return EnrolmentFile(str(place / "member.txt"), hashlib.sha256(data).hexdigest())


@dataclass
class Stand:
    """One authority of a test's own."""

    folder: Path
    ca: pki.Ca
    identities: list[Identity] = field(default_factory=list)
    """All that was handed out."""

    @property
    def authority(self) -> Authority:
        return Authority.open(self.folder)

    def signing(self, **options: Any) -> AbstractContextManager[Signer]:  # noqa: ANN401 - of `unlocked`
        """As `unlocked`, with the key that was unsealed once."""
        return self.authority._open_for_signing(self.ca, "tester", **options)

    def deliver(self, identity: Identity) -> EnrolmentFile:
        self.identities.append(identity)
        return handed_to(self.folder, identity)

    def issue(self, *devices: str) -> None:
        with self.signing() as signer:
            signer.issue([wish(device) for device in devices], self.deliver)


@cache
def _founded() -> tuple[Path, pki.Ca]:
    place = Path(tempfile.mkdtemp(prefix="atlantis-authority-"))
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    folder = place / "vpn"
    # Sealed by ansible-vault: tests do not wait for age's second.
    Authority.init(folder, PASSPHRASE, NAMES, "founder", "vault")
    return folder, unseal_ca(folder, PASSPHRASE)


def stand(tmp_path: Path) -> Stand:
    """A fresh one in `tmp_path`."""
    prototype, ca = _founded()
    folder = tmp_path / "vpn"
    shutil.copytree(prototype, folder)
    return Stand(folder, ca)
