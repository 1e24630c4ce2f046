"""File system of the computer: a power cut during a replacement leaves either the old or the new file.

A stamp maps a path to the SHA-256 of its content when a step or a unit last succeeded, so that an interruption between
two steps loses none. Callers compare and write only their own paths: two roles may manage one unit.
"""

# ruff: noqa: PTH101, PTH102, PTH105, PTH106, PTH108, PTH112, PTH118, PTH120, PTH123, PTH211
# One system call a line, in an order that a power cut cannot break.

from __future__ import annotations

import contextlib
import grp
import json
import os
import pwd
import stat
from dataclasses import dataclass
from typing import Iterator, Mapping
from urllib.parse import quote

from atlantis_netcfg.core.messages import arg

from .errors import ModuleError, as_module_error

_PERMISSIONS = 0o7777
_SECOND_NS = 1_000_000_000


@dataclass(frozen=True)
class FoundFile:
    """Current entry at a path; `target` is set for a symbolic link, `content` for a file."""

    kind: str
    """file, link, directory or other."""
    mode: int
    uid: int
    gid: int
    content: bytes = b""
    target: str = ""


class FileSystem:
    """The file system below `root`: `/` on a gateway, a folder in a test."""

    def __init__(self, root: str = "/") -> None:
        self.root = root

    def at(self, path: str) -> str:
        """Return the real path for this process of `path` on the computer."""
        return path if self.root == "/" else self.root + path

    def find(self, path: str) -> FoundFile | None:
        """Read the entry at a path, without following a symbolic link; None if there is none."""
        real = self.at(path)
        try:
            result = os.lstat(real)
            mode = stat.S_IMODE(result.st_mode)
            if stat.S_ISLNK(result.st_mode):
                return FoundFile("link", mode, result.st_uid, result.st_gid, target=os.readlink(real))
            if stat.S_ISDIR(result.st_mode):
                return FoundFile("directory", mode, result.st_uid, result.st_gid)
            if not stat.S_ISREG(result.st_mode):
                return FoundFile("other", mode, result.st_uid, result.st_gid)
            with open(real, "rb") as file:
                return FoundFile("file", mode, result.st_uid, result.st_gid, content=file.read())
        except FileNotFoundError:
            return None
        except NotADirectoryError:
            raise ModuleError(
                f"{arg(path)} cannot be created: one of its parents is a file, but must be a directory",
                f"check `namei -l {arg(path)}`",
            ) from None
        except OSError as error:
            raise as_module_error(error, path) from error

    def read(self, path: str) -> bytes | None:
        """Return the content of a file, following symbolic links; None if it does not exist."""
        try:
            with open(self.at(path), "rb") as file:
                return file.read()
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            raise as_module_error(error, path) from error

    def uid(self, owner: str) -> int:
        """Return the user ID of an account. Raises ModuleError if there is no such account."""
        try:
            return int(owner) if owner.isdigit() else pwd.getpwnam(owner).pw_uid
        except KeyError:
            raise ModuleError(
                f"account `{arg(owner)}` does not exist on this computer", f"create it: `adduser {arg(owner)}`"
            ) from None

    def gid(self, group: str) -> int:
        """Return the group ID of a group. Raises ModuleError if there is no such group."""
        try:
            return int(group) if group.isdigit() else grp.getgrnam(group).gr_gid
        except KeyError:
            raise ModuleError(
                f"group `{arg(group)}` does not exist on this computer", f"create it: `addgroup {arg(group)}`"
            ) from None

    def missing_above(self, path: str) -> list[str]:
        """Return the missing parent directories of `path`, highest first. Raises ModuleError if a file blocks one."""
        missing: list[str] = []
        above = os.path.dirname(path)
        while above != "/" and not os.path.isdir(self.at(above)):
            if os.path.lexists(self.at(above)):
                raise ModuleError(
                    f"{arg(above)} is in the way: it must be a directory", f"check it: `ls -l {arg(above)}`"
                )
            missing.insert(0, above)
            above = os.path.dirname(above)
        return missing

    def make_directory(self, path: str, mode: int = 0o755, uid: int = 0, gid: int = 0) -> None:
        """Make one directory whose parent is there."""
        real = self.at(path)
        with self._translate_errors(path):
            os.mkdir(real, mode & 0o700)
            self._chown(real, uid, gid)
            os.chmod(real, mode)
            self._sync(os.path.dirname(real))

    def stage(self, path: str, content: bytes, mode: int, uid: int, gid: int) -> str:
        """Write `content` beside `path`, synced to disk; return the name of the staged file.

        Its time stamp is at least one second later than that of the file it replaces: OpenVPN, as others, regards a
        file with the same second and size as unchanged (facts of the VPN, 4).
        """
        beside = self._staging_path(path)
        with self._translate_errors(path):
            with contextlib.suppress(FileNotFoundError):
                os.unlink(beside)
            handle = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
            try:
                remaining = memoryview(content)
                while remaining:
                    remaining = remaining[os.write(handle, remaining) :]
                if (uid, gid) != (os.geteuid(), os.getegid()):
                    os.fchown(handle, uid, gid)
                os.fchmod(handle, mode)
                self._set_newer_mtime(handle, path)
                os.fsync(handle)
            finally:
                os.close(handle)
        return beside

    def _set_newer_mtime(self, handle: int, path: str) -> None:
        with contextlib.suppress(FileNotFoundError, NotADirectoryError):
            after = (os.lstat(self.at(path)).st_mtime_ns // _SECOND_NS + 1) * _SECOND_NS
            if os.fstat(handle).st_mtime_ns < after:
                os.utime(handle, ns=(after, after))

    def put(self, path: str) -> None:
        """Move the staged file into place."""
        with self._translate_errors(path):
            os.replace(self._staging_path(path), self.at(path))

    def unstage(self, path: str) -> None:
        """Remove the staged file, also one left by an interrupted run."""
        with self._translate_errors(path), contextlib.suppress(FileNotFoundError, NotADirectoryError):
            os.unlink(self._staging_path(path))

    def write(self, path: str, content: bytes, mode: int = 0o644) -> None:
        """Stage and put a file at once, with its parent directories; for the toolkit's own records."""
        for directory in self.missing_above(path):
            self.make_directory(directory, 0o755, os.geteuid(), os.getegid())
        self.stage(path, content, mode, os.geteuid(), os.getegid())
        self.put(path)
        self.sync(path)

    def link(self, path: str, target: str) -> None:
        """Make `path` a symbolic link to `target`, replacing an existing file or link."""
        beside = self._staging_path(path)
        with self._translate_errors(path):
            with contextlib.suppress(FileNotFoundError):
                os.unlink(beside)
            os.symlink(target, beside)
            os.replace(beside, self.at(path))

    def set_attributes(self, path: str, mode: int, uid: int, gid: int) -> None:
        """Set owner and mode, in this order, because chown(2) clears the set-user-ID bits."""
        with self._translate_errors(path):
            self._chown(self.at(path), uid, gid)
            os.chmod(self.at(path), mode)

    def remove(self, path: str) -> None:
        """Remove a file or a symbolic link."""
        with self._translate_errors(path), contextlib.suppress(FileNotFoundError):
            os.unlink(self.at(path))

    def remove_directory(self, path: str) -> None:
        """Remove a directory that this run has made, unless it is not empty."""
        with contextlib.suppress(OSError):
            os.rmdir(self.at(path))

    def sync(self, path: str) -> None:
        """Sync the directory that holds `path` to disk."""
        with self._translate_errors(path):
            self._sync(os.path.dirname(self.at(path)))

    def _staging_path(self, path: str) -> str:
        """Return the staging name: ignored by programs that read whole directories, and found again by the next run."""
        folder, name = os.path.split(self.at(path))
        return os.path.join(folder, f".{name}.atlantis-new")

    @staticmethod
    def _chown(real: str, uid: int, gid: int) -> None:
        result = os.lstat(real)
        if (result.st_uid, result.st_gid) != (uid, gid):
            os.chown(real, uid, gid, follow_symlinks=False)

    @staticmethod
    def _sync(folder: str) -> None:
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)

    @staticmethod
    @contextlib.contextmanager
    def _translate_errors(path: str) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise as_module_error(error, path) from error


FOLDER = "/var/lib/atlantis/applied"
ABSENT = "absent"
"""Used instead of a digest if the file does not exist."""
_IN_PROGRESS = "begun"


class Stamps:
    """The stamps of a computer, one file each."""

    def __init__(self, tree: FileSystem) -> None:
        self.tree = tree

    def holds(self, name: str, digests: Mapping[str, str]) -> bool:
        """Return whether the last success had exactly these digests; a file that never existed needs no stamp."""
        saved_digests = self._read_digests(name)
        return all(saved_digests.get(path, ABSENT) == digest for path, digest in digests.items())

    def begin(self, name: str, digests: Mapping[str, str]) -> None:
        """Clear the last success before an action starts, so that a failed or interrupted action is repeated."""
        self._write(name, {**self._read_digests(name), **dict.fromkeys(digests, _IN_PROGRESS)})

    def note(self, name: str, digests: Mapping[str, str]) -> None:
        """Record a success."""
        self._write(name, {**self._read_digests(name), **digests})

    def _read_digests(self, name: str) -> dict[str, str]:
        try:
            digests = json.loads(self.tree.read(self._path(name)) or b"{}")
        except ValueError:
            return {}
        return digests if isinstance(digests, dict) else {}

    def _write(self, name: str, digests: Mapping[str, str]) -> None:
        self.tree.write(self._path(name), json.dumps(digests, sort_keys=True).encode())

    @staticmethod
    def _path(name: str) -> str:
        return f"{FOLDER}/{quote(name, safe=' @:')}"
