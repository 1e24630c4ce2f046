"""Keys that wrap OpenVPN's control channel, made without OpenVPN.

Formats: `doc/tls-crypt-v2.txt` of OpenVPN, accepted by 2.5 to 2.7 and by OpenVPN Connect's engine (facts 3); the shared
key is the static key file that `openvpn --genkey secret` writes.
"""

from __future__ import annotations

import base64
import hmac
import os
import re
import textwrap
from hashlib import sha256

from cryptography.hazmat.primitives.ciphers import Cipher
from cryptography.hazmat.primitives.ciphers.algorithms import AES
from cryptography.hazmat.primitives.ciphers.modes import CTR

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.vpn.pki._errors import KeyDamaged

__all__ = ["METADATA_MAX", "client_key", "server_key", "shared_key"]

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
