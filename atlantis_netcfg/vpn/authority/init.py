"""Make an authority: everything beside the ledger first, then the ledger, all at once.

A folder with a ledger is an authority. One with the mark `founding` and no ledger is what a killed `init` left. It
holds nothing that anybody has seen, and is made again from the beginning.
"""

from __future__ import annotations

import secrets
from typing import TYPE_CHECKING, Literal

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.paths import hold_own
from atlantis_netcfg.journal import sync_directory, write_atomically
from atlantis_netcfg.vpn import ledger, pki
from atlantis_netcfg.vpn.authority import files
from atlantis_netcfg.vpn.authority.ledger_session import HEAD_FILE, new_head, new_operation
from atlantis_netcfg.vpn.authority.model import AuthorityDamaged, NoAuthority, os_errors_as
from atlantis_netcfg.vpn.authority.revocation_list import sign_crl
from atlantis_netcfg.vpn.authority.signing_session import names_of, new_server_certificate
from atlantis_netcfg.vpn.ledger.records import Founded

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.vpn.authority.model import ServerNames

Sealing = Literal["age", "vault"]
UNFINISHED_MARK = "founding"
_OWN_FOLDER_HINT = "work as that user, or name a folder of your own: authority=DIR"


def is_complete(folder: Path) -> bool:
    """Whether the folder has an authority."""
    return (folder / ledger.FILE).exists()


def require_authority(folder: Path) -> None:
    """Raise NoAuthority, or AuthorityDamaged where only the ledger is missing."""
    if is_complete(folder):
        with os_errors_as("the authority cannot be read"):
            hold_own(folder, _OWN_FOLDER_HINT)
        return
    _unfinished(folder)
    raise NoAuthority(
        f"there is no authority in {folder}", hint="`provision vpn init` makes one; `authority=DIR` names it"
    )


def prepare_folder(folder: Path) -> None:
    """Make the folder, for its owner alone."""
    with os_errors_as("there is no place for the authority"):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        hold_own(folder, _OWN_FOLDER_HINT)
        sync_directory(folder.parent)
        if folder.stat().st_mode & 0o077:
            folder.chmod(0o700)


def init_authority(folder: Path, passphrase: Secret, names: ServerNames, who: str, sealing: Sealing) -> None:
    """Make it, under the lock; nothing if it is there. Raises UsageError if it is there for other names."""
    if is_complete(folder):
        _same_names(folder, names)
    else:
        _make(folder, passphrase, names, who, sealing)
    with os_errors_as("the authority cannot be completed"):
        files.forget(folder / UNFINISHED_MARK)
        files.sweep(folder)


def seal_ca_key(key: Secret, passphrase: Secret, sealing: Sealing) -> bytes:
    """The CA key as it lies on disk. Raises WeakPassphrase."""
    encrypt = pki.seal if sealing == "age" else pki.vault_seal
    return encrypt(key.reveal().encode(), passphrase)


def _make(folder: Path, passphrase: Secret, names: ServerNames, who: str, sealing: Sealing) -> None:
    _unfinished(folder)
    now = ledger.utc_now()
    # Each authority has a name of its own: OpenVPN takes a list of another CA of the same name with a mere warning.
    ca = pki.new_ca(f"ATLANTIS VPN {secrets.token_hex(4)}", now)
    server, issued = new_server_certificate(ca, names, now)
    crl, published = sign_crl(ca, (), 1, now)
    written = {
        files.SEALED[sealing]: seal_ca_key(pki.key_pem(ca.key), passphrase, sealing),
        files.CA: pki.cert_pem(ca.certificate).encode(),
        **server,
        files.TLS_CRYPT_V2: pki.server_key().reveal().encode(),
        files.TLS_CRYPT: pki.shared_key().reveal().encode(),
        files.CRL: crl,
    }
    founded = Founded(
        ca_common_name=ca.certificate.subject.rfc4514_string().removeprefix("CN="),
        ca_sha256=pki.sha256(ca.certificate),
        ca_not_after=ca.certificate.not_valid_after_utc,
        sealed_by=sealing,
        heads=True,
    )
    lines = ledger.first_lines([founded, issued, published], who, new_operation(), now)
    digests = [ledger.digest(line) for line in lines.splitlines()]
    written[HEAD_FILE] = new_head(ca, len(digests), digests[-1], now)
    with os_errors_as("the authority cannot be made"):
        write_atomically(folder / UNFINISHED_MARK, b"provision vpn init was not completed here: run it again\n")
        for other in files.SEALED.values():
            (folder / other).unlink(missing_ok=True)
        files.folders(folder)
        for name, data in written.items():
            write_atomically(folder / name, data)
        write_atomically(folder / ledger.FILE, lines)


def _unfinished(folder: Path) -> None:
    """Raise AuthorityDamaged if what is there is not what a killed `init` left."""
    if not (folder / UNFINISHED_MARK).exists() and (left := _remains(folder)):
        raise AuthorityDamaged(
            f"{folder} has {left}, but not the ledger: nothing can be issued or revoked without it",
            hint=f"restore {ledger.FILE} from your backup of the authority",
        )


def _remains(folder: Path) -> str | None:
    """What only an authority has, if the folder has it."""
    kept = (files.CA, files.CRL, *files.SEALED.values())
    found = [name for name in kept if (folder / name).exists()]
    return ", ".join(found) or None


def _same_names(folder: Path, names: ServerNames) -> None:
    server = ledger.LedgerState(ledger.read(folder / ledger.FILE).sound().entries).server
    if server is None or names_of(server) != names:
        made = "nothing" if server is None else ", ".join((*server.dns, *map(str, server.addresses)))
        raise UsageError(
            f"there is an authority in {folder} already, whose server is {made}: it is not overwritten",
            hint="name another folder: authority=DIR",
        )
