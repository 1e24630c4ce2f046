"""Atomic file writes on the technician's computer: an exclusive temporary file is renamed into place.

Other users of the folder cannot redirect a draft: its name is random, and links are never followed. A link at the
file's own name is replaced, not followed; the folders above may be links. The writer holds a lock (flock(2)) on its
draft. An unlocked draft belongs to a killed process, and the next writer removes it.
"""

from __future__ import annotations

import fcntl
import os
import re
import secrets
from contextlib import suppress
from typing import TYPE_CHECKING

from atlantis_netcfg.core.eventlog import write_all

if TYPE_CHECKING:
    from pathlib import Path

DRAFT = re.compile(r"\..+\.[0-9]+")
"""Name of a temporary draft file; earlier versions ended with their process number."""
_DIGITS = 16


def draft_of(path: Path) -> Path:
    """Return an unpredictable name for a draft of a file or folder."""
    return path.with_name(f".{path.name}.{secrets.randbelow(10**_DIGITS):0{_DIGITS}}")


def write_atomically(  # noqa: PLR0913 - what a file has besides its content
    path: Path,
    data: bytes,
    *,
    mode: int | None = 0o600,
    modified_at: int | None = None,
    durable: bool = True,
    replace: bool = True,
) -> None:
    """Write a file so that a reader sees the old bytes or the new ones, never a part; on disk when this returns.

    `mode`: None for a file of a person, as the umask has it. `modified_at`: its time, in seconds. Without `durable` a
    power cut may take it back. Without `replace`: raises FileExistsError if anything has the name.
    """
    remove_orphans(path)
    draft, descriptor = _new_draft(path, 0o666 if mode is None else mode)
    try:
        if mode is not None:
            os.fchmod(descriptor, mode)
        write_all(descriptor, data)
        if modified_at is not None:
            os.utime(descriptor, (modified_at, modified_at))
        if durable:
            os.fsync(descriptor)
        if replace:
            draft.replace(path)
        else:
            path.hardlink_to(draft)
            draft.unlink()
    except BaseException:
        draft.unlink(missing_ok=True)
        raise
    finally:
        os.close(descriptor)
    if durable:
        sync_directory(path.parent)


def sync_directory(path: Path) -> None:
    """Sync a directory to disk, so that the names of new files survive a power cut."""
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def open_lock(path: Path) -> int:
    """Open a lock file, creating it if needed; a link is refused (OSError)."""
    return os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)


def _new_draft(path: Path, mode: int) -> tuple[Path, int]:
    """Create and lock a draft; retry if an orphan clean-up removed it before it was locked."""
    while True:
        draft = draft_of(path)
        descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, mode)
        with suppress(OSError):  # a file system without locks: nobody can take it for an orphan
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        if os.fstat(descriptor).st_nlink:
            return draft, descriptor
        os.close(descriptor)


def remove_orphans(path: Path) -> None:
    """Remove drafts of a file left by killed processes of this user: they may hold keys."""
    orphan = re.compile(rf"\.{re.escape(path.name)}\.[0-9]{{{_DIGITS}}}")
    with suppress(OSError), os.scandir(path.parent) as entries:
        for draft in [path.with_name(entry.name) for entry in entries if orphan.fullmatch(entry.name)]:
            with suppress(OSError):
                descriptor = os.open(draft, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
                try:
                    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    if os.fstat(descriptor).st_uid == os.geteuid():
                        draft.unlink()
                finally:
                    os.close(descriptor)
