"""Certificates of the authority, its server and its members.

No function takes a certificate request: names come from the ledger, and a request's own subject is never read.
What a peer may be is said twice, as OpenVPN's `remote-cert-tls` reads both: key usage, and extended key usage.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from atlantis_netcfg.vpn.identity import KeyType
from atlantis_netcfg.vpn.pki.keys import CertificateRefused, KeyDamaged, PrivateKey, PublicKey, load_key, new_key

if TYPE_CHECKING:
    from collections.abc import Iterable
    from ipaddress import IPv4Address

    from atlantis_netcfg.core.secret import Secret

CA_DAYS = 3652
SERVER_DAYS = 1826
BACKDATED = timedelta(days=30)
"""Of the CA and the server: a gateway whose clock has no battery starts behind, and must still come up (facts 7)."""
CLIENT_BACKDATED = timedelta(days=1)
"""The server's clock is kept; a day is for the time zone that somebody has set wrong."""

_COMMON_NAME = re.compile(r"[a-z0-9](?:[a-z0-9.-]{0,62}[a-z0-9])?")
"""Of servers and members. The ledger's grammar is narrower; this holds where a caller has forgotten it: what comes
after a NUL, OpenVPN does not read, and `/` it takes for `_` (facts 6)."""
_CA_NAME = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9 .-]{0,62}[A-Za-z0-9])?")


@dataclass(frozen=True, slots=True)
class Ca:
    """What signs."""

    certificate: x509.Certificate
    key: PrivateKey


def new_ca(name: str, now: datetime, kind: KeyType = KeyType.EC) -> Ca:
    """A CA for ten years, which signs certificates of devices and revocation lists, and no further CA."""
    if _CA_NAME.fullmatch(name) is None:
        raise CertificateRefused(f"no name for a certificate authority: {name!r}", hint="use letters, digits and -")
    key = new_key(kind)
    public, subject = key.public_key(), _subject(name)
    usage = _usage(key_cert_sign=True, crl_sign=True)
    builder = (
        x509.CertificateBuilder(subject_name=subject, issuer_name=subject, public_key=public)
        .serial_number(new_serial())
        .not_valid_before(_whole(now) - BACKDATED)
        .not_valid_after(_whole(now) + timedelta(days=CA_DAYS))
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(usage, critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(public), critical=False)
    )
    return Ca(builder.sign(key, SHA256()), key)


def load_ca(certificate: str, key: Secret) -> Ca:
    """The CA of two PEM texts. Raises KeyDamaged if they do not belong together."""
    ca = Ca(load_cert(certificate), load_key(key))
    if ca.certificate.public_key() != ca.key.public_key():
        raise KeyDamaged(
            "the CA's key is not the key of the CA's certificate",
            hint="restore both files from the same backup of the authority",
        )
    return ca


def new_server(  # noqa: PLR0913, PLR0917 - what a server's certificate says
    ca: Ca,
    public_key: PublicKey,
    common_name: str,
    dns: Iterable[str],
    addresses: Iterable[IPv4Address],
    serial: int,
    now: datetime,
    *,
    days: int = SERVER_DAYS,
) -> x509.Certificate:
    """A server's. RouterOS compares its `connect-to` with the alternative names, so they hold names and addresses."""
    names = [*map(x509.DNSName, dns), *map(x509.IPAddress, addresses)]
    encipher = isinstance(public_key, rsa.RSAPublicKey)
    # OpenVPN before 2.5 wants one of the two beside the signature (its `remote-cert-ku`).
    usage = _usage(digital_signature=True, key_encipherment=encipher, key_agreement=not encipher)
    builder = _builder(ca, public_key, common_name, serial, now, (BACKDATED, timedelta(days=days)))
    builder = builder.add_extension(usage, critical=True)
    builder = builder.add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
    if names:
        builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
    return builder.sign(ca.key, SHA256())


def new_client(  # noqa: PLR0913, PLR0917 - what a member's certificate says
    ca: Ca, public_key: PublicKey, common_name: str, serial: int, days: int, now: datetime
) -> x509.Certificate:
    """A member's, for some days from now on."""
    builder = _builder(ca, public_key, common_name, serial, now, (CLIENT_BACKDATED, timedelta(days=days)))
    builder = builder.add_extension(_usage(digital_signature=True), critical=True)
    builder = builder.add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.CLIENT_AUTH]), critical=False)
    return builder.sign(ca.key, SHA256())


def new_serial() -> int:
    """A random number of 159 bits, never 0: unique without a counter that a killed command could give out twice."""
    return x509.random_serial_number()


def cert_pem(certificate: x509.Certificate) -> str:
    """Its text form."""
    return certificate.public_bytes(Encoding.PEM).decode("ascii")


def load_cert(pem: str) -> x509.Certificate:
    """The certificate of such a text. Raises KeyDamaged."""
    try:
        return x509.load_pem_x509_certificate(pem.encode())
    except (ValueError, x509.InvalidVersion):
        raise KeyDamaged("this is no certificate", hint="restore it from your backup of the authority") from None


def sha256(certificate: x509.Certificate) -> str:
    """Fingerprint of the DER form, hex."""
    return certificate.fingerprint(SHA256()).hex()


def issued_by(certificate: x509.Certificate, ca_certificate: x509.Certificate) -> bool:
    """Whether that CA has signed it: by name and by signature, dates aside."""
    try:
        certificate.verify_directly_issued_by(ca_certificate)
    except (ValueError, TypeError, InvalidSignature):
        return False
    return True


def _builder(  # noqa: PLR0913, PLR0917 - as above
    ca: Ca, public_key: PublicKey, common_name: str, serial: int, now: datetime, span: tuple[timedelta, timedelta]
) -> x509.CertificateBuilder:
    if _COMMON_NAME.fullmatch(common_name) is None:
        raise CertificateRefused(f"no name for a certificate: {common_name!r}", hint="use a-z, 0-9 and -")
    if not 0 < serial < 1 << 159:
        raise CertificateRefused("a serial number has 1 to 159 bits", hint="this is our fault: please report it")
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
        raise CertificateRefused("a certificate is good for at least one day", hint="days=397")
    if not first <= now < last:
        raise CertificateRefused(
            f"the certificate authority is good from {first:%Y-%m-%d} to {last:%Y-%m-%d}, and this computer's date is "
            f"{now:%Y-%m-%d}",
            hint="set this computer's clock right; after its end a new authority is needed",
        )
    if now + after > last:
        raise CertificateRefused(
            f"a certificate for {after.days} days would outlive the certificate authority ({last:%Y-%m-%d})",
            hint=f"days={(last - now).days}, or make a new authority",
        )
    return max(now - before, first), now + after


def _whole(moment: datetime) -> datetime:
    """As certificates hold it: UTC, whole seconds."""
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
