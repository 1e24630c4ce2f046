"""The archive inside a hand-out: the same bytes for the same files, and nothing taken from one that is not ours.

It is a tar and not a zip, since a tar is unpacked as it comes out of `age --decrypt`: no key touches the disk on its
way, and every unpacker keeps the mode of the files.
"""

from __future__ import annotations

import io
import re
import tarfile
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["NotAHandOut", "pack", "unpack"]

_NAME = re.compile(r"[a-z0-9][a-z0-9.-]{0,79}/[A-Za-z0-9][A-Za-z0-9.-]{0,79}")
_FILES, _BYTES = 20, 1024 * 1024
_PRIVATE = 0o600


class NotAHandOut(UsageError):
    """A file that is no hand-out of ours, or a damaged one."""

    def __init__(self, what: str) -> None:
        super().__init__(f"this is no hand-out of the VPN: {what}", hint="ask the control centre for a new one")


def pack(folder: str, files: Mapping[str, str], modified: int) -> bytes:
    """A tar with one folder; `modified` is in seconds since 1970, for every file."""
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w", format=tarfile.USTAR_FORMAT) as archive:
        for name, text in files.items():
            data = text.encode()
            entry = tarfile.TarInfo(f"{folder}/{name}")
            if _NAME.fullmatch(entry.name) is None:
                raise ValueError(f"not a name for a hand-out: {entry.name!r}")
            entry.size, entry.mtime, entry.mode = len(data), modified, _PRIVATE
            archive.addfile(entry, io.BytesIO(data))
    return packed.getvalue()


def unpack(packed: bytes) -> dict[str, str]:
    """Names and texts, in the archive's order, without the folder. Raises NotAHandOut; nothing is written anywhere."""
    if len(packed) > _BYTES:
        raise NotAHandOut(f"it is larger than {_BYTES} bytes")
    try:
        with tarfile.open(fileobj=io.BytesIO(packed), mode="r:") as archive:
            return _texts(archive)
    except (tarfile.TarError, UnicodeDecodeError, ValueError, OSError):
        raise NotAHandOut("what it contains cannot be read") from None


def _texts(archive: tarfile.TarFile) -> dict[str, str]:
    found: dict[str, str] = {}
    folders: set[str] = set()
    for entry in archive:
        folder, _, name = entry.name.partition("/")
        taken = archive.extractfile(entry) if entry.type == tarfile.REGTYPE and _NAME.fullmatch(entry.name) else None
        if taken is None or name in found or len(found) == _FILES:
            raise NotAHandOut(f"it contains {entry.name!a}")
        folders.add(folder)
        found[name] = taken.read().decode()
    if len(folders) != 1:
        raise NotAHandOut("it is empty" if not folders else "it contains more than one folder")
    return found
