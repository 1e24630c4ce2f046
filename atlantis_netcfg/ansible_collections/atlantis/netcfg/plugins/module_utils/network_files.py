"""Files and programs of this computer; a power cut during a replacement leaves the old or the new file."""

# ruff: noqa: PTH102, PTH105, PTH108, PTH112, PTH113, PTH114, PTH116, PTH120, PTH123, PTH211
# Paths are those of a computer, below a root: what is joined to it is a string.

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import subprocess
from typing import Any, Callable, Dict, Iterator, NamedTuple, Sequence

Manifest = Dict[str, Any]

FOLDER = "/var/lib/atlantis/network"
_LOCK = f"{FOLDER}/lock"


class ProgramEnd(NamedTuple):
    """Exit code of a program, and its combined standard output and error."""

    code: int
    output: str


def run_program(words: Sequence[str]) -> ProgramEnd:
    """Run a program to its end; the code is 127 if it does not exist, as in a shell."""
    try:
        process = subprocess.run(  # noqa: S603 - programs of the system, by names that stand here
            list(words), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False
        )
    except OSError as error:
        return ProgramEnd(127, f"{words[0]}: {error.strerror}")
    return ProgramEnd(process.returncode, process.stdout.decode(errors="replace").strip())


class NetworkComputer:
    """The files below `root` and the programs of a computer; tests replace both."""

    def __init__(self, root: str = "/", run: Callable[[Sequence[str]], ProgramEnd] = run_program) -> None:
        self.root = root.rstrip("/")
        self.run = run

    def at(self, path: str) -> str:
        """Return the real path for this process of a path on the computer."""
        return self.root + path

    def read(self, path: str) -> str | None:
        """The text of a file; None if there is none."""
        try:
            with open(self.at(path), encoding="utf-8", errors="surrogateescape") as file:
                return file.read()
        except (FileNotFoundError, NotADirectoryError):
            return None

    def load(self, path: str) -> Manifest | None:
        """Return the content of one of our JSON files; None if it does not exist."""
        text = self.read(path)
        return None if text is None else json.loads(text)

    def write(self, path: str, text: str, mode: int = 0o600, owner: tuple[int, int] | None = None) -> None:
        """Replace a file so that a power cut leaves the old one or the new one."""
        beside = self._temporary_path(path)
        with contextlib.suppress(FileNotFoundError):
            os.unlink(beside)
        handle = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with open(handle, "w", encoding="utf-8", errors="surrogateescape") as file:
            file.write(text)
            file.flush()
            if owner is not None and owner != (os.geteuid(), os.getegid()):
                os.fchown(file.fileno(), *owner)
            os.fchmod(file.fileno(), mode)
            os.fsync(file.fileno())
        os.replace(beside, self.at(path))
        self.sync(os.path.dirname(path))

    def link(self, path: str, target: str) -> None:
        """Replace the file at a path by a symbolic link."""
        beside = self._temporary_path(path)
        with contextlib.suppress(FileNotFoundError):
            os.unlink(beside)
        os.symlink(target, beside)
        os.replace(beside, self.at(path))
        self.sync(os.path.dirname(path))

    def remove(self, path: str) -> None:
        """Remove a file; do nothing if it does not exist."""
        with contextlib.suppress(FileNotFoundError, NotADirectoryError):
            os.unlink(self.at(path))
            self.sync(os.path.dirname(path))

    def make(self, folder: str) -> None:
        """Make a folder and its parents."""
        if not os.path.isdir(self.at(folder)):
            self.make(os.path.dirname(folder))
            os.mkdir(self.at(folder), 0o755)
            self.sync(os.path.dirname(folder))

    def sync(self, folder: str) -> None:
        """Sync the names in a folder to disk."""
        handle = os.open(self.at(folder) or "/", os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)

    @contextlib.contextmanager
    def hold_lock(self) -> Iterator[None]:
        """Hold the lock for network changes; the kernel releases it when the process ends, however it ends."""
        self.make(FOLDER)
        handle = os.open(self.at(_LOCK), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
            yield
        finally:
            os.close(handle)

    def _temporary_path(self, path: str) -> str:
        folder, name = os.path.split(path)
        self.make(folder)
        return self.at(f"{folder}/.{name}.atlantis-new")


def state_of(computer: NetworkComputer, path: str) -> Manifest:
    """Return the entry at a path, in the format that `put` restores."""
    real = computer.at(path)
    if os.path.islink(real):
        return {"path": path, "link": os.readlink(real)}
    if not os.path.isfile(real):
        return {"path": path, "absent": True}
    result = os.stat(real)
    text = computer.read(path)
    return {
        "path": path,
        "text": text,
        "mode": result.st_mode & 0o7777,
        "uid": result.st_uid,
        "gid": result.st_gid,
    }


def put(computer: NetworkComputer, manifest: Manifest) -> None:
    """Bring every file of a manifest to its recorded state; files already in that state are not touched."""
    for entry in manifest["files"]:
        if state_of(computer, entry["path"]) == entry:
            continue
        if entry.get("absent"):
            computer.remove(entry["path"])
        elif "link" in entry:
            computer.link(entry["path"], entry["link"])
        else:
            computer.write(entry["path"], entry["text"], entry["mode"], (entry["uid"], entry["gid"]))
