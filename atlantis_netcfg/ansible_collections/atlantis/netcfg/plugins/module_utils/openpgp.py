"""Parser for public OpenPGP keys: fingerprint, creation time and expiry time.

It reads just enough to detect that an archive's key has expired, or is not the expected one, before apt runs; apt
itself checks the signatures. Versions 3 and 4 of RFC 4880: packets (4), armour (6), fingerprint (12.2), key expiration
(5.2.3.6). It also runs on gateways, which need not have gpg, so it keeps to Python 3.8.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from collections.abc import Iterator

_SIGNATURE, _KEY = 2, 6
_DIRECT = 0x1F
_CERTIFICATIONS = (0x10, 0x11, 0x12, 0x13, _DIRECT)
"""Signature types over a user name or over the key; of the latter only those that limit its life count."""
_CREATION_TIME, _EXPIRES, _ISSUER, _ISSUER_FINGERPRINT = 2, 9, 16, 33
_ARMOUR = re.compile(
    rb"-----BEGIN PGP PUBLIC KEY BLOCK-----[ \t\r]*\n(.*?)\n-----END PGP PUBLIC KEY BLOCK-----", re.DOTALL
)


class NotAKey(ValueError):
    """These bytes are no public OpenPGP key."""


@dataclass(frozen=True)
class PublicKey:
    """A primary key. Times are seconds since 1970 (UTC)."""

    fingerprint: str
    """40 hex digits, upper case."""
    created_at: int
    renewed_at: int
    """Time of the owner's latest signature, seconds since 1970; a clock before that is wrong."""
    expires: int | None
    """Seconds since 1970; None: never."""


def binary(content: bytes) -> bytes:
    """Take the ASCII armour off, if there is any. Raises NotAKey."""
    blocks = [match[1] for match in _ARMOUR.finditer(content)]
    if not blocks:
        if content[:1] and content[0] & 0x80:
            return content
        raise NotAKey("it is neither an armoured nor a binary public key")
    packets = b""
    for block in blocks:
        lines = [line.strip() for line in block.split(b"\n")]
        if b"" in lines:
            lines = lines[lines.index(b"") + 1 :]
        try:
            packets += base64.b64decode(b"".join(line for line in lines if not line.startswith(b"=")), validate=True)
        except binascii.Error:
            raise NotAKey("its armour is damaged") from None
    return packets


def public_keys(content: bytes) -> list[PublicKey]:
    """Return the primary keys of a key file, armoured or binary, in its order. Raises NotAKey."""
    keys: list[PublicKey] = []
    try:
        for tag, body in _packets(binary(content)):
            if tag == _KEY:
                keys.append(_key(body))
            elif tag == _SIGNATURE and keys:
                keys[-1] = _with_signature(keys[-1], body)
    except IndexError:
        raise NotAKey("it is truncated") from None
    if not keys:
        raise NotAKey("it contains no public key")
    return keys


def _packets(data: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at < len(data):
        head = data[at]
        if not head & 0x80:
            raise NotAKey("it is damaged")
        if head & 0x40:
            tag, (length, size) = head & 0x3F, _new_length(data, at + 1)
        else:
            tag, size = (head >> 2) & 0x0F, 1 << (head & 3)
            length = int.from_bytes(data[at + 1 : at + 1 + size], "big")
        at += 1 + size
        if at + length > len(data):
            raise NotAKey("it is truncated")
        yield tag, data[at : at + length]
        at += length


def _new_length(data: bytes, at: int) -> tuple[int, int]:
    """Return the length of a packet or subpacket and the size of its length field (RFC 4880 4.2.2, 5.2.3.1)."""
    first = data[at]
    if first < 192:  # noqa: PLR2004 - of the RFC, like the next two
        return first, 1
    if first < 224:  # noqa: PLR2004
        return ((first - 192) << 8) + data[at + 1] + 192, 2
    if first == 255:  # noqa: PLR2004
        return int.from_bytes(data[at + 1 : at + 5], "big"), 5
    raise NotAKey("it is written in partial packets, which keys never are")


def _key(body: bytes) -> PublicKey:
    if body[0] != 4:  # noqa: PLR2004 - the version that every archive uses
        raise NotAKey(msg(f"it is a key of version {arg(body[0])}"))
    creation_time = int.from_bytes(body[1:5], "big")
    digest = hashlib.sha1(b"\x99" + len(body).to_bytes(2, "big") + body)  # noqa: S324 - what a fingerprint is
    return PublicKey(digest.hexdigest().upper(), creation_time, creation_time, None)


def _with_signature(key: PublicKey, body: bytes) -> PublicKey:
    """Add the data of the owner's signature to a key; the latest signature counts."""
    if body[0] != 4 or body[1] not in _CERTIFICATIONS:  # noqa: PLR2004
        return key
    size = int.from_bytes(body[4:6], "big")
    hashed_part = body[6 : 6 + size]
    more = int.from_bytes(body[6 + size : 8 + size], "big")
    values = dict(_subpackets(body[8 + size : 8 + size + more]))
    values.update(_subpackets(hashed_part))
    life = int.from_bytes(dict(_subpackets(hashed_part)).get(_EXPIRES, b""), "big")
    if body[1] == _DIRECT and not life:
        return key
    issuer = values.get(_ISSUER, values.get(_ISSUER_FINGERPRINT, b"")[1:][-8:]).hex().upper()
    signature_time = int.from_bytes(values.get(_CREATION_TIME, b""), "big")
    if issuer != key.fingerprint[-16:] or signature_time < key.renewed_at:
        return key
    return PublicKey(key.fingerprint, key.created_at, signature_time, key.created_at + life if life else None)


def _subpackets(data: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at < len(data):
        length, size = _new_length(data, at) if data[at] < 224 or data[at] == 255 else _two(data, at)  # noqa: PLR2004
        at += size
        yield data[at] & 0x7F, data[at + 1 : at + length]
        at += length


def _two(data: bytes, at: int) -> tuple[int, int]:
    """Return a two-byte subpacket length: subpackets have no partial lengths, so two bytes are used up to 254."""
    return ((data[at] - 192) << 8) + data[at + 1] + 192, 2
