"""age's passphrase encryption (age-encryption.org/v1) at a strength for tests: a millisecond in place of a second.

`pyrage` always chooses a cost of about one second. Files of this module are opened by the real `pyrage` and `age`.
"""

import base64
import os
import textwrap

from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.hmac import HMAC
from cryptography.hazmat.primitives.kdf.hkdf import HKDF
from cryptography.hazmat.primitives.kdf.scrypt import Scrypt

_COST = 4
"""Two to this power is scrypt's N."""
_CHUNK = 65536


def encrypt(plaintext: bytes, passphrase: str, *, armored: bool = False) -> bytes:
    """In place of `pyrage.passphrase.encrypt`."""
    key, salt, nonce = os.urandom(16), os.urandom(16), os.urandom(16)
    wrap = Scrypt(b"age-encryption.org/v1/scrypt" + salt, 32, 2**_COST, 8, 1).derive(passphrase.encode())
    body = _base64(ChaCha20Poly1305(wrap).encrypt(bytes(12), key, None))
    header = f"age-encryption.org/v1\n-> scrypt {_base64(salt)} {_COST}\n{body}\n---".encode()
    mac = HMAC(_derive(key, b"", b"header"), SHA256())
    mac.update(header)
    data = b"%s %s\n%s%s" % (header, _base64(mac.finalize()).encode(), nonce, _payload(key, nonce, plaintext))
    if not armored:
        return data
    lines = textwrap.wrap(base64.b64encode(data).decode(), 64)
    return "\n".join(["-----BEGIN AGE ENCRYPTED FILE-----", *lines, "-----END AGE ENCRYPTED FILE-----", ""]).encode()


def _payload(key: bytes, nonce: bytes, plaintext: bytes) -> bytes:
    cipher = ChaCha20Poly1305(_derive(key, nonce, b"payload"))
    chunks = [plaintext[at : at + _CHUNK] for at in range(0, len(plaintext), _CHUNK)] or [b""]
    return b"".join(
        cipher.encrypt(number.to_bytes(11, "big") + bytes([number == len(chunks) - 1]), chunk, None)
        for number, chunk in enumerate(chunks)
    )


def _derive(key: bytes, salt: bytes, info: bytes) -> bytes:
    return HKDF(SHA256(), 32, salt, info).derive(key)


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode().rstrip("=")
