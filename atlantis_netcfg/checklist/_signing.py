"""Sign a checklist for a named person: canonical JSON and this computer's Ed25519 key (RFC 8032)."""

from __future__ import annotations

import base64
import errno
import hashlib
import json
import os
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NoReturn

from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
    load_pem_private_key,
)

from atlantis_netcfg import runs
from atlantis_netcfg.checklist.report import Document, Signature
from atlantis_netcfg.core import errors
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.printable import lines

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from datetime import datetime
    from pathlib import Path


def content(path: Path) -> bytes:
    """Return the bytes of a file. Raises OSError, also for a pipe instead of a file, which would block."""
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL), str(path))
    return path.read_bytes()


def canonical(data: object) -> bytes:
    """Encode for hashing and signing: sorted keys, no whitespace, UTF-8."""
    return json.dumps(data, ensure_ascii=False, allow_nan=False, sort_keys=True, separators=(",", ":")).encode(
        errors="replace"
    )


def render_json(data: object) -> bytes:
    """Encode for storage: control characters from devices are escaped, so that printing the file is safe."""
    return lines(json.dumps(data, ensure_ascii=False, allow_nan=False, indent=1)).encode() + b"\n"


def parse_json(data: bytes) -> Any:  # noqa: ANN401 - what JSON holds
    """Read it. Raises ValueError for what two readers could read differently: a key twice, NaN, no UTF-8."""
    try:
        return json.loads(data.decode(), object_pairs_hook=_reject_duplicate_keys, parse_constant=_reject_constant)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def _reject_duplicate_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict(pairs)
    if len(result) != len(pairs):
        raise ValueError("a key is defined twice")
    return result


def _reject_constant(word: str) -> NoReturn:
    raise ValueError(msg(f"{arg(word)} is not a number"))


class ChecklistUsageError(errors.UsageError):
    """The request does not fit the checklist; nothing was recorded."""


class SigningError(errors.NetcfgError):
    """The checklist has open items and cannot be signed as a whole; it stays open."""

    exit = errors.ExitCode.CHECKS_FAILED


class SigningKeyError(errors.NetcfgError):
    """The signing key of this computer cannot be used."""

    exit = errors.ExitCode.FAILED


FILE = "checklist.key"
_OTHERS = 0o077


@dataclass(frozen=True, slots=True)
class SigningKey:
    """A private signing key."""

    private: Ed25519PrivateKey

    @classmethod
    def load(cls, path: Path) -> SigningKey | None:
        """Load this computer's key; None before its first signature. Raises SigningKeyError."""
        try:
            data, mode = path.read_bytes(), path.stat().st_mode
        except FileNotFoundError:
            return None
        except OSError as error:
            raise SigningKeyError(f"the signing key cannot be read: {arg(error.strerror)} ({arg(path)})") from error
        if mode & _OTHERS:
            raise SigningKeyError(
                f"other users of this computer can read the signing key ({arg(path)})",
                hint=f"chmod 600 {arg(path)}; if others work on this computer, remove the key instead: a new one is "
                "created",
            )
        return cls(_parse_private_key(data, path))

    @classmethod
    def load_or_create(cls, path: Path) -> SigningKey:
        """Load this computer's key or create it. If two processes create it at once, both use the winner's key."""
        if (key := cls.load(path)) is not None:
            return key
        pem = Ed25519PrivateKey.generate().private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
        with runs.os_errors_as("the signing key", path):
            runs.make_private(path.parent)
            with suppress(FileExistsError):  # the other one was first
                runs.write_atomically(path, pem, replace=False)
        key = cls.load(path)
        assert key is not None, "it was just created"  # noqa: S101
        return key

    @property
    def public(self) -> str:
        """Public key: raw, base64."""
        return _encode_base64(self.private.public_key().public_bytes(Encoding.Raw, PublicFormat.Raw))

    @property
    def fingerprint(self) -> str:
        """Fingerprint of the public key for comparison by people: `SHA256:…`."""
        return fingerprint(self.public)

    def sign(self, data: bytes) -> str:
        """Return the signature, base64."""
        return _encode_base64(self.private.sign(data))


def fingerprint(public: str) -> str:
    """SHA-256 over the raw public key, base64 without padding, as OpenSSH writes fingerprints. Raises ValueError."""
    return "SHA256:" + _encode_base64(hashlib.sha256(_raw(public)).digest()).rstrip("=")


def verify_signature(public: str, signature: str, data: bytes) -> bool:
    """Return whether the signature is valid for the public key and exactly these data."""
    try:
        Ed25519PublicKey.from_public_bytes(_raw(public)).verify(_raw(signature), data)
    except (ValueError, InvalidSignature):
        return False
    return True


def _parse_private_key(data: bytes, path: Path) -> Ed25519PrivateKey:
    try:
        key = load_pem_private_key(data, password=None)
    except (ValueError, TypeError, UnsupportedAlgorithm):
        key = None
    if not isinstance(key, Ed25519PrivateKey):
        hint = (
            "restore it from a copy, or move it away: a new one is created, and signatures of the old one become "
            "unknown"
        )
        raise SigningKeyError(f"the signing key cannot be read ({arg(path)})", hint=hint)
    return key


def _encode_base64(data: bytes) -> str:
    return base64.b64encode(data).decode()


def _raw(text: str) -> bytes:
    """Decode canonical base64, in which data have exactly one encoding. Raises ValueError."""
    data = base64.b64decode(text, validate=True)
    if _encode_base64(data) != text:
        raise ValueError("not canonical base64")
    return data


REPORT = "report.json"
MANIFEST = "manifest.json"


@dataclass(frozen=True, slots=True)
class SigningTrouble:
    """A difference from the signed state."""

    file: str
    """File in the folder of the checklist."""
    what: str
    """Problem, for example `is not as it was signed: …`."""
    hint: str = ""


def digest(data: dict[str, Any]) -> str:
    """SHA-256 (hex) over a document's JSON without its signature, whatever version of this tool wrote it."""
    return hashlib.sha256(canonical({name: value for name, value in data.items() if name != "signed"})).hexdigest()


def sign_document(document: Document, by: str, at: datetime, key: SigningKey) -> Document:
    """Return the document with its signature."""
    block = Signature(
        by=by,
        at=at,
        digest=digest(document.model_dump(mode="json")),
        key=key.fingerprint,
        public=key.public,
        signature="",
    )
    signature = sign_data(block.model_dump(mode="json"), key)["signature"]
    return document.model_copy(update={"signed": block.model_copy(update={"signature": signature})})


def sign_data(data: dict[str, Any], key: SigningKey) -> dict[str, Any]:
    """Return the data with a signature over all of it; `key` and `public` identify the signer."""
    whole = data | {"key": key.fingerprint, "public": key.public}
    whole.pop("signature", None)
    return whole | {"signature": key.sign(canonical(whole))}


def broken_seal(
    data: dict[str, Any], trusted_keys: Collection[str], *, is_explicit: bool = False
) -> Iterator[tuple[str, str]]:
    """Yield what is wrong with the signature of data, and what to do.

    `trusted_keys`: fingerprints of trusted keys; `is_explicit`: a person has named them, and no other key is accepted.
    """
    rest = {name: value for name, value in data.items() if name != "signature"}
    public, signature = str(data.get("public", "")), str(data.get("signature", ""))
    if not verify_signature(public, signature, canonical(rest)):
        yield "the signature does not match the content", "do not rely on it; ask the signer for the original"
        return
    if fingerprint(public) != data.get("key"):
        yield "the fingerprint is not the one of the key that signed", "do not rely on it"
    elif data["key"] not in trusted_keys:
        yield (
            msg(
                f"it is signed with key {arg(data['key'])}, but another key was requested"
                if is_explicit
                else f"it is signed with key {arg(data['key'])}, which is unknown on this computer"
            ),
            "compare the fingerprint with the signer by telephone or on paper, never with the file itself",
        )


def _continue_hint(document: dict[str, Any]) -> str:
    rehearse_option = " --rehearse" if document["rehearsed"] else ""
    return msg(
        f"nobody has signed it: `provision check site={arg(document['site'])}{arg(rehearse_option)}` continues it, on "
        "the computer on which it was made"
    )


def check_report(data: bytes, trusted_keys: Collection[str], *, is_explicit: bool = False) -> Iterator[SigningTrouble]:
    """Yield everything in a `report.json` that differs from what was signed."""
    try:
        document = parse_json(data)
        same = render_json(document) == data
        Document.model_validate(document)
    except ValueError:
        yield SigningTrouble(REPORT, "is not a checklist report, or is damaged", "ask the signer for the original")
        return
    block = document.get("signed")
    if block is None:
        yield SigningTrouble(REPORT, "is not signed", _continue_hint(document))
        return
    if block["digest"] != digest(document):
        yield SigningTrouble(REPORT, "was changed after it was signed", "do not rely on it; ask for the original")
    elif not same:
        yield SigningTrouble(
            REPORT, "has the signed content, but is not byte for byte as it was written", "ask for the original"
        )
    for what, hint in broken_seal(block, trusted_keys, is_explicit=is_explicit):
        yield SigningTrouble(REPORT, what, hint)
