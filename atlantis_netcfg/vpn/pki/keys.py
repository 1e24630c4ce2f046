"""Private keys, and keys for OpenVPN's control channel: created in memory; the caller decides what is written.

Formats of tls-crypt-v2: `doc/tls-crypt-v2.txt` of OpenVPN, accepted by 2.5 to 2.7 and by OpenVPN Connect's engine
(facts 3); they are created here without OpenVPN. The shared key is the static key file that `openvpn --genkey secret`
writes.
"""

from __future__ import annotations

import base64
import hmac
import os
import re
import textwrap
import time
from dataclasses import dataclass, field
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

from atlantis_netcfg.core import errors
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.vpn.identity import KeyType


class InvalidCertificateError(errors.UsageError):
    """A certificate with these values would not be valid or safe; nothing was signed."""


class InvalidCrlError(errors.NetcfgError):
    """A revocation list that no server may load: it would admit revoked members, or lock everybody out."""

    exit = errors.ExitCode.FAILED


class CorruptKeyError(errors.NetcfgError):
    """A key file without a valid key, or with one that does not match its certificate."""

    exit = errors.ExitCode.FAILED


class WrongPassphrase(errors.UsageError):
    """The typed secret does not open the file. No message of this error contains it."""


class WeakPassphrase(errors.UsageError):
    """The passphrase is too easy to guess; nothing was written."""


class CorruptSealError(errors.NetcfgError):
    """A sealed file is truncated, changed, or not a sealed file: no passphrase would open it."""

    exit = errors.ExitCode.FAILED


class SealTooLarge(errors.NetcfgError):
    """Opening the file needs more memory than this computer has; the file itself is valid."""

    exit = errors.ExitCode.FAILED


class InvalidRecipientError(errors.UsageError):
    """The text is not a key that files can be encrypted to."""


PrivateKey = ec.EllipticCurvePrivateKey | rsa.RSAPrivateKey
PublicKey = ec.EllipticCurvePublicKey | rsa.RSAPublicKey


def new_key(kind: KeyType) -> PrivateKey:
    """Create an EC P-256 or 2048-bit RSA key, which all known clients support (facts 10)."""
    if kind is KeyType.EC:
        return ec.generate_private_key(ec.SECP256R1())
    return rsa.generate_private_key(public_exponent=65537, key_size=2048)


def key_pem(key: PrivateKey) -> Secret:
    """Return PKCS #8, not encrypted: an OpenVPN started at boot cannot ask for a passphrase."""
    return Secret(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()).decode("ascii"))


def sign(key: PrivateKey, text: bytes) -> bytes:
    """Sign a text of ours, which must begin with words that identify its kind: a CA key also signs certificates."""
    if isinstance(key, rsa.RSAPrivateKey):
        return key.sign(text, padding.PKCS1v15(), SHA256())
    return key.sign(text, ec.ECDSA(SHA256()))


def is_signed(key: PublicKey, text: bytes, signature: bytes) -> bool:
    """Return True if the signature of the text is valid."""
    try:
        if isinstance(key, rsa.RSAPublicKey):
            key.verify(signature, text, padding.PKCS1v15(), SHA256())
        else:
            key.verify(signature, text, ec.ECDSA(SHA256()))
    except InvalidSignature:
        return False
    return True


def load_key(pem: Secret) -> PrivateKey:
    """Parse a private key. Raises CorruptKeyError; no message contains the text."""
    try:
        key = load_pem_private_key(pem.reveal().encode(), password=None)
    except (ValueError, TypeError):
        key = None
    if not isinstance(key, PrivateKey):
        raise CorruptKeyError(
            "not a private key of this authority", hint="restore the file from your backup of the authority"
        )
    return key


METADATA_MAX = 733
"""Maximum bytes: a wrapped key has at most 1024 (OpenVPN's `TLS_CRYPT_V2_MAX_WKC_LEN`), with tag, key, length, kind."""
_SERVER = "OpenVPN tls-crypt-v2 server key"
_CLIENT = "OpenVPN tls-crypt-v2 client key"
_HARD_RESET_V2, _HARD_RESET_OF_SERVER, _HARD_RESET_V3 = 7 << 3, 8 << 3, 10 << 3
"""Types of control packets; the third includes the client's own key."""
_EARLY = 0x0F000001
"""Number of the first packet by which 2.6 recognises that it may reply without keeping a session."""
_USER = b"\x00"
"""Type of metadata: custom bytes, which a `tls-crypt-v2-verify` script could read."""


def server_key() -> Secret:
    """Create a server's tls-crypt-v2 key, which creates and opens the keys of its clients."""
    return _pem(_SERVER, os.urandom(128))


def client_key(server: Secret, metadata: bytes) -> Secret:
    """Create a client's tls-crypt-v2 key for that server; only the server can read `metadata`, nobody can change it."""
    if len(metadata) > METADATA_MAX:
        raise ValueError(msg(f"metadata of more than {arg(METADATA_MAX)} bytes"))
    both = _server_bytes(server)
    encryption, authentication = both[:32], both[64:96]
    key = os.urandom(256)
    plain = key + _USER + metadata
    length = (32 + len(plain) + 2).to_bytes(2, "big")
    tag = hmac.digest(authentication, length + plain, sha256)
    return _pem(_CLIENT, key + tag + _ctr(encryption, tag, plain) + length)


@dataclass(frozen=True, slots=True)
class FirstPacket:
    """The first packet of a client's session, and the check of the server's reply.

    Only a server with the same key can reply. The packet opens a session and nothing more: no certificate is shown, and
    a tunnel of the same member stays up.
    """

    wrap_key: Secret
    """tls-crypt-v2 client key, or the shared key of tls-crypt."""
    session: bytes = field(default_factory=lambda: os.urandom(8))
    """Session id, which the reply must contain."""

    def datagram(self) -> bytes:
        """Return the packet with the current time."""
        keys, wrapped_key = _client_bytes(self.wrap_key)
        head = bytes([_HARD_RESET_V3 if wrapped_key else _HARD_RESET_V2]) + self.session
        head += _EARLY.to_bytes(4, "big") + int(time.time()).to_bytes(4, "big")
        plain = bytes(5)  # nothing acknowledged, message 0
        tag = hmac.digest(keys[192:224], head + plain, sha256)
        return head + tag + _ctr(keys[128:160], tag, plain) + wrapped_key

    def is_answer(self, datagram: bytes) -> bool:
        """Return True if a server with the key has sent this reply, for this session."""
        keys, _ = _client_bytes(self.wrap_key)
        head, tag, ciphertext = datagram[:17], datagram[17:49], datagram[49:]
        if not ciphertext or head[0] & 0xF8 != _HARD_RESET_OF_SERVER:
            return False
        plain = _ctr(keys[:32], tag, ciphertext)
        is_made_by_server = hmac.compare_digest(hmac.digest(keys[64:96], head + plain, sha256), tag)
        return is_made_by_server and plain.startswith(bytes([1]) + bytes(4) + self.session)  # message 0 acknowledged


def shared_key() -> Secret:
    """Create a static key for clients without tls-crypt-v2; they share it, so it only keeps strangers out."""
    rows = textwrap.wrap(os.urandom(256).hex(), 32)
    head = ["#", "# 2048 bit OpenVPN static key", "#", "-----BEGIN OpenVPN Static key V1-----"]
    return Secret("\n".join([*head, *rows, "-----END OpenVPN Static key V1-----", ""]))


def _pem(label: str, data: bytes) -> Secret:
    rows = textwrap.wrap(base64.b64encode(data).decode("ascii"), 64)
    return Secret("\n".join([f"-----BEGIN {label}-----", *rows, f"-----END {label}-----", ""]))


def _server_bytes(key: Secret) -> bytes:
    match = re.fullmatch(rf"\s*-----BEGIN {_SERVER}-----([A-Za-z0-9+/=\s]+)-----END {_SERVER}-----\s*", key.reveal())
    try:
        data = base64.b64decode("".join(match[1].split()), validate=True) if match else b""
    except ValueError:
        data = b""
    if len(data) != 128:  # noqa: PLR2004 - two keys of 64 bytes each
        raise CorruptKeyError("not a tls-crypt-v2 server key", hint="restore it from a backup of the authority")
    return data


def _client_bytes(key: Secret) -> tuple[bytes, bytes]:
    """Return the keys of both directions, the server's first, and the wrapped key sent with the packet."""
    rows = re.sub(r"^(#|-----).*$", "", key.reveal(), flags=re.MULTILINE).split()
    if "Static key" in key.reveal():
        return bytes.fromhex("".join(rows)), b""
    data = base64.b64decode("".join(rows))
    return data[:256], data[256:]


def _ctr(key: bytes, tag: bytes, data: bytes) -> bytes:
    encryptor = Cipher(AES(key), CTR(tag[:16])).encryptor()
    return encryptor.update(data) + encryptor.finalize()
