"""The key with which this computer signs checklists: Ed25519 (RFC 8032), made at first use, for its owner only."""

from __future__ import annotations

import base64
import hashlib
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
    load_pem_private_key,
)

from atlantis_netcfg.checklist._errors import KeyDamaged
from atlantis_netcfg.journal import make_private, os_errors_as, sync_directory, write_atomically

if TYPE_CHECKING:
    from pathlib import Path

FILE = "checklist.key"
_OTHERS = 0o077


@dataclass(frozen=True, slots=True)
class Key:
    """The private key."""

    private: Ed25519PrivateKey

    @classmethod
    def known(cls, path: Path) -> Key | None:
        """The key of this computer; None before its first signature. Raises KeyDamaged."""
        try:
            data, mode = path.read_bytes(), path.stat().st_mode
        except FileNotFoundError:
            return None
        except OSError as error:
            raise KeyDamaged(f"the key for signing cannot be read: {error.strerror} ({path})") from error
        if mode & _OTHERS:
            raise KeyDamaged(
                f"other users of this computer can read the key for signing ({path})",
                hint=f"chmod 600 {path}; where others do work here, remove it instead: a new one is made",
            )
        return cls(_loaded(data, path))

    @classmethod
    def made(cls, path: Path) -> Key:
        """The key of this computer, made if there is none. Of two who make it at once, one wins and both use that."""
        if (key := cls.known(path)) is not None:
            return key
        pem = Ed25519PrivateKey.generate().private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
        scratch = path.with_name(f".{path.name}.new.{os.getpid()}")
        with os_errors_as("the key for signing", path):
            make_private(path.parent)
            write_atomically(scratch, pem)
            try:
                path.hardlink_to(scratch)
            except FileExistsError:
                pass  # the other one was first
            finally:
                scratch.unlink()
            sync_directory(path.parent)
        key = cls.known(path)
        assert key is not None, "it was just made"  # noqa: S101
        return key

    @property
    def public(self) -> str:
        """The public half, raw, base64."""
        return _text(self.private.public_key().public_bytes(Encoding.Raw, PublicFormat.Raw))

    @property
    def fingerprint(self) -> str:
        """What people compare: `SHA256:…`."""
        return fingerprint(self.public)

    def sign(self, data: bytes) -> str:
        """The signature, base64."""
        return _text(self.private.sign(data))


def fingerprint(public: str) -> str:
    """SHA-256 over the raw public key, base64 without padding, as OpenSSH writes fingerprints. Raises ValueError."""
    return "SHA256:" + _text(hashlib.sha256(_raw(public)).digest()).rstrip("=")


def fits(public: str, signature: str, data: bytes) -> bool:
    """Whether the holder of the key has signed exactly this."""
    try:
        Ed25519PublicKey.from_public_bytes(_raw(public)).verify(_raw(signature), data)
    except (ValueError, InvalidSignature):
        return False
    return True


def _loaded(data: bytes, path: Path) -> Ed25519PrivateKey:
    try:
        key = load_pem_private_key(data, password=None)
    except (ValueError, TypeError, UnsupportedAlgorithm):
        key = None
    if not isinstance(key, Ed25519PrivateKey):
        hint = "restore it from a copy, or move it away: a new one is made, and what the old one signed becomes unknown"
        raise KeyDamaged(f"the key for signing cannot be read ({path})", hint=hint)
    return key


def _text(data: bytes) -> str:
    return base64.b64encode(data).decode()


def _raw(text: str) -> bytes:
    """Bytes of base64, of which each has one way to be written. Raises ValueError."""
    data = base64.b64decode(text, validate=True)
    if _text(data) != text:
        raise ValueError("not as it is written")
    return data
