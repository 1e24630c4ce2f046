"""Write files that survive a kill or a power cut, private to their owner; the errors of the state folder."""

from __future__ import annotations

import re
from contextlib import contextmanager
from typing import TYPE_CHECKING

from atlantis_netcfg.core import errors
from atlantis_netcfg.core.atomic_files import sync_directory

if TYPE_CHECKING:
    from collections.abc import Iterator
    from datetime import datetime
    from pathlib import Path


class JournalError(errors.NetcfgError):
    """The journal cannot be written: nothing more may be changed, because nobody could go on after a break."""

    exit = errors.ExitCode.FAILED


class DamagedPinsError(errors.NetcfgError):
    """The file of pinned certificates cannot be read: no device may be trusted until a person has looked."""

    exit = errors.ExitCode.FAILED


class DamagedStateError(errors.NetcfgError):
    """A saved state is not what was written: it must not be put on a device."""

    exit = errors.ExitCode.FAILED


class SiteBusy(errors.NetcfgError):
    """Somebody else works on the site now; the message says who. Nothing was contacted."""

    exit = errors.ExitCode.FAILED


class NoSuchRun(errors.NoMatchError):
    """A run that is not in the journal of the site."""


_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


_STAMP = re.compile(r"\d{8}T\d{6}Z")


def component(name: str) -> str:
    """`name`, if it can be the name of a file wherever it comes from; ValueError otherwise."""
    if _NAME.fullmatch(name) is None:
        raise ValueError(f"not usable as a file name: {name!r}")
    return name


def make_private(path: Path) -> Path:
    """Make a directory, and those above it that are missing, with mode 0700; on disk when this returns."""
    missing = [path, *path.parents]
    missing = [directory for directory in missing if not directory.exists()]
    for directory in reversed(missing):
        directory.mkdir(mode=0o700, exist_ok=True)
        sync_directory(directory.parent)
    return path


def new_run(runs: Path, now: datetime, name: str = "", *, archive: Path | None = None) -> Path:
    """Make the folder of a run, named after its time, or after `name`; it is later than those that are there.

    Where the clock was set back since the last run, or within its second, it has that one's time and a number. What
    is in the `archive` keeps its name.
    """
    times = (run_order(path.name)[0] for path in runs.iterdir())
    stamp = name or max(now.strftime("%Y%m%dT%H%M%SZ"), *filter(_STAMP.fullmatch, times), "")
    number = 1
    while True:
        directory = runs / (stamp if number == 1 else f"{stamp}-{number:02}")
        if archive is not None and (archive / directory.name).exists():
            number += 1
            continue
        try:
            directory.mkdir(mode=0o700)
        except FileExistsError:
            number += 1
        else:
            return directory


def run_order(name: str) -> tuple[str, int]:
    """Sort runs by time, and those of one time by number."""
    stamp, _, number = name.partition("-")
    return stamp, int(number) if number.isdecimal() else 1


@contextmanager
def os_errors_as(what: str, path: Path) -> Iterator[None]:
    """Say in words that a file of the state directory could not be written."""
    try:
        yield
    except OSError as error:
        raise unwritable(what, path, error) from error


def unwritable(what: str, path: Path, error: OSError) -> JournalError:
    """The error for a file that could not be written."""
    reason = error.strerror or str(error)
    return JournalError(
        f"{what} cannot be written: {reason} ({path})",
        hint="make room on the disk or correct its permissions, then run the same command again",
    )


def missing_file_error(what: str, path: Path) -> JournalError:
    """The error for a file that is open, but no longer where it was: nobody would find what is written to it."""
    return JournalError(
        f"{what} cannot be written: the folder of the run was deleted or replaced in mid-run ({path})",
        hint="keep the state folder on a disk that stays, then run the same command again",
    )
