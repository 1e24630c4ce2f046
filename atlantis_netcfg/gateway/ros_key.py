"""The key that signs the archive of ROS 2: from the inventory, compared and dated before any gateway is contacted."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.gateway.openpgp import NotAKey, binary, public_keys

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.gateway.ros_releases import Archive

__all__ = ["FOLDER", "ArchiveKey", "archive_key"]

FOLDER = "keys"
"""Below the inventory; public keys only."""
_WARN = timedelta(days=60)


@dataclass(frozen=True, slots=True)
class ArchiveKey:
    """A public key as apt reads it."""

    content: bytes
    """Binary, whatever the file was."""
    fingerprint: str
    note: str | None = None
    """What a technician should know of it."""


def archive_key(inventory: Path, archive: Archive, declared: str | None, now: datetime) -> ArchiveKey:
    """Read the declared key, or the archive's own, which has to be the one that we know. Raises UsageError."""
    name = declared or archive.key_file
    path = inventory / FOLDER / name
    content = _read(path, archive)
    try:
        found = public_keys(content)
        packets = binary(content)
    except NotAKey as why:
        raise UsageError(f"{FOLDER}/{name} of the inventory is no public key: {why}", hint=_fetch(archive)) from None
    if len(found) != 1:
        raise UsageError(
            f"{FOLDER}/{name} of the inventory holds {len(found)} keys, and an archive is signed by one",
            hint=f"gpg --export --armor {archive.fingerprint} > {path}",
        )
    key = found[0]
    if declared is None and key.fingerprint != archive.fingerprint:
        raise UsageError(
            f"{FOLDER}/{name} of the inventory is another key: {key.fingerprint}, not {archive.fingerprint}",
            hint=f"{_fetch(archive)}; if the archive has a new key, ask who keeps it, and declare it as `key_file`",
        )
    if key.expires is None:
        return ArchiveKey(packets, key.fingerprint)
    expires = datetime.fromtimestamp(key.expires, UTC)
    if now >= expires:
        raise UsageError(
            f"the key of the archive of ROS 2 expired on {expires:%Y-%m-%d}: {FOLDER}/{name} of the inventory",
            hint=f"{_fetch(archive)}; the same key is renewed now and then, with a later end",
        )
    text = f"the key of the archive of ROS 2 expires on {expires:%Y-%m-%d}: fetch the renewed one before"
    return ArchiveKey(packets, key.fingerprint, text if now >= expires - _WARN else None)


def _read(path: Path, archive: Archive) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        why = "is missing" if isinstance(error, FileNotFoundError) else f"cannot be read: {error.strerror}"
        raise UsageError(
            f"the key that signs the archive of ROS 2 {why}: {FOLDER}/{path.name} of the inventory",
            hint=_fetch(archive),
        ) from error


def _fetch(archive: Archive) -> str:
    return (
        f"fetch it where there is internet: curl -fsSL '{archive.key_url}' -o inventory/{FOLDER}/{archive.key_file}; "
        f"its fingerprint has to be {archive.fingerprint}"
    )
