"""Keys, sources and pins of apt: checked before they are written, and taken back where they do not work."""

from __future__ import annotations

import base64
import binascii
import hashlib
import re
import time
from dataclasses import dataclass
from typing import Mapping, Sequence

from atlantis_netcfg.core.messages import arg, msg

from .errors import ModuleError
from .filesystem import FileSystem, Stamps
from .openpgp import NotAKey, PublicKey, public_keys

_STAMP = "apt-update"
_WARN_DAYS = 60
_DAY_S = 86400


@dataclass(frozen=True)
class AptKey:
    """A key that signs an apt source, with its target path on the computer."""

    path: str
    content: bytes
    fingerprint: str


def key_of(parameter: Mapping[str, str]) -> AptKey:
    """Read a key from the module's parameters. Raises ModuleError if it is damaged."""
    try:
        content = base64.b64decode(parameter["content_base64"], validate=True)
    except binascii.Error:
        raise ModuleError(
            f"the key for {arg(parameter['path'])} did not arrive completely", "run the same command again"
        ) from None
    return AptKey(parameter["path"], content, re.sub(r"\s", "", parameter["fingerprint"]).upper())


def check_key(key: AptKey, now: float) -> str | None:
    """Check that a key is the expected one and valid at `now` (the computer's clock); return a note, if any."""
    try:
        keys = public_keys(key.content)
    except NotAKey as why:
        raise ModuleError(
            f"the file for {arg(key.path)} is not a public key: {arg(why)}", "download it again and compare its size"
        ) from None
    if [public_key.fingerprint for public_key in keys] != [key.fingerprint]:
        raise ModuleError(
            f"the key for {arg(key.path)} is {arg(', '.join(item.fingerprint for item in keys))}, the inventory has "
            f"{arg(key.fingerprint)}",
            "ask the archive's maintainer which key is right; do not use a key that nobody vouches for",
        )
    return _check_key_validity(keys[0], now)


def _check_key_validity(key: PublicKey, now: float) -> str | None:
    today = _day(now)
    if now < key.renewed_at:
        raise ModuleError(
            f"the computer's clock says {arg(today)}; the key {arg(key.fingerprint)} was created on "
            f"{arg(_day(key.renewed_at))}",
            "set the clock: `date --set '2026-01-31 12:00'` until a time server can be reached",
        )
    if key.expires is None or now < key.expires - _WARN_DAYS * _DAY_S:
        return None
    if now >= key.expires:
        raise ModuleError(
            f"the key {arg(key.fingerprint)} expired on {arg(_day(key.expires))}; the computer's clock says "
            f"{arg(today)}",
            "put the renewed key into the inventory (`key_file`); if the clock is wrong, set it",
        )
    return msg(
        f"the key {arg(key.fingerprint)} expires on {arg(_day(key.expires))}: put the renewed one into the inventory"
    )


def _day(seconds: float) -> str:
    return time.strftime("%Y-%m-%d", time.gmtime(seconds))


class Sources:
    """Our files below /etc/apt and our keys: `files` maps a path to its content, keys come first."""

    def __init__(self, tree: FileSystem, files: Mapping[str, bytes], absent: Sequence[str] = ()) -> None:
        self.tree = tree
        self.files = dict(files)
        self.absent = tuple(absent)
        self.stamps = Stamps(tree)
        self.was: dict[str, bytes | None] = {}

    @property
    def changed_paths(self) -> list[str]:
        """Files whose content differs from the desired one."""
        return [path for path, content in self.files.items() if self.tree.read(path) != content]

    @property
    def conflicting_paths(self) -> list[str]:
        """Existing files that configure the same sources in another form."""
        return [path for path in self.absent if self.tree.read(path) is not None]

    @property
    def is_updated(self) -> bool:
        """Whether apt's lists were last updated with exactly these files."""
        return self.stamps.holds(_STAMP, self._digests())

    @property
    def urls(self) -> list[str]:
        """URLs of the sources in the files."""
        texts = [content.decode(errors="replace") for path, content in self.files.items() if not path.endswith(".gpg")]
        matches = [re.findall(r"^URIs:(.*)$|^deb(?: \[.*?\])? (\S+)", text, re.MULTILINE) for text in texts]
        return [url for match in matches for pair in match for words in pair for url in words.split()]

    def before_and_after(self, path: str) -> tuple[str, str]:
        """Return the current and the desired content of a file, for the diff; keys are not text."""
        return (_decode_or_digest(self.was.get(path, self.tree.read(path))), _decode_or_digest(self.files.get(path)))

    def write(self) -> None:
        """Write the files that differ, and keep their previous content."""
        for path in [*self.changed_paths, *self.conflicting_paths]:
            self.was[path] = self.tree.read(path)
        for path in self.was:
            if path in self.files:
                self.tree.write(path, self.files[path])
            else:
                self.tree.remove(path)

    def take_back(self) -> None:
        """Restore apt's previous files: sources that do not work would break every later use of apt."""
        for path, content in reversed(list(self.was.items())):
            if content is None:
                self.tree.remove(path)
            else:
                self.tree.write(path, content)
        self.was.clear()

    def note(self) -> None:
        """Note that the lists were updated with these files."""
        if self.files and not self.is_updated:
            self.stamps.note(_STAMP, self._digests())

    def _digests(self) -> dict[str, str]:
        return {path: hashlib.sha256(content).hexdigest() for path, content in self.files.items()}


def _decode_or_digest(content: bytes | None) -> str:
    try:
        return (content or b"").decode()
    except UnicodeDecodeError:
        return f"binary, SHA-256 {hashlib.sha256(content or b'').hexdigest()}\n"
