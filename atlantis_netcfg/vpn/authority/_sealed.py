"""The CA key at rest, under a passphrase."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.journal import write_atomically
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.authority import _files as files
from atlantis_netcfg.vpn.authority import _head as heads
from atlantis_netcfg.vpn.authority._book import new_operation
from atlantis_netcfg.vpn.authority._errors import AuthorityDamaged, os_errors_as
from atlantis_netcfg.vpn.authority._founding import Sealing, require_authority, seal_ca_key
from atlantis_netcfg.vpn.ledger.records import Resealed

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.vpn.authority._book import LedgerSession

__all__ = ["reseal_ca", "unseal_ca"]


def unseal_ca(folder: Path, passphrase: Secret) -> pki.Ca:
    """The CA with its key. Raises NoAuthority, WrongPassphrase, SealDamaged, AuthorityDamaged."""
    require_authority(folder)
    with os_errors_as("the certificate authority cannot be read"):
        certificate = (folder / files.CA).read_text(encoding="ascii")
        found = {
            sealing: (folder / name).read_bytes() for sealing, name in files.SEALED.items() if (folder / name).exists()
        }
    if not found:
        raise AuthorityDamaged(f"the CA key is missing in {folder}", hint="restore it from a backup of the authority")
    wrong: Exception | None = None
    # Two lie there after a change of the seal that was killed at its end: either passphrase opens its own.
    for sealing, data in found.items():
        try:
            opened = pki.unseal(data, passphrase) if sealing == "age" else pki.vault_unseal(data, passphrase)
        except (pki.WrongPassphrase, pki.SealDamaged, pki.SealTooLarge) as error:
            wrong = error
        else:
            return pki.load_ca(certificate, Secret(opened.decode("ascii")))
    assert wrong is not None  # noqa: S101 - there was one to open
    raise wrong


def reseal_ca(folder: Path, book: LedgerSession, passphrases: tuple[Secret, Secret], sealing: Sealing) -> pki.Ca:
    """Old passphrase and new; recorded, then replaced at once. Gives the CA that was opened for it."""
    old, new = passphrases
    try:
        ca = unseal_ca(folder, old)
    except pki.WrongPassphrase:
        # The repeat of a command that was killed at its end: done, if the new one opens it.
        if not (folder / files.SEALED[sealing]).exists():
            raise
        ca = unseal_ca(folder, new)
    heads.read_head(folder, ca.certificate, book.fold).hold(book.digests)
    data = seal_ca_key(pki.key_pem(ca.key), new, sealing)
    book.write([Resealed(sealed_by=sealing)], new_operation())
    with os_errors_as("the CA key cannot be written"):
        write_atomically(folder / files.SEALED[sealing], data)
        for other, name in files.SEALED.items():
            if other != sealing:
                files.forget(folder / name)
    return ca
