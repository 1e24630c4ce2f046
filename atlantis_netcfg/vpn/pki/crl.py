"""The list of revoked certificates: signed, checked as no OpenVPN checks it, and laid where OpenVPN notices it.

OpenVPN fails open and shut here (facts 4). A list of another CA, also of one with the same name, admits the revoked
with a warning; a list replaced in the same second with one of the same size is not read; an expired, early or cut one
locks everybody out. So nothing is put in place that was not read back and found to be ours, newer, whole, in force.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, NoReturn

from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import ExtensionOID

from atlantis_netcfg.journal import sync_directory
from atlantis_netcfg.vpn.pki.keys import CrlRefused, PublicKey

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from atlantis_netcfg.vpn.pki.certificates import Ca

CRL_DAYS = 90
"""Until `nextUpdate`: longer than the longest campaign, because the CA's key is not with the server."""
_EXTENSIONS = {ExtensionOID.CRL_NUMBER, ExtensionOID.AUTHORITY_KEY_IDENTIFIER}


@dataclass(frozen=True, slots=True)
class RevokedSerial:
    """One line of the list."""

    serial: int
    date: datetime


@dataclass(frozen=True, slots=True)
class CrlFacts:
    """What a checked list says."""

    number: int
    this_update: datetime
    next_update: datetime
    serials: frozenset[int]
    sha256: str
    """Of the file, hex."""


def new_crl(ca: Ca, revoked: Iterable[RevokedSerial], number: int, now: datetime, days: int = CRL_DAYS) -> bytes:
    """Sign a list; PEM. `number` must be above that of every list before it."""
    now = now.astimezone(UTC).replace(microsecond=0)
    identifier = ca.certificate.extensions.get_extension_for_class(x509.SubjectKeyIdentifier).value
    authority = x509.AuthorityKeyIdentifier.from_issuer_subject_key_identifier(identifier)
    lines = [
        x509.RevokedCertificateBuilder(
            revoked_serial.serial, revoked_serial.date.astimezone(UTC).replace(microsecond=0)
        ).build()
        for revoked_serial in revoked
    ]
    builder = (
        x509.CertificateRevocationListBuilder(ca.certificate.subject, now, now + timedelta(days=days), [], lines)
        .add_extension(x509.CRLNumber(number), critical=False)
        .add_extension(authority, critical=False)
    )
    return builder.sign(ca.key, SHA256()).public_bytes(Encoding.PEM)


def read_crl(pem: bytes, ca_certificate: x509.Certificate) -> CrlFacts:
    """What a list of this CA says, whatever its number and its dates. Raises CrlRefused for any other file."""
    crl = _read(pem)
    _check_issuer(crl, ca_certificate)
    return _facts(crl, pem)


def check_crl(pem: bytes, ca_certificate: x509.Certificate, *, above: int | None, now: datetime) -> CrlFacts:
    """What a list says, if a server of this CA may have it now. Raises CrlRefused.

    `above`: number of the list that it follows; None if it follows none. Where OpenSSL would read a file more
    generously than we do, the file is refused: it must be, byte for byte, what we would write.
    """
    facts = read_crl(pem, ca_certificate)
    if above is not None and facts.number <= above:
        _refuse(f"its number is {facts.number}, and number {above} was published already")
    if facts.this_update > now:
        _refuse(f"it is not valid before {facts.this_update:%Y-%m-%d %H:%M} UTC, and now it is {_error_text(now)}")
    if facts.next_update <= now:
        _refuse(f"it has expired on {facts.next_update:%Y-%m-%d %H:%M} UTC, and now it is {_error_text(now)}")
    return facts


def publish(  # noqa: PLR0913 - a list, and what it is checked against
    path: Path,
    pem: bytes,
    ca_certificate: x509.Certificate,
    *,
    above: int | None,
    now: datetime,
    mode: int = 0o600,
) -> CrlFacts:
    """Check a list, then put it in place at once and for good. Raises CrlRefused, OSError: the old list stays.

    Its time is a second after the old one's, if the clock is not further: OpenVPN compares size and whole seconds.
    """
    facts = check_crl(pem, ca_certificate, above=above, now=now)
    modified = int(now.timestamp())
    if path.exists():
        modified = max(modified, int(path.stat().st_mtime) + 1)
    scratch = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        _write(scratch, pem, modified, mode)
        scratch.replace(path)
    except OSError:
        scratch.unlink(missing_ok=True)
        raise
    sync_directory(path.parent)
    return facts


def _read(pem: bytes) -> x509.CertificateRevocationList:
    try:
        crl = x509.load_pem_x509_crl(pem)
        # A signature that ends within a byte: OpenSSL refuses it, and so would every server; our library reads it.
        whole = crl.public_bytes(Encoding.DER).endswith(b"\x00" + crl.signature)
        same = crl.public_bytes(Encoding.PEM) == pem and whole
    except (ValueError, x509.InvalidVersion):
        _refuse("it is cut or damaged")
    if not same:
        _refuse("it is damaged, or holds more than a list")
    return crl


def _check_issuer(crl: x509.CertificateRevocationList, ca: x509.Certificate) -> None:
    try:
        key = ca.public_key()
        # Somebody else's CA may have a key of another kind than ours.
        if crl.issuer != ca.subject or not isinstance(key, PublicKey):
            _refuse("another certificate authority has signed it")
        if not crl.is_signature_valid(key):
            _refuse("its signature is not our certificate authority's, whatever it calls itself")
    except (ValueError, TypeError, UnsupportedAlgorithm):
        _refuse("its signature cannot be checked")


def _facts(crl: x509.CertificateRevocationList, pem: bytes) -> CrlFacts:
    try:
        if {extension.oid for extension in crl.extensions} != _EXTENSIONS:
            _refuse("it is of another kind than our lists: it has other extensions")
        number = crl.extensions.get_extension_for_class(x509.CRLNumber).value.crl_number
        serials = frozenset(revoked_certificate.serial_number for revoked_certificate in crl)
        following = crl.next_update_utc
        this = crl.last_update_utc
    except (ValueError, x509.DuplicateExtension):
        _refuse("it is damaged")
    if following is None:
        _refuse("it does not say how long it is valid")
    return CrlFacts(number, this, following, serials, hashlib.sha256(pem).hexdigest())


def _error_text(now: datetime) -> str:
    return f"{now.astimezone(UTC):%Y-%m-%d %H:%M} UTC"


def _refuse(why: str) -> NoReturn:
    raise CrlRefused(
        f"the revocation list was not published: {why}",
        hint="look at this computer's clock, then sign a new one: provision vpn sync --sign",
    )


def _write(path: Path, data: bytes, modified: int, mode: int) -> None:
    path.unlink(missing_ok=True)
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    with os.fdopen(descriptor, "wb", buffering=0) as file:
        os.fchmod(descriptor, mode)
        rest = memoryview(data)
        while rest:
            rest = rest[file.write(rest) :]
        os.utime(descriptor, (modified, modified))
        os.fsync(descriptor)
