"""Private keys, and the keys that wrap OpenVPN's control channel: made in memory; the caller decides what is written.

Formats of tls-crypt-v2: `doc/tls-crypt-v2.txt` of OpenVPN, accepted by 2.5 to 2.7 and by OpenVPN Connect's engine
(facts 3); they are made here without OpenVPN. The shared key is the static key file that `openvpn --genkey secret`
writes.
"""

from __future__ import annotations

import base64
import hmac
import os
import re
import textwrap
from hashlib import sha256

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric import ec, padding, rsa
from cryptography.hazmat.primitives.ciphers import Cipher
from cryptography.hazmat.primitives.ciphers.algorithms import AES
from cryptography.hazmat.primitives.ciphers.modes import CTR
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
)

from atlantis_netcfg.core.errors import ExitCode, NetcfgError, UsageError
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.vpn.identity import KeyType


class CertificateRefused(UsageError):
    """A certificate that would not be worth what it says; nothing was signed."""


class CrlRefused(NetcfgError):
    """A revocation list that must not come before a server: it would admit the revoked, or lock everybody out."""

    exit = ExitCode.FAILED


class KeyDamaged(NetcfgError):
    """A key file that holds no such key, or not the one that belongs to the certificate beside it."""

    exit = ExitCode.FAILED


class WrongPassphrase(UsageError):
    """What was typed does not open it. No text of this error holds what was typed."""


class WeakPassphrase(UsageError):
    """Too easy to guess to seal anything with; nothing was written."""


class SealDamaged(NetcfgError):
    """A sealed file that is cut, changed, or nothing of the kind: no passphrase would open it."""

    exit = ExitCode.FAILED


class SealTooLarge(NetcfgError):
    """Opening it takes more than this computer has; nothing is wrong with the file."""

    exit = ExitCode.FAILED


class RecipientRefused(UsageError):
    """A text that is no key which files can be encrypted to."""


PrivateKey = ec.EllipticCurvePrivateKey | rsa.RSAPrivateKey
PublicKey = ec.EllipticCurvePublicKey | rsa.RSAPublicKey


def new_key(kind: KeyType) -> PrivateKey:
    """EC P-256, or RSA of 2048 bits: what every client that we know of can use (facts 10)."""
    if kind is KeyType.EC:
        return ec.generate_private_key(ec.SECP256R1())
    return rsa.generate_private_key(public_exponent=65537, key_size=2048)


def key_pem(key: PrivateKey) -> Secret:
    """PKCS #8, not encrypted: an OpenVPN that starts with the computer has nobody to ask for a passphrase."""
    return Secret(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()).decode("ascii"))


def sign(key: PrivateKey, text: bytes) -> bytes:
    """Sign a text of ours, which must begin with words that say what it is: a CA key also signs certificates."""
    if isinstance(key, rsa.RSAPrivateKey):
        return key.sign(text, padding.PKCS1v15(), SHA256())
    return key.sign(text, ec.ECDSA(SHA256()))


def is_signed(key: PublicKey, text: bytes, signature: bytes) -> bool:
    """Whether the holder of the private half has signed that text."""
    try:
        if isinstance(key, rsa.RSAPublicKey):
            key.verify(signature, text, padding.PKCS1v15(), SHA256())
        else:
            key.verify(signature, text, ec.ECDSA(SHA256()))
    except InvalidSignature:
        return False
    return True


def load_key(pem: Secret) -> PrivateKey:
    """The key of such a text. Raises KeyDamaged; what the text held is in no message."""
    try:
        key = load_pem_private_key(pem.reveal().encode(), password=None)
    except (ValueError, TypeError):
        key = None
    if not isinstance(key, PrivateKey):
        raise KeyDamaged("this is no private key of ours", hint="restore the file from your backup of the authority")
    return key


METADATA_MAX = 733
"""Bytes: a wrapped key has at most 1024 (OpenVPN's `TLS_CRYPT_V2_MAX_WKC_LEN`), tag, key, length and kind included."""
_SERVER = "OpenVPN tls-crypt-v2 server key"
_CLIENT = "OpenVPN tls-crypt-v2 client key"
_USER = b"\x00"
"""Kind of metadata: bytes of our own, which a `tls-crypt-v2-verify` script could read."""


def server_key() -> Secret:
    """A server's tls-crypt-v2 key: it opens the keys that its clients send, and makes them."""
    return _pem(_SERVER, os.urandom(128))


def client_key(server: Secret, metadata: bytes) -> Secret:
    """A client's tls-crypt-v2 key for that server; the server can read `metadata`, and nobody can change it."""
    if len(metadata) > METADATA_MAX:
        raise ValueError(f"metadata of more than {METADATA_MAX} bytes")
    both = _server_bytes(server)
    encryption, authentication = both[:32], both[64:96]
    key = os.urandom(256)
    plain = key + _USER + metadata
    length = (32 + len(plain) + 2).to_bytes(2, "big")
    tag = hmac.digest(authentication, length + plain, sha256)
    encryptor = Cipher(AES(encryption), CTR(tag[:16])).encryptor()
    return _pem(_CLIENT, key + tag + encryptor.update(plain) + encryptor.finalize() + length)


def shared_key() -> Secret:
    """A static key for clients that know no tls-crypt-v2: all of them share it, so it only keeps strangers out."""
    rows = textwrap.wrap(os.urandom(256).hex(), 32)
    head = ["#", "# 2048 bit OpenVPN static key", "#", "-----BEGIN OpenVPN Static key V1-----"]
    return Secret("\n".join([*head, *rows, "-----END OpenVPN Static key V1-----", ""]))


def _pem(label: str, data: bytes) -> Secret:
    rows = textwrap.wrap(base64.b64encode(data).decode("ascii"), 64)
    return Secret("\n".join([f"-----BEGIN {label}-----", *rows, f"-----END {label}-----", ""]))


def _server_bytes(key: Secret) -> bytes:
    found = re.fullmatch(rf"\s*-----BEGIN {_SERVER}-----([A-Za-z0-9+/=\s]+)-----END {_SERVER}-----\s*", key.reveal())
    try:
        data = base64.b64decode("".join(found[1].split()), validate=True) if found else b""
    except ValueError:
        data = b""
    if len(data) != 128:  # noqa: PLR2004 - two keys of 64 bytes each
        raise KeyDamaged("this is no tls-crypt-v2 key of a server", hint="restore it from a backup of the authority")
    return data
