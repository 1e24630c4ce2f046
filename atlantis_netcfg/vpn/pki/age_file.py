"""Writer of age's passphrase format (age-encryption.org/v1) at fixed cost; pyrage's cost depends on the load."""

from __future__ import annotations

import base64
import os
import textwrap

from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.hmac import HMAC
from cryptography.hazmat.primitives.kdf.hkdf import HKDF
from cryptography.hazmat.primitives.kdf.scrypt import Scrypt

WORK_FACTOR = 18
"""Exponent of scrypt's N: 2 to this power, which needs 256 MiB, whatever else the computer runs."""
_CHUNK = 65_536


def encrypt(data: bytes, passphrase: str) -> bytes:
    """Encrypt to armoured text."""
    key, salt, nonce = os.urandom(16), os.urandom(16), os.urandom(16)
    wrap = Scrypt(b"age-encryption.org/v1/scrypt" + salt, 32, 2**WORK_FACTOR, 8, 1).derive(passphrase.encode())
    body = _base64(ChaCha20Poly1305(wrap).encrypt(bytes(12), key, None))
    header = b"age-encryption.org/v1\n-> scrypt %s %d\n%s\n---" % (_base64(salt), WORK_FACTOR, body)
    mac = HMAC(_derive(key, b"", b"header"), SHA256())
    mac.update(header)
    file = b"%s %s\n%s%s" % (header, _base64(mac.finalize()), nonce, _payload(key, nonce, data))
    lines = textwrap.wrap(base64.b64encode(file).decode(), 64)
    return "\n".join(["-----BEGIN AGE ENCRYPTED FILE-----", *lines, "-----END AGE ENCRYPTED FILE-----", ""]).encode()


def _payload(key: bytes, nonce: bytes, data: bytes) -> bytes:
    cipher = ChaCha20Poly1305(_derive(key, nonce, b"payload"))
    chunks = [data[at : at + _CHUNK] for at in range(0, len(data), _CHUNK)] or [b""]
    return b"".join(
        cipher.encrypt(number.to_bytes(11, "big") + bytes([number == len(chunks) - 1]), chunk, None)
        for number, chunk in enumerate(chunks)
    )


def _derive(key: bytes, salt: bytes, info: bytes) -> bytes:
    return HKDF(SHA256(), 32, salt, info).derive(key)


def _base64(data: bytes) -> bytes:
    return base64.b64encode(data).rstrip(b"=")
