"""The certificate of the server, and its key."""

from __future__ import annotations

from datetime import timedelta
from typing import TYPE_CHECKING

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.authority import _files as files
from atlantis_netcfg.vpn.authority._types import ServerNames
from atlantis_netcfg.vpn.identity import KeyType
from atlantis_netcfg.vpn.ledger.records import ServerIssued

if TYPE_CHECKING:
    from datetime import datetime
    from pathlib import Path

__all__ = ["is_sound", "names_of", "needs_another", "new_server_certificate"]

SOON = timedelta(days=90)
"""With less than this until its end, whoever asks for a new one gets it."""


def new_server_certificate(ca: pki.Ca, names: ServerNames, now: datetime) -> tuple[dict[str, bytes], ServerIssued]:
    """A key and a certificate as files, and their record."""
    key = pki.new_key(KeyType.EC)
    certificate = pki.new_server(
        ca, key.public_key(), names.common_name, names.dns, names.addresses, pki.new_serial(), now
    )
    record = ServerIssued(
        common_name=names.common_name,
        dns=names.dns,
        addresses=names.addresses,
        serial=certificate.serial_number,
        sha256=pki.sha256(certificate),
        not_before=certificate.not_valid_before_utc,
        not_after=certificate.not_valid_after_utc,
    )
    written = {
        files.SERVER_KEY: pki.key_pem(key).reveal().encode(),
        files.SERVER_CERT: pki.cert_pem(certificate).encode(),
    }
    return written, record


def names_of(record: ServerIssued) -> ServerNames:
    """What it is made out to."""
    return ServerNames(record.common_name, record.dns, record.addresses)


def needs_another(record: ServerIssued | None, names: ServerNames, now: datetime) -> bool:
    """Whether the one that is recorded is for other names, or ends soon."""
    return record is None or names_of(record) != names or record.not_after - now < SOON


def is_sound(folder: Path, record: ServerIssued) -> bool:
    """Whether the files are the recorded certificate and its key: they are written one after the other."""
    try:
        certificate = pki.load_cert((folder / files.SERVER_CERT).read_text(encoding="ascii"))
        key = pki.load_key(Secret((folder / files.SERVER_KEY).read_text(encoding="ascii")))
    except (FileNotFoundError, ValueError, pki.KeyDamaged):
        return False
    return pki.sha256(certificate) == record.sha256 and certificate.public_key() == key.public_key()
