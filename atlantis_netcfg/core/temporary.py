"""Temporary folders with an owner: folders of killed processes are removed by the next one.

    with temporary.folder("image", temporary.roomy()) as place:
        …

Its name begins with `atlantis-` and ends with `.tmp`, and its owner holds a lock (flock(2)) on it as long as it lives.
The kernel releases the lock whenever the owner ends, and the lock works across PID namespaces. So a folder with that
name, of this user and without lock, has no owner any more. The same is done for SSH control sockets without listener:
Ansible keeps those of its connections in another folder.
"""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import socket
import stat
import tempfile
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

_SMALL = Path("/tmp")  # noqa: S108 - private folders are made in it
_LARGE = Path("/var/tmp")  # noqa: S108 - as above; /tmp may be this computer's memory
_FOLDER_NAME = re.compile(r"atlantis-[a-z-]+-[a-z0-9_]{8}\.tmp")
_CONTROL_SOCKET = re.compile(r"[0-9a-f]{10}")
"""Socket name used by Ansible; a socket that ssh(1) is about to open has a longer name."""
_MOUNTS = Path("/proc/self/mountinfo")
_OPEN = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC


def large_temp_dir() -> Path:
    """Return a folder with room for images of several gigabytes: `$TMPDIR`, else /var/tmp."""
    return Path(os.environ.get("TMPDIR") or _LARGE)


@contextmanager
def folder(purpose: str, place: Path | None = None) -> Iterator[Path]:
    """Make a private folder that is removed with the context; orphans of other processes are removed first.

    `place`: parent folder; by default the usual one (`$TMPDIR`, /tmp).
    """
    where = place or Path(tempfile.gettempdir())
    remove_orphans(where)
    path, lock = _make_locked_folder(f"atlantis-{purpose}-", where)
    owner = os.getpid()
    try:
        yield path
    finally:
        if os.getpid() == owner:  # and not a fork of it, which unwinds the same stack
            shutil.rmtree(path, ignore_errors=True)
        os.close(lock)


def remove_orphans(*places: Path) -> tuple[Path, ...]:
    """Remove folders and sockets left by dead processes of this user; return their paths.

    Searches the usual places and those of the caller, not the folders below them. Whatever cannot be read or removed is
    skipped: leftovers never make the work fail.
    """
    every = dict.fromkeys((_SMALL, _LARGE, large_temp_dir(), Path(tempfile.gettempdir()), *places))
    folders = [path for place in every for path in _find_by_name(_FOLDER_NAME, place) if _remove_orphan(path)]
    sockets = [path for path in _find_by_name(_CONTROL_SOCKET, _control_socket_folder()) if _remove_dead(path)]
    return (*folders, *sockets)


def orphaned_folders() -> tuple[Path, ...]:
    """Return orphaned folders of this user that could not be removed."""
    every = dict.fromkeys((_SMALL, _LARGE, large_temp_dir(), Path(tempfile.gettempdir())))
    return tuple(path for place in every for path in _find_by_name(_FOLDER_NAME, place) if _is_dead(path))


def _is_dead(path: Path) -> bool:
    """Return whether a folder belongs to this user and is not locked."""
    with suppress(OSError):
        lock = os.open(path, _OPEN)
        try:
            fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
            return os.fstat(lock).st_uid == os.geteuid()
        finally:
            os.close(lock)
    return False


def _make_locked_folder(prefix: str, where: Path) -> tuple[Path, int]:
    """Create and lock a folder; retry if an orphan clean-up removed it before it was locked."""
    while True:
        path = Path(tempfile.mkdtemp(".tmp", prefix, where))
        with suppress(FileNotFoundError):
            lock = os.open(path, _OPEN)
            with suppress(OSError):  # a file system without locks: nobody can take it for an orphan
                fcntl.flock(lock, fcntl.LOCK_EX)
            if _is_same_file(path, lock):
                return path, lock
            os.close(lock)


def _is_same_file(path: Path, descriptor: int) -> bool:
    """Return whether the open file is still the one at the path."""
    try:
        return os.path.samestat(path.lstat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _find_by_name(pattern: re.Pattern[str], place: Path) -> list[Path]:
    with suppress(OSError), os.scandir(place) as entries:
        return [Path(entry.path) for entry in entries if pattern.fullmatch(entry.name)]
    return []


def _control_socket_folder() -> Path:
    usual = Path(os.environ.get("HOME", "/"), ".ansible", "cp")
    return Path(os.environ.get("ANSIBLE_SSH_CONTROL_PATH_DIR") or usual)


def _remove_dead(path: Path) -> bool:
    """Remove a socket of this user without listener; return whether it is gone."""
    with suppress(OSError):
        status = path.lstat()
        if stat.S_ISSOCK(status.st_mode) and status.st_uid == os.geteuid():
            with socket.socket(socket.AF_UNIX) as caller:
                caller.setblocking(False)
                try:
                    caller.connect(str(path))
                except ConnectionRefusedError:
                    path.unlink()
                    return True
    return False


def _remove_orphan(path: Path) -> bool:
    """Remove an unlocked folder of this user; return whether it is gone."""
    with suppress(OSError):
        lock = os.open(path, _OPEN)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.fstat(lock).st_uid == os.geteuid() and _is_same_file(path, lock) and not _mounted_below(path):
                shutil.rmtree(path, ignore_errors=True)
                return not path.exists()
        finally:
            os.close(lock)
    return False


def _mounted_below(path: Path) -> bool:
    """Return whether something is mounted below a path; it would be deleted with it."""
    place = str(path.resolve()).replace(" ", r"\040")
    points = (line.split()[4] for line in _MOUNTS.read_text(encoding="utf-8").splitlines())
    return any(point == place or point.startswith(f"{place}/") for point in points)
