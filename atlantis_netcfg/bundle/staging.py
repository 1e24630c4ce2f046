"""The folder in which a bundle is made: beside its place, kept when making it is interrupted, renamed at the end."""

from __future__ import annotations

import fcntl
import os
import re
import shutil
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.bundle._errors import BundleRefused
from atlantis_netcfg.bundle.manifest import MANIFEST, SIGNATURE, File
from atlantis_netcfg.bundle.resolve import sha256_of

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

__all__ = ["Workshop", "same", "workshop"]


@dataclass(slots=True)
class Workshop:
    """A bundle in the making."""

    place: Path
    """Where the bundle shall be; an earlier one may be there."""
    folder: Path
    files: dict[str, File] = field(default_factory=dict)
    """By the path in the bundle."""

    @property
    def work(self) -> Path:
        """What is thrown away at the end."""
        return self.folder / "work"

    def add(self, path: str, source: Path | bytes) -> None:
        """Take a file into the bundle: bytes, or a file that is moved there unless it stands there already."""
        place = self.folder / path
        place.parent.mkdir(parents=True, exist_ok=True)
        if isinstance(source, bytes):
            place.write_bytes(source)
        elif source != place:
            source.replace(place)
        self.files[path] = File(path=path, size=place.stat().st_size, sha256=sha256_of(place))

    def finish(self) -> None:
        """Remove what is not of the bundle, and let it take the place of an earlier one."""
        shutil.rmtree(self.work)
        known = {*self.files, MANIFEST, SIGNATURE}
        for path in sorted(self.folder.rglob("*"), reverse=True):
            inside = path.relative_to(self.folder).as_posix()
            if path.is_dir():
                with suppress(OSError):
                    path.rmdir()
            elif inside not in known:
                path.unlink()
        os.sync()
        place, old = self.place, _aside(self.place)
        shutil.rmtree(old, ignore_errors=True)
        if place.exists():
            place.rename(old)
        self.folder.rename(place)
        shutil.rmtree(old, ignore_errors=True)


def same(source: Path, target: Path) -> None:
    """A second name for a file, or a copy where the file system has no such thing."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)


@contextmanager
def workshop(place: Path) -> Iterator[Workshop]:
    """Open it, alone. Raises BundleRefused where the place cannot be used, or somebody is at work there."""
    if re.search(r"[\s\"';]", str(place)):
        raise BundleRefused(f"no bundle can be made in {place}", hint="`to=` names a folder without blanks in its name")
    if place.is_symlink() or (place.exists() and not (place / MANIFEST).is_file() and not _empty(place)):
        raise BundleRefused(f"{place} is there, and is no bundle", hint="`to=` names a new folder")
    if not place.parent.is_dir():
        raise BundleRefused(f"there is no folder {place.parent}", hint="make it first")
    made = Workshop(place, place.with_name(f".{place.name}.part"))
    with _translated(place), _alone(made.folder):
        if _aside(place).exists() and not place.exists():
            _aside(place).rename(place)  # cut off while the new one was to take its place
        made.work.mkdir(parents=True, exist_ok=True)
        yield made


def _aside(place: Path) -> Path:
    """Where an earlier bundle is while the new one takes its place."""
    return place.with_name(f".{place.name}.old")


def _empty(place: Path) -> bool:
    return place.is_dir() and not any(place.iterdir())


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Hold off a second run in the same place. Raises BundleRefused."""
    folder.mkdir(exist_ok=True)
    current = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(current, fcntl.LOCK_EX | fcntl.LOCK_NB)
        _hold_still(folder, current)
        yield
    except BlockingIOError as error:
        hint = "wait for its end, or name another place with `to=`"
        raise BundleRefused("another run makes this bundle now", hint=hint) from error
    finally:
        os.close(current)


def _hold_still(folder: Path, current: int) -> None:
    """Hold that nobody has finished the bundle between opening the folder and locking it."""
    if not folder.exists() or os.fstat(current).st_ino != folder.stat().st_ino:
        raise BlockingIOError


@contextmanager
def _translated(place: Path) -> Iterator[None]:
    """Say in words that the place cannot be written."""
    try:
        yield
    except OSError as error:
        raise BundleRefused(
            f"{place} cannot be made: {error.filename or place.parent}: {error.strerror or error}",
            hint="make room, or name another place with `to=`; what was fetched is kept",
        ) from error
