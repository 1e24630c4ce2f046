"""Identities for tests, made with `cryptography` alone: a CA, members of every kind, and keys that wrap."""

import base64
import secrets
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from functools import cache
from ipaddress import IPv4Address

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory.model import RosDistribution
from atlantis_netcfg.vpn.identity import (
    Certificate,
    CertificateStatus,
    ClientSystem,
    Identity,
    KeyType,
    Member,
    MemberKind,
    MemberLink,
    Wrap,
)

NOT_BEFORE = datetime(2026, 11, 1, tzinfo=UTC)
NOT_AFTER = datetime(2027, 12, 3, tzinfo=UTC)
_LABELS = {Wrap.TLS_CRYPT_V2: "OpenVPN tls-crypt-v2 client key", Wrap.TLS_CRYPT: "OpenVPN Static key V1"}


@dataclass(frozen=True)
class Wanted:
    """What a test wants a member to be; the rest is of no matter."""

    name: str = "inesc-laptop1"
    kind: MemberKind = MemberKind.LAPTOP
    partner: str | None = "inesc"
    address: str = "10.80.16.1"
    link: MemberLink = MemberLink.FIBRE
    vehicle: str | None = None
    wrap: Wrap = Wrap.TLS_CRYPT_V2
    key: KeyType = KeyType.EC
    generation: int = 1
    system: ClientSystem | None = None
    distribution: RosDistribution | None = None
    not_before: datetime = field(default=NOT_BEFORE)
    not_after: datetime = field(default=NOT_AFTER)


def identity(wanted: Wanted | None = None) -> Identity:
    """What the authority would give."""
    wanted = wanted or Wanted()
    common_name = wanted.name if wanted.generation == 1 else f"{wanted.name}.{wanted.generation}"
    key = _key(wanted.key)
    made = _certificate(common_name, key, wanted)
    certificate = Certificate(
        common_name=common_name,
        serial=made.serial_number,
        sha256=made.fingerprint(SHA256()).hex(),
        not_before=wanted.not_before,
        not_after=wanted.not_after,
        wrap=wanted.wrap,
        key=wanted.key,
        standing=CertificateStatus.ISSUED,
    )
    return Identity(
        member=_member(wanted, certificate),
        certificate=certificate,
        ca=_ca()[0].public_bytes(Encoding.PEM).decode(),
        cert=made.public_bytes(Encoding.PEM).decode(),
        key=Secret(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()).decode()),
        wrap_key=wrap_key(wanted.wrap),
    )


def wrap_key(wrap: Wrap) -> Secret:
    """A key of the right form; no server knows it."""
    label = _LABELS[wrap]
    if wrap is Wrap.TLS_CRYPT:
        digits = secrets.token_hex(256)
        lines = "\n".join(digits[at : at + 32] for at in range(0, len(digits), 32))
    else:
        lines = "\n".join([base64.b64encode(secrets.token_bytes(48)).decode() for _ in range(8)])
    return Secret(f"-----BEGIN {label}-----\n{lines}\n-----END {label}-----\n")


def _member(wanted: Wanted, certificate: Certificate) -> Member:
    prefix = f"{wanted.partner}-" if wanted.partner else ""
    return Member(
        name=wanted.name,
        kind=wanted.kind,
        partner=wanted.partner,
        device=wanted.name.removeprefix(prefix),
        address=IPv4Address(wanted.address),
        link=wanted.link,
        vehicle=wanted.vehicle,
        certificates=(certificate,),
        system=wanted.system,
        distribution=wanted.distribution,
    )


def _key(kind: KeyType) -> ec.EllipticCurvePrivateKey | rsa.RSAPrivateKey:
    if kind is KeyType.RSA:
        return _rsa()
    return ec.generate_private_key(ec.SECP256R1())


@cache
def _rsa() -> rsa.RSAPrivateKey:
    """One for all: making it takes a while."""
    return rsa.generate_private_key(65537, 2048)


@cache
def _ca() -> tuple[x509.Certificate, ec.EllipticCurvePrivateKey]:
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "Example CA")])
    builder = (
        x509.CertificateBuilder(name, name, key.public_key(), x509.random_serial_number())
        .not_valid_before(NOT_BEFORE - timedelta(days=30))
        .not_valid_after(NOT_BEFORE + timedelta(days=3650))
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
    )
    return builder.sign(key, SHA256()), key


def _certificate(
    common_name: str, key: ec.EllipticCurvePrivateKey | rsa.RSAPrivateKey, wanted: Wanted
) -> x509.Certificate:
    issuer, signer = _ca()
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, common_name)])
    builder = x509.CertificateBuilder(issuer.subject, name, key.public_key(), x509.random_serial_number())
    return builder.not_valid_before(wanted.not_before).not_valid_after(wanted.not_after).sign(signer, SHA256())
