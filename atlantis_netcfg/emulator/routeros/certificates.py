"""Certificates and OpenVPN profiles created or imported by an emulated router (Manual, Certificates; Manual, OpenVPN).

Assumption: ovpn-import
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from typing import TYPE_CHECKING

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat, load_pem_private_key
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


_CURVES: dict[str, Callable[[], ec.EllipticCurve]] = {
    "prime256v1": ec.SECP256R1,
    "secp384r1": ec.SECP384R1,
    "secp521r1": ec.SECP521R1,
}
_SIZES = ("1024", "1536", "2048", "4096", "8192")
_DIGESTS: dict[str, hashes.SHA256 | hashes.SHA384 | hashes.SHA512] = {
    "sha256": hashes.SHA256(),
    "sha384": hashes.SHA384(),
    "sha512": hashes.SHA512(),
}
_NAMES = {
    "common-name": NameOID.COMMON_NAME,
    "country": NameOID.COUNTRY_NAME,
    "locality": NameOID.LOCALITY_NAME,
    "organization": NameOID.ORGANIZATION_NAME,
    "state": NameOID.STATE_OR_PROVINCE_NAME,
    "unit": NameOID.ORGANIZATIONAL_UNIT_NAME,
}
_PURPOSES = {"tls-server": ExtendedKeyUsageOID.SERVER_AUTH, "tls-client": ExtendedKeyUsageOID.CLIENT_AUTH}
_BLOCK = re.compile(r"-----BEGIN ([A-Z ]+)-----.*?-----END \1-----\n?", re.DOTALL)


class BadRequest(ValueError):
    """A value that no certificate can have; the error text is the argument's name."""


@dataclass(frozen=True, slots=True)
class CertificateInfo:
    """Contents of a certificate; `fingerprint` is SHA-256 in hex, as RouterOS prints it."""

    fingerprint: str
    common_name: str
    not_before: datetime
    not_after: datetime
    serial: str
    private_key: bool
    authority: bool


def issue(template: Mapping[str, str], *, now: datetime, authority: str | None = None) -> str:
    """Make a key and a certificate from a template, self-signed or signed by an authority's PEM."""
    key = _key(template.get("key-size", "2048"))
    subject = x509.Name([x509.NameAttribute(_NAMES[name], template[name]) for name in _NAMES if template.get(name)])
    issuer, signer = subject, key
    if authority is not None:
        issuer = x509.load_pem_x509_certificate(authority.encode()).subject
        signer = load_pem_private_key(authority.encode(), None)  # type: ignore[assignment]
    usage = set(template.get("key-usage", "").split(","))
    builder = (
        x509.CertificateBuilder(issuer_name=issuer, subject_name=subject, public_key=key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now)
        .not_valid_after(now + timedelta(days=int(template.get("days-valid", "365"))))
        .add_extension(x509.BasicConstraints(ca="key-cert-sign" in usage, path_length=None), critical=True)
    )
    if names := _alternatives(template.get("subject-alt-name", "")):
        builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
    if purposes := [_PURPOSES[word] for word in sorted(usage & _PURPOSES.keys())]:
        builder = builder.add_extension(x509.ExtendedKeyUsage(purposes), critical=False)
    digest = _DIGESTS.get(template.get("digest-algorithm", "sha256"))
    if digest is None:
        raise BadRequest("digest-algorithm")
    certificate = builder.sign(signer, digest)
    secret = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    return (secret + certificate.public_bytes(Encoding.PEM)).decode()


def read_certificate(pem: str) -> CertificateInfo:
    """Parse a certificate."""
    certificate = x509.load_pem_x509_certificate(pem.encode())
    names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    constraints = [
        extension.value for extension in certificate.extensions if isinstance(extension.value, x509.BasicConstraints)
    ]
    return CertificateInfo(
        fingerprint=certificate.fingerprint(hashes.SHA256()).hex(),
        common_name=str(names[0].value) if names else "",
        not_before=certificate.not_valid_before_utc,
        not_after=certificate.not_valid_after_utc,
        serial=f"{certificate.serial_number:X}",
        private_key="PRIVATE KEY" in pem,
        authority=any(constraint.ca for constraint in constraints),
    )


def split(text: str) -> tuple[list[str], list[str]]:
    """Split a file into certificates and unencrypted keys. Raises ValueError for anything else."""
    certificates, keys = [], []
    for match in _BLOCK.finditer(text):
        if match[1] == "CERTIFICATE":
            x509.load_pem_x509_certificate(match[0].encode())
            certificates.append(match[0])
        elif match[1].endswith("PRIVATE KEY"):
            load_pem_private_key(match[0].encode(), None)
            keys.append(match[0])
    return certificates, keys


def belongs(key: str, certificate: str) -> bool:
    """Return whether a private key belongs to a certificate."""
    public = load_pem_private_key(key.encode(), None).public_key()
    return public == x509.load_pem_x509_certificate(certificate.encode()).public_key()


def _key(size: str) -> rsa.RSAPrivateKey | ec.EllipticCurvePrivateKey:
    if size in _CURVES:
        return ec.generate_private_key(_CURVES[size]())
    if size not in _SIZES:
        raise BadRequest("key-size")
    return rsa.generate_private_key(65537, int(size))


def _alternatives(text: str) -> list[x509.GeneralName]:
    """Parse alternative names such as `IP:10.0.0.1,DNS:router.lan,email:a@b` (Manual, Certificates)."""
    result: list[x509.GeneralName] = []
    for part in text.split(",") if text else ():
        kind, _, value = part.partition(":")
        try:
            result.append(_ALTERNATIVES[kind](value))
        except (KeyError, ValueError) as error:
            raise BadRequest("subject-alt-name") from error
    return result


_ALTERNATIVES: dict[str, Callable[[str], x509.GeneralName]] = {
    "IP": lambda value: x509.IPAddress(ip_address(value)),
    "DNS": x509.DNSName,
    "email": x509.RFC822Name,
}


def expires_after(moment: datetime, now: datetime) -> str:
    """Format the remaining validity as RouterOS does: weeks, days, and time of day."""
    rest = max(timedelta(), moment - now.astimezone(UTC))
    weeks, days = divmod(rest.days, 7)
    hours, seconds = divmod(rest.seconds, 3600)
    return f"{weeks}w{days}d{hours:02}h{seconds // 60:02}m{seconds % 60:02}s"


TLS_CRYPT_SINCE = "7.17rc3"
_WRAPS = ("tls-crypt", "tls-crypt-v2")
_BLOCKS = ("ca", "cert", "key", "tls-auth")
_IGNORED_OPTIONS = frozenset(
    ("client", "tls-client", "nobind", "persist-key", "persist-tun", "resolv-retry", "remote-cert-tls", "verb", "pull")
)
_CIPHERS = {
    "AES-128-CBC": "aes128-cbc",
    "AES-192-CBC": "aes192-cbc",
    "AES-256-CBC": "aes256-cbc",
    "AES-128-GCM": "aes128-gcm",
    "AES-192-GCM": "aes192-gcm",
    "AES-256-GCM": "aes256-gcm",
    "BF-CBC": "blowfish128",
    "NONE": "null",
}
_AUTHS = {"SHA1": "sha1", "MD5": "md5", "SHA256": "sha256", "SHA512": "sha512", "NONE": "null"}
_PROTOCOLS = {"udp": "udp", "udp4": "udp", "tcp": "tcp", "tcp-client": "tcp", "tcp4-client": "tcp"}
_MODES = {"tun": "ip", "tap": "ethernet"}
_INLINE = re.compile(r"^<([a-z0-9-]+)>\n(.*?)^</\1>\n?", re.DOTALL | re.MULTILINE)


class OvpnError(ValueError):
    """A profile that the router refuses, with its error text."""


@dataclass(frozen=True, slots=True)
class OvpnProfile:
    """Interface settings, certificates and key of an imported profile."""

    values: Mapping[str, str]
    """Properties of the interface, as accepted by `add`."""
    certificates: str
    """PEM text of the blocks `ca`, `cert` and `key`."""
    wrap: str | None = field(repr=False)
    """Key of `tls-crypt`, which no menu shows."""


def openvpn_cipher(word: str) -> str:
    """Return OpenVPN's name of a RouterOS cipher."""
    return next((name for name, cipher in _CIPHERS.items() if cipher == word), word.upper())


def read_ovpn(text: str, *, wraps: bool) -> OvpnProfile:
    """Parse a profile; `wraps`: this version supports tls-crypt. Raises OvpnError.

    Documented: tls-crypt and tls-crypt-v2 only from 7.17 on, with `auth SHA256` and `key-direction 1`; no negotiation,
    so that the file names its cipher; a user of at most 27 characters is mandatory. Seen in others' exports and
    scripts: the interface is called `ovpn-import`, its certificate `cert_ovpn-import`, each with the second of its
    creation; an older version reports `unsupported option '<tls-crypt>'` (angristan/openvpn-install#1267).

    Our assumptions: other options are refused with the same text; a missing cipher, SHA256 or direction is refused at
    once; nothing is created if anything is refused; the interface is disabled, as a new one is.
    """
    text = text.replace("\r\n", "\n")
    blocks = {match[1]: match[2] for match in _INLINE.finditer(text)}
    for name in blocks:
        if name not in _BLOCKS and not (wraps and name in _WRAPS):
            raise OvpnError(f"unsupported option '<{name}>'")
    options = _options(_INLINE.sub("", text))
    wrap = next((blocks[name] for name in _WRAPS if name in blocks), None)
    values = _values(options)
    if wrap is not None and (values.get("auth"), options.get("key-direction")) != ("sha256", ["1"]):
        raise OvpnError("tls-crypt needs auth SHA256 and key-direction 1")
    return OvpnProfile(values, "".join(blocks.get(name, "") for name in ("cert", "key", "ca")), wrap)


def _options(text: str) -> dict[str, list[str]]:
    result = {}
    for line in text.split("\n"):
        words = line.split()
        if words and not words[0].startswith(("#", ";")):
            result[words[0]] = words[1:]
    return result


def _values(options: Mapping[str, list[str]]) -> dict[str, str]:
    values: dict[str, str] = {}
    for name, words in options.items():
        if name in _IGNORED_OPTIONS or name == "key-direction":
            continue
        values |= _value(name, words)
    if "connect-to" not in values or "cipher" not in values:
        raise OvpnError(f"missing option '{'remote' if 'connect-to' not in values else 'cipher'}'")
    return values


def _value(name: str, words: list[str]) -> dict[str, str]:
    try:
        if name == "remote":
            return {"connect-to": words[0], **({"port": words[1]} if len(words) > 1 else {})}
        tables = {"cipher": _CIPHERS, "auth": _AUTHS, "proto": _PROTOCOLS, "dev": _MODES}
        keys = {"proto": "protocol", "dev": "mode"}
        table = tables[name]
        word = words[0] if name in keys else words[0].upper()
        return {keys.get(name, name): table[re.sub(r"\d+$", "", word) if name == "dev" else word]}
    except (KeyError, IndexError):
        text = name if name not in {"remote", "cipher", "auth", "proto", "dev"} else " ".join([name, *words])
        raise OvpnError(f"unsupported option '{text}'") from None
