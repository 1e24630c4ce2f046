"""Certificates of the authority, its server and its members, and the revocation list.

No function takes a certificate request: names come from the ledger, and a request's own subject is never read. A peer's
role is given twice, as OpenVPN's `remote-cert-tls` reads both: key usage, and extended key usage.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, NoReturn

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import ExtendedKeyUsageOID, ExtensionOID, NameOID

from atlantis_netcfg.core.atomic_files import write_atomically
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.vpn.identity import KeyType
from atlantis_netcfg.vpn.pki import keys

if TYPE_CHECKING:
    from collections.abc import Iterable
    from ipaddress import IPv4Address
    from pathlib import Path

    from atlantis_netcfg.core.secret import Secret


CA_DAYS = 3652
SERVER_DAYS = 1826
BACKDATE = timedelta(days=30)
"""For CA and server: a gateway whose clock has no battery starts behind, and must still come up (facts 7)."""
CLIENT_BACKDATED = timedelta(days=1)
"""The server's clock is maintained; a day covers a wrong time zone."""

_COMMON_NAME = re.compile(r"[a-z0-9](?:[a-z0-9.-]{0,62}[a-z0-9])?")
"""Syntax for servers and members. The ledger's own check is narrower; this one covers callers that omit it. OpenVPN

ignores everything after a NUL, and reads `/` as `_` (facts 6).
"""
_CA_NAME = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9 .-]{0,62}[A-Za-z0-9])?")


@dataclass(frozen=True, slots=True)
class Ca:
    """The certificate authority: certificate and private key."""

    certificate: x509.Certificate
    key: keys.PrivateKey


def new_ca(name: str, now: datetime, kind: KeyType = KeyType.EC) -> Ca:
    """Create a CA for ten years, which may sign device certificates and revocation lists, but no further CA."""
    if _CA_NAME.fullmatch(name) is None:
        raise keys.InvalidCertificateError(
            f"{arg(name)!r} is not a valid name for a certificate authority", hint="use letters, digits and -"
        )
    key = keys.new_key(kind)
    public, subject = key.public_key(), _subject(name)
    usage = _usage(key_cert_sign=True, crl_sign=True)
    builder = (
        x509.CertificateBuilder(subject_name=subject, issuer_name=subject, public_key=public)
        .serial_number(new_serial())
        .not_valid_before(_whole(now) - BACKDATE)
        .not_valid_after(_whole(now) + timedelta(days=CA_DAYS))
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(usage, critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(public), critical=False)
    )
    return Ca(builder.sign(key, SHA256()), key)


def load_ca(certificate: str, key: Secret) -> Ca:
    """Return the CA from two PEM texts. Raises CorruptKeyError if they do not belong together."""
    ca = Ca(load_cert(certificate), keys.load_key(key))
    if ca.certificate.public_key() != ca.key.public_key():
        raise keys.CorruptKeyError(
            "the CA key does not match the CA certificate",
            hint="restore both files from the same backup of the authority",
        )
    return ca


def new_server(  # noqa: PLR0913, PLR0917 - what a server's certificate says
    ca: Ca,
    public_key: keys.PublicKey,
    common_name: str,
    dns: Iterable[str],
    addresses: Iterable[IPv4Address],
    serial: int,
    now: datetime,
    *,
    days: int = SERVER_DAYS,
) -> x509.Certificate:
    """Create a server certificate. It contains names and addresses, as RouterOS compares its `connect-to` with them."""
    names = [*map(x509.DNSName, dns), *map(x509.IPAddress, addresses)]
    encipher = isinstance(public_key, rsa.RSAPublicKey)
    # OpenVPN before 2.5 wants one of the two beside the signature (its `remote-cert-ku`).
    usage = _usage(digital_signature=True, key_encipherment=encipher, key_agreement=not encipher)
    builder = _builder(ca, public_key, common_name, serial, now, (BACKDATE, timedelta(days=days)))
    builder = builder.add_extension(usage, critical=True)
    builder = builder.add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
    if names:
        builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
    return builder.sign(ca.key, SHA256())


def new_client(  # noqa: PLR0913, PLR0917 - what a member's certificate says
    ca: Ca, public_key: keys.PublicKey, common_name: str, serial: int, days: int, now: datetime
) -> x509.Certificate:
    """Create a member's certificate, valid for `days` from now."""
    builder = _builder(ca, public_key, common_name, serial, now, (CLIENT_BACKDATED, timedelta(days=days)))
    builder = builder.add_extension(_usage(digital_signature=True), critical=True)
    builder = builder.add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.CLIENT_AUTH]), critical=False)
    return builder.sign(ca.key, SHA256())


def new_serial() -> int:
    """Return a random 159-bit number, never 0: unique without a counter that a killed command could use twice."""
    return x509.random_serial_number()


def cert_pem(certificate: x509.Certificate) -> str:
    """Return the certificate as PEM."""
    return certificate.public_bytes(Encoding.PEM).decode("ascii")


def load_cert(pem: str) -> x509.Certificate:
    """Parse a certificate in PEM. Raises CorruptKeyError."""
    try:
        return x509.load_pem_x509_certificate(pem.encode())
    except (ValueError, x509.InvalidVersion):
        raise keys.CorruptKeyError("not a certificate", hint="restore it from your backup of the authority") from None


def sha256(certificate: x509.Certificate) -> str:
    """Return the fingerprint of the DER form, hex."""
    return certificate.fingerprint(SHA256()).hex()


def issued_by(certificate: x509.Certificate, ca_certificate: x509.Certificate) -> bool:
    """Return True if that CA has signed the certificate: checks name and signature, not dates."""
    try:
        certificate.verify_directly_issued_by(ca_certificate)
    except (ValueError, TypeError, InvalidSignature):
        return False
    return True


def _builder(  # noqa: PLR0913, PLR0917 - as above
    ca: Ca, public_key: keys.PublicKey, common_name: str, serial: int, now: datetime, span: tuple[timedelta, timedelta]
) -> x509.CertificateBuilder:
    if _COMMON_NAME.fullmatch(common_name) is None:
        raise keys.InvalidCertificateError(
            f"{arg(common_name)!r} is not a valid name for a certificate", hint="use a-z, 0-9 and -"
        )
    if not 0 < serial < 1 << 159:
        raise keys.InvalidCertificateError(
            "a serial number must have 1 to 159 bits", hint="this is a bug: please report it"
        )
    start, end = _dates(ca.certificate, now, *span)
    identifier = ca.certificate.extensions.get_extension_for_class(x509.SubjectKeyIdentifier).value
    authority = x509.AuthorityKeyIdentifier.from_issuer_subject_key_identifier(identifier)
    return (
        x509.CertificateBuilder(ca.certificate.subject, _subject(common_name), public_key, serial, start, end)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(public_key), critical=False)
        .add_extension(authority, critical=False)
    )


def _dates(ca: x509.Certificate, now: datetime, before: timedelta, after: timedelta) -> tuple[datetime, datetime]:
    now = _whole(now)
    first, last = ca.not_valid_before_utc, ca.not_valid_after_utc
    if after < timedelta(days=1):
        raise keys.InvalidCertificateError("a certificate must be valid for at least one day", hint="days=397")
    if not first <= now < last:
        raise keys.InvalidCertificateError(
            f"the certificate authority is valid from {arg(first):%Y-%m-%d} to {arg(last):%Y-%m-%d}, but this "
            f"computer's date is {arg(now):%Y-%m-%d}",
            hint="set this computer's clock; if the authority has expired, create a new one",
        )
    if now + after > last:
        raise keys.InvalidCertificateError(
            f"a certificate for {arg(after.days)} days would outlive the certificate authority ({arg(last):%Y-%m-%d})",
            hint=f"use days={arg((last - now).days)}, or create a new authority",
        )
    return max(now - before, first), now + after


def _whole(moment: datetime) -> datetime:
    """Return the time as in certificates: UTC, whole seconds."""
    return moment.astimezone(UTC).replace(microsecond=0)


def _subject(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _usage(**reply: bool) -> x509.KeyUsage:
    every = dict.fromkeys(
        (
            "digital_signature",
            "content_commitment",
            "key_encipherment",
            "data_encipherment",
            "key_agreement",
            "key_cert_sign",
            "crl_sign",
            "encipher_only",
            "decipher_only",
        ),
        False,
    )
    return x509.KeyUsage(**every | reply)


CRL_DAYS = 90
"""Days until `nextUpdate`: longer than the longest campaign, because the CA's key is not with the server."""
_EXTENSIONS = {ExtensionOID.CRL_NUMBER, ExtensionOID.AUTHORITY_KEY_IDENTIFIER}


@dataclass(frozen=True, slots=True)
class RevokedSerial:
    """One entry of the revocation list."""

    serial: int
    date: datetime


@dataclass(frozen=True, slots=True)
class CrlFacts:
    """Content of a checked revocation list."""

    number: int
    this_update: datetime
    next_update: datetime
    serials: frozenset[int]
    sha256: str
    """SHA-256 of the file, hex."""


def new_crl(
    ca: Ca, revoked_serials: Iterable[RevokedSerial], number: int, now: datetime, days: int = CRL_DAYS
) -> bytes:
    """Sign a revocation list; PEM. `number` must be above that of every earlier list."""
    now = now.astimezone(UTC).replace(microsecond=0)
    identifier = ca.certificate.extensions.get_extension_for_class(x509.SubjectKeyIdentifier).value
    authority = x509.AuthorityKeyIdentifier.from_issuer_subject_key_identifier(identifier)
    lines = [
        x509.RevokedCertificateBuilder(
            revoked_serial.serial, revoked_serial.date.astimezone(UTC).replace(microsecond=0)
        ).build()
        for revoked_serial in revoked_serials
    ]
    builder = (
        x509.CertificateRevocationListBuilder(ca.certificate.subject, now, now + timedelta(days=days), [], lines)
        .add_extension(x509.CRLNumber(number), critical=False)
        .add_extension(authority, critical=False)
    )
    return builder.sign(ca.key, SHA256()).public_bytes(Encoding.PEM)


def read_crl(pem: bytes, ca_certificate: x509.Certificate) -> CrlFacts:
    """Read a list of this CA, whatever its number and dates. Raises InvalidCrlError for any other file."""
    crl = _read(pem)
    _check_issuer(crl, ca_certificate)
    return _facts(crl, pem)


def check_crl(pem: bytes, ca_certificate: x509.Certificate, *, above: int | None, now: datetime) -> CrlFacts:
    """Check that a server of this CA may use a list now, and return its content. Raises InvalidCrlError.

    `above`: number of the list before it; None if there is none. If OpenSSL would accept a file that we would write
    differently, the file is refused: it must be, byte for byte, what we would write.
    """
    facts = read_crl(pem, ca_certificate)
    if above is not None and facts.number <= above:
        _refuse(msg(f"its number is {arg(facts.number)}, but number {arg(above)} was already published"))
    if facts.this_update > now:
        _refuse(
            msg(
                f"it is not valid before {arg(facts.this_update):%Y-%m-%d %H:%M} UTC, and the time is now "
                f"{arg(_format_time(now))}"
            )
        )
    if facts.next_update <= now:
        _refuse(
            msg(
                f"it expired on {arg(facts.next_update):%Y-%m-%d %H:%M} UTC, and the time is now "
                f"{arg(_format_time(now))}"
            )
        )
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
    """Check a list, then replace the old one atomically. Raises InvalidCrlError, OSError: the old list stays.

    Its modification time is at least a second after the old one's: OpenVPN compares size and whole seconds. OpenVPN
    fails open and shut here (facts 4). A list of another CA, also of one with the same name, admits revoked members
    with a warning. A list replaced in the same second with one of the same size is not read. An expired, early or
    truncated one locks everybody out. So a list is only put in place after it was checked to be ours, newer, complete
    and currently valid.
    """
    facts = check_crl(pem, ca_certificate, above=above, now=now)
    mtime = int(now.timestamp())
    if path.exists():
        mtime = max(mtime, int(path.stat().st_mtime) + 1)
    write_atomically(path, pem, mode=mode, modified_at=mtime)
    return facts


def _read(pem: bytes) -> x509.CertificateRevocationList:
    try:
        crl = x509.load_pem_x509_crl(pem)
        # A signature that ends within a byte: OpenSSL refuses it, and so would every server; our library reads it.
        whole = crl.public_bytes(Encoding.DER).endswith(b"\x00" + crl.signature)
        same = crl.public_bytes(Encoding.PEM) == pem and whole
    except (ValueError, x509.InvalidVersion):
        _refuse("it is truncated or damaged")
    if not same:
        _refuse("it is damaged, or contains more than a revocation list")
    return crl


def _check_issuer(crl: x509.CertificateRevocationList, ca: x509.Certificate) -> None:
    try:
        key = ca.public_key()
        # Somebody else's CA may have a key of another kind than ours.
        if crl.issuer != ca.subject or not isinstance(key, keys.PublicKey):
            _refuse("it was signed by another certificate authority")
        if not crl.is_signature_valid(key):
            _refuse("its signature was not made by our certificate authority, although it has the same name")
    except (ValueError, TypeError, UnsupportedAlgorithm):
        _refuse("its signature cannot be checked")


def _facts(crl: x509.CertificateRevocationList, pem: bytes) -> CrlFacts:
    try:
        if {extension.oid for extension in crl.extensions} != _EXTENSIONS:
            _refuse("it is not a list of ours: its extensions differ")
        number = crl.extensions.get_extension_for_class(x509.CRLNumber).value.crl_number
        serials = frozenset(revoked_certificate.serial_number for revoked_certificate in crl)
        following = crl.next_update_utc
        this = crl.last_update_utc
    except (ValueError, x509.DuplicateExtension):
        _refuse("it is damaged")
    if following is None:
        _refuse("it has no expiry date")
    return CrlFacts(number, this, following, serials, hashlib.sha256(pem).hexdigest())


def _format_time(now: datetime) -> str:
    return f"{now.astimezone(UTC):%Y-%m-%d %H:%M} UTC"


def _refuse(why: str) -> NoReturn:
    raise keys.InvalidCrlError(
        f"the revocation list was not published: {arg(why)}",
        hint="check this computer's clock, then sign a new one: provision vpn sync --sign",
    )
