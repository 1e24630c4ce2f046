"""Where things lie in the folder, and how they get there."""

from __future__ import annotations

import os
import re
from typing import TYPE_CHECKING

from atlantis_netcfg.journal import sync_directory

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from atlantis_netcfg.vpn.ledger.records import Issued

__all__ = [
    "CA",
    "CERTS",
    "CRL",
    "SEALED",
    "SERVER",
    "SERVER_CERT",
    "SERVER_KEY",
    "TLS_CRYPT",
    "TLS_CRYPT_V2",
    "copy_of",
    "folders",
    "forget",
    "restore_copies",
    "sweep",
]

CA = "ca.crt"
SEALED = {"age": "ca.key.age", "vault": "ca.key.vault"}
CRL = "crl.pem"
CERTS = "certs"
SERVER = "server"
SERVER_CERT = f"{SERVER}/server.crt"
SERVER_KEY = f"{SERVER}/server.key"
TLS_CRYPT_V2 = f"{SERVER}/tls-crypt-v2.key"
TLS_CRYPT = f"{SERVER}/tls-crypt.key"
_SCRATCH = re.compile(r"\..+\.[0-9]+")


def folders(folder: Path) -> None:
    """Make those that are missing, for their owner alone."""
    for name in (CERTS, SERVER, "hosts", "handouts"):
        (folder / name).mkdir(mode=0o700, exist_ok=True)


def copy_of(issued: Issued) -> bytes:
    """The certificate as `certs/` has it, PEM."""
    rows = "\n".join(issued.der[start : start + 64] for start in range(0, len(issued.der), 64))
    return f"-----BEGIN CERTIFICATE-----\n{rows}\n-----END CERTIFICATE-----\n".encode()


def restore_copies(folder: Path, issued: Iterable[Issued]) -> None:
    """Write the certificates of the record that `certs/` lacks, or has otherwise."""
    for item in issued:
        path = folder / CERTS / f"{item.common_name}.pem"
        data = copy_of(item)
        if _read(path) != data:
            _write_copy(path, data)


def sweep(folder: Path) -> None:
    """Remove what killed commands had not put in place: it may be half a file, or hold a key."""
    for path in folder.rglob(".*"):
        if _SCRATCH.fullmatch(path.name) and not path.is_dir():
            path.unlink(missing_ok=True)


def forget(path: Path) -> None:
    """Remove a file for good."""
    path.unlink(missing_ok=True)
    sync_directory(path.parent)


def _write_copy(path: Path, data: bytes) -> None:
    """Whole or not at all, but nothing waits for the disk: what a power cut takes is made again from the ledger."""
    scratch = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        descriptor = os.open(scratch, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
        scratch.replace(path)
    except OSError:
        scratch.unlink(missing_ok=True)
        raise


def _read(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None
