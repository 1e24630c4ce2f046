"""Write files that survive a kill or a power cut, private to their owner; the errors of the state folder."""

from __future__ import annotations

import re
from contextlib import contextmanager
from typing import TYPE_CHECKING

from atlantis_netcfg.core import errors
from atlantis_netcfg.core.atomic_files import sync_directory
from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from collections.abc import Iterator
    from datetime import datetime
    from pathlib import Path


class JournalError(errors.NetcfgError):
    """The journal cannot be written: nothing more may be changed, since a later run could not resume."""

    exit = errors.ExitCode.FAILED


class DamagedPinsError(errors.NetcfgError):
    """The file of pinned certificates is damaged: no device may be trusted until the user has checked it."""

    exit = errors.ExitCode.FAILED


class DamagedStateError(errors.NetcfgError):
    """A saved state is damaged: it must not be written to a device."""

    exit = errors.ExitCode.FAILED


class SiteBusy(errors.NetcfgError):
    """Another run is active on the site; the message names it. Nothing was contacted."""

    exit = errors.ExitCode.FAILED


class NoSuchRun(errors.NoMatchError):
    """The site's journals contain no such run."""


_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


_STAMP = re.compile(r"\d{8}T\d{6}Z")


def component(name: str) -> str:
    """Return `name` if it is a safe file name. Raises ValueError otherwise."""
    if _NAME.fullmatch(name) is None:
        raise ValueError(msg(f"not usable as a file name: {arg(name)!r}"))
    return name


def make_private(path: Path) -> Path:
    """Create a directory and its missing parents with mode 0700; on disk on return."""
    missing = [path, *path.parents]
    missing = [directory for directory in missing if not directory.exists()]
    for directory in reversed(missing):
        directory.mkdir(mode=0o700, exist_ok=True)
        sync_directory(directory.parent)
    return path


def new_run(runs: Path, now: datetime, name: str = "", *, archive: Path | None = None) -> Path:
    """Create the folder of a run, named after its time or `name`; it sorts after the existing ones.

    If the clock was set back since the last run, or within the same second, it gets that run's time and a number. Names
    in the `archive` are not reused.
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
    """Sort key of runs: time, then number."""
    stamp, _, number = name.partition("-")
    return stamp, int(number) if number.isdecimal() else 1


@contextmanager
def os_errors_as(what: str, path: Path) -> Iterator[None]:
    """Convert an OSError on a file of the state directory to a JournalError."""
    try:
        yield
    except OSError as error:
        raise unwritable(what, path, error) from error


def unwritable(what: str, path: Path, error: OSError) -> JournalError:
    """Return the error for a file that could not be written."""
    reason = error.strerror or str(error)
    return JournalError(
        f"{arg(what)} cannot be written: {arg(reason)} ({arg(path)})",
        hint="free disk space or correct the permissions, then run the same command again",
    )


def missing_file_error(what: str, path: Path) -> JournalError:
    """Return the error for an open file that was moved or deleted, so that writes to it would be lost."""
    return JournalError(
        f"{arg(what)} cannot be written: the folder of the run was deleted or replaced during the run ({arg(path)})",
        hint="keep the state folder on a disk that stays mounted, then run the same command again",
    )
