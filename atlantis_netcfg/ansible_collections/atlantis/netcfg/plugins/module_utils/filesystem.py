"""The files of the computer: read, compared, and replaced so that a power cut leaves the old one or the new one.

A stamp maps a path to the SHA-256 of its content when a step or a unit last succeeded, so that a kill between two steps
loses none. Callers compare and write only their own paths: two roles may look after one unit.
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

from .errors import ModuleError, in_words

_PERMISSIONS = 0o7777
_SECOND_NS = 1_000_000_000


@dataclass(frozen=True)
class FoundFile:
    """What stands at a path; `target` is set for a symbolic link, `content` for a file."""

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
        """Where `path` of the computer is for this process."""
        return path if self.root == "/" else self.root + path

    def find(self, path: str) -> FoundFile | None:
        """Read what is there, without following a symbolic link; None if nothing is."""
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
                f"{path} cannot be made: something above it is a file, and has to be a directory",
                f"look at `namei -l {path}`",
            ) from None
        except OSError as error:
            raise in_words(error, path) from error

    def read(self, path: str) -> bytes | None:
        """The content of a file, also behind a symbolic link; None if there is none."""
        try:
            with open(self.at(path), "rb") as file:
                return file.read()
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            raise in_words(error, path) from error

    def uid(self, owner: str) -> int:
        """The number of an account."""
        try:
            return int(owner) if owner.isdigit() else pwd.getpwnam(owner).pw_uid
        except KeyError:
            raise ModuleError(
                f"there is no account `{owner}` on this computer", f"make it: `adduser {owner}`"
            ) from None

    def gid(self, group: str) -> int:
        """The number of a group."""
        try:
            return int(group) if group.isdigit() else grp.getgrnam(group).gr_gid
        except KeyError:
            raise ModuleError(f"there is no group `{group}` on this computer", f"make it: `addgroup {group}`") from None

    def missing_above(self, path: str) -> list[str]:
        """The directories above `path` that are not there yet, the highest first."""
        missing: list[str] = []
        above = os.path.dirname(path)
        while above != "/" and not os.path.isdir(self.at(above)):
            if os.path.lexists(self.at(above)):
                raise ModuleError(f"{above} is in the way: it has to be a directory", f"look at it: `ls -l {above}`")
            missing.insert(0, above)
            above = os.path.dirname(above)
        return missing

    def make_directory(self, path: str, mode: int = 0o755, uid: int = 0, gid: int = 0) -> None:
        """Make one directory whose parent is there."""
        real = self.at(path)
        with self._words(path):
            os.mkdir(real, mode & 0o700)
            self._chown(real, uid, gid)
            os.chmod(real, mode)
            self._sync(os.path.dirname(real))

    def stage(self, path: str, content: bytes, mode: int, uid: int, gid: int) -> str:
        """Write `content` beside `path`, safe on the disk; gives the name of what was written.

        It is a whole second younger than what it replaces: OpenVPN, as others, takes a file of the same second and the
        same size for the one that it has read (facts of the VPN, 4).
        """
        beside = self._beside(path)
        with self._words(path):
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
                self._younger(handle, path)
                os.fsync(handle)
            finally:
                os.close(handle)
        return beside

    def _younger(self, handle: int, path: str) -> None:
        with contextlib.suppress(FileNotFoundError, NotADirectoryError):
            after = (os.lstat(self.at(path)).st_mtime_ns // _SECOND_NS + 1) * _SECOND_NS
            if os.fstat(handle).st_mtime_ns < after:
                os.utime(handle, ns=(after, after))

    def put(self, path: str) -> None:
        """Let what was staged take its place."""
        with self._words(path):
            os.replace(self._beside(path), self.at(path))

    def unstage(self, path: str) -> None:
        """Remove what was staged, also by a run that was killed."""
        with self._words(path), contextlib.suppress(FileNotFoundError, NotADirectoryError):
            os.unlink(self._beside(path))

    def write(self, path: str, content: bytes, mode: int = 0o644) -> None:
        """Stage and put at once, with the directories above; for the toolkit's own notes."""
        for directory in self.missing_above(path):
            self.make_directory(directory, 0o755, os.geteuid(), os.getegid())
        self.stage(path, content, mode, os.geteuid(), os.getegid())
        self.put(path)
        self.sync(path)

    def link(self, path: str, target: str) -> None:
        """Make `path` a symbolic link to `target`, whatever file or link is there."""
        beside = self._beside(path)
        with self._words(path):
            with contextlib.suppress(FileNotFoundError):
                os.unlink(beside)
            os.symlink(target, beside)
            os.replace(beside, self.at(path))

    def mend(self, path: str, mode: int, uid: int, gid: int) -> None:
        """Set mode and owner; the owner first, because chown(2) takes the set-user-ID bits away."""
        with self._words(path):
            self._chown(self.at(path), uid, gid)
            os.chmod(self.at(path), mode)

    def remove(self, path: str) -> None:
        """Remove a file or a symbolic link."""
        with self._words(path), contextlib.suppress(FileNotFoundError):
            os.unlink(self.at(path))

    def remove_directory(self, path: str) -> None:
        """Remove a directory that this run has made, unless somebody put something into it."""
        with contextlib.suppress(OSError):
            os.rmdir(self.at(path))

    def sync(self, path: str) -> None:
        """Bring the directory that holds `path` safely to the disk."""
        with self._words(path):
            self._sync(os.path.dirname(self.at(path)))

    def _beside(self, path: str) -> str:
        """A name that no program which reads whole directories takes, and that the next run finds again."""
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
    def _words(path: str) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise in_words(error, path) from error


FOLDER = "/var/lib/atlantis/applied"
ABSENT = "absent"
"""In place of a digest: there is no such file."""
_IN_PROGRESS = "begun"


class Stamps:
    """The stamps of a computer, one file each."""

    def __init__(self, tree: FileSystem) -> None:
        self.tree = tree

    def holds(self, name: str, digests: Mapping[str, str]) -> bool:
        """Whether the last success was with just this; what is not there, and never was, needs none."""
        saved_digests = self._read_digests(name)
        return all(saved_digests.get(path, ABSENT) == digest for path, digest in digests.items())

    def begin(self, name: str, digests: Mapping[str, str]) -> None:
        """Forget the last success before the act begins: an act that fails or is killed is done again."""
        self._write(name, {**self._read_digests(name), **dict.fromkeys(digests, _IN_PROGRESS)})

    def note(self, name: str, digests: Mapping[str, str]) -> None:
        """Note a success."""
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
