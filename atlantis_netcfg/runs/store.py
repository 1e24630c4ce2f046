"""The state folder: runs, site locks and pins, kept apart for real sites and for rehearsals."""

from __future__ import annotations

import fcntl
import getpass
import json
import os
import socket
import time
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import cache
from typing import TYPE_CHECKING, Self

from atlantis_netcfg.core import atomic_files, paths
from atlantis_netcfg.core.eventlog import write_all
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.runs import files
from atlantis_netcfg.runs.log import Journal, utc_now
from atlantis_netcfg.runs.pins import Pins
from atlantis_netcfg.runs.run import Run, SavedState
from atlantis_netcfg.runs.usage import Usage

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    from atlantis_netcfg.runs.records import RunResume, RunStart


RESULT = "result.json"
"""File beside a run's journal with the command's report, the object of `--json`. We do not read it."""
_ATTEMPTS = 10
_PAUSE_S = 0.02


@dataclass(frozen=True, slots=True)
class LockHolder:
    """The process that works on a site."""

    user: str
    host: str
    pid: int
    since: str
    command: str

    @classmethod
    def me(cls, command: str) -> Self:
        """Return the record of this process."""
        try:
            user = getpass.getuser()
        except (KeyError, OSError):
            user = msg(f"user {arg(os.getuid())}")
        return cls(user, socket.gethostname(), os.getpid(), utc_now().isoformat(timespec="seconds"), command)

    def __str__(self) -> str:
        return msg(
            f"{arg(self.user)} on {arg(self.host)} (process {arg(self.pid)}) since {arg(self.since)}: "
            f"{arg(self.command)}"
        )


class SiteLock:
    """Lock from `__enter__` to `__exit__`. Raises SiteBusy, naming the holder, if it is taken."""

    def __init__(self, path: Path, site: str, command: str) -> None:
        self._path = path
        self._site = site
        self._command = command
        self._descriptor = -1

    def __enter__(self) -> Self:
        with files.os_errors_as("the site lock", self._path):
            files.make_private(self._path.parent)
            self._descriptor = atomic_files.open_lock(self._path)
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            busy = self._busy_error()
            self._close()
            raise busy from error
        self._sign()
        return self

    def __exit__(self, *_: object) -> None:
        # The file stays: were it removed, a third process could lock a new file while a second holds the old one.
        try:
            os.ftruncate(self._descriptor, 0)
        finally:
            # Closing is not enough: a child that was forked meanwhile, and that is about to end, has it open as well.
            fcntl.flock(self._descriptor, fcntl.LOCK_UN)
            self._close()

    def _sign(self) -> None:
        """Write our name into the lock file. It is for information only: on a full disk the lock still works."""
        data = json.dumps(asdict(LockHolder.me(self._command))).encode()
        try:
            os.ftruncate(self._descriptor, 0)
            os.lseek(self._descriptor, 0, os.SEEK_SET)
            write_all(self._descriptor, data)
        except OSError:
            return

    def _close(self) -> None:
        os.close(self._descriptor)
        self._descriptor = -1

    def _busy_error(self) -> files.SiteBusy:
        holder = self._holder()
        who = str(holder) if holder is not None else "somebody who has just started"
        return files.SiteBusy(
            f"{arg(self._site)} is locked by {arg(who)}",
            hint="wait until that run has ended, then run the same command again",
        )

    def _holder(self) -> LockHolder | None:
        """Read the holder. Shortly after locking, the file may still name the previous holder, which may be dead."""
        for _ in range(_ATTEMPTS):
            holder = _read(self._path)
            if holder is not None and _may_live(holder):
                return holder
            time.sleep(_PAUSE_S)
        return None


def _read(path: Path) -> LockHolder | None:
    try:
        return LockHolder(**json.loads(path.read_bytes()))
    except (OSError, ValueError, TypeError):
        return None


def _may_live(holder: LockHolder) -> bool:
    if holder.host != socket.gethostname():
        return True
    try:
        os.kill(holder.pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


KEPT_RUNS = 10
"""Number of latest runs of a site that are listed and searched; older ones are archived when no longer needed."""
_ARCHIVE = "archive"


def find_unfinished(runs: Sequence[Run]) -> tuple[Run, ...]:
    """Return a site's runs, oldest first, with an open device that no later run has completed."""
    unfinished_runs: list[Run] = []
    for place, run in enumerate(runs):
        if run.unsettled_devices and set(run.unsettled_devices).difference(
            *(later.settles(run) for later in runs[place + 1 :])
        ):
            unfinished_runs.append(run)
    return tuple(unfinished_runs)


def _is_needed(run: Run, later: Iterator[Run]) -> bool:
    """Return True if the run has an open outcome or a device's latest confirmed state; reads few of `later`."""
    still_open, states = set(run.unsettled_devices), set(run.confirmed_devices)
    while (still_open or states) and (newer := next(later, None)) is not None:
        still_open -= newer.settles(run)
        states -= newer.confirmed_devices
    return bool(still_open or states)


def _list_names(folder: Path) -> list[str]:
    return sorted((path.name for path in folder.iterdir()), key=files.run_order) if folder.is_dir() else []


@dataclass(frozen=True, slots=True)
class DeviceHistory:
    """Leftovers of earlier runs on a device, from this computer's journal; read on demand."""

    _store: Store
    _site: str
    _device: str
    _current: str
    _dead: str | None

    def has_unfinished_run(self) -> bool:
        """Return True if a run of this computer left its outcome open. It is dead, since we hold its lock."""
        runs = self._store.unfinished_runs(self._site)
        return any(self._device in run.unsettled_devices for run in runs if run.id != self._current)

    def can_take_over(self, run: str, sign: str) -> bool:
        """Return True if a run marker belongs to a dead run that may be taken over: ours, or one named by the user."""
        if run == self._dead:
            return True
        with suppress(files.NoSuchRun):
            return self._store.run(self._site, run).has_sign(self._device, sign)
        return False


class Store:
    """Everything kept between runs, for real sites or for rehearsals."""

    def __init__(self, state: Path, *, is_rehearsal: bool = False, now: Callable[[], datetime] = utc_now) -> None:
        self.root = state / ("rehearsal" if is_rehearsal else "real")
        self.is_rehearsal = is_rehearsal
        self._now = now

    @property
    def pins(self) -> Pins:
        """The pinned certificates."""
        return Pins(self.root / "pins.json")

    def usage(self, site: str) -> Usage:
        """Return the byte counts of the site's links."""
        return Usage(self._site(site) / "usage.json")

    def keep_proof(self, site: str, link: str) -> None:
        """Record that the VPN server has just responded over a link. Raises JournalError."""
        place = self._proof(site, link)
        with files.os_errors_as("the proof", place):
            files.make_private(place.parent)
            atomic_files.write_atomically(place, self._now().isoformat().encode())

    def proof(self, site: str, link: str) -> datetime | None:
        """Return when the VPN server last responded over a link; None if unknown."""
        with suppress(OSError, ValueError):
            return datetime.fromisoformat(self._proof(site, link).read_text("ascii")).astimezone(UTC)
        return None

    def lock(self, site: str, command: str) -> AbstractContextManager[object]:
        """Return the site's lock, to be taken before the site is read for a change.

        A rehearsal has its own devices and needs no lock.
        """
        return nullcontext() if self.is_rehearsal else SiteLock(self._site(site) / "lock", site, command)

    def start(self, start_record: RunStart, name: str = "") -> Journal:
        """Open the journal of a new run, under `name` if it is free. Raises JournalError.

        A run that changes devices of two sites as one has the same name at both, so that it is resumed and rolled back
        as a whole.
        """
        directory = self._create_run(start_record.site, name)
        journal = Journal(directory, self._now)
        with files.os_errors_as("the journal", directory):
            atomic_files.sync_directory(directory)
        journal.write(replace(start_record, invocation=self._register_command()))
        self._archive(start_record.site)
        return journal

    def resume(self, site: str, run: str, resume_record: RunResume) -> Journal:
        """Reopen the journal of an old run. Raises NoSuchRun, JournalError."""
        journal = Journal(self.run(site, run).directory, self._now)
        journal.write(replace(resume_record, invocation=self._register_command()))
        return journal

    def command_exit(self, invocation: str) -> int | None:
        """Return the exit code of a command that had runs; None: not recorded, still active or killed."""
        with suppress(OSError, ValueError):
            return int((self.root / paths.COMMANDS / files.component(invocation)).read_text("ascii"))
        return None

    def _register_command(self) -> str:
        """Create the file for the exit code of the current command; return its invocation, empty without one."""
        if invocation := os.environ.get(paths.INVOCATION, ""):
            place = self.root / paths.COMMANDS / files.component(invocation)
            with files.os_errors_as("the journal", place):
                files.make_private(place.parent)
                place.touch(mode=0o600)
        return invocation

    def run(self, site: str, run: str) -> Run:
        """Return one run by name. Raises NoSuchRun."""
        names = self._names(site)
        if run not in names and run not in self.archived_runs(site):
            listing = join(", ", names[-5:]) or "none yet"
            raise files.NoSuchRun(f"{arg(site)} has no run {arg(run)}", hint=f"its latest runs: {arg(listing)}")
        return self._load(site, run)

    def keep_result(self, site: str, run: str, result: bytes) -> bool:
        """Save a command's report beside the journal; return False if there is no such run. Raises OSError."""
        directory = self._runs(site) / files.component(run)
        if not directory.is_dir():
            return False
        atomic_files.write_atomically(directory / RESULT, result)
        return True

    def runs(self, site: str) -> tuple[Run, ...]:
        """Return a site's latest runs and those still needed, oldest first; the others are archived."""
        return tuple(self._load(site, name) for name in self._names(site))

    def archived_runs(self, site: str) -> tuple[str, ...]:
        """Return the names of the archived runs, oldest first; no command needs them."""
        return tuple(_list_names(self._site(site) / _ARCHIVE))

    def last_confirmed(self, site: str, devices: Iterable[str]) -> dict[str, SavedState]:
        """Return the latest confirmed state of each device that has one, reading as few journals as possible."""
        missing = set(devices)
        result: dict[str, SavedState] = {}
        for name in reversed(self._names(site)):
            if not missing:
                break
            run = self._load(site, name)
            states = {device: run.confirmed_state(device) for device in missing}
            result |= {device: state for device, state in states.items() if state is not None}
            missing -= result.keys()
        return result

    def damage_since(self, site: str, since: str = "") -> str:
        """Describe the damage in the journals of the latest runs, from `since` on; empty if there is none."""
        runs = (self._load(site, name) for name in self._names(site) if files.run_order(name) >= files.run_order(since))
        return join("; ", (run.damage for run in runs if run.damage))

    def unfinished_runs(self, site: str) -> tuple[Run, ...]:
        """Return runs that were killed or left a device unknown, and that no later run completed; oldest first."""
        return find_unfinished(self.runs(site))

    def history(self, site: str, device: str, *, current: str = "", dead: str | None = None) -> DeviceHistory:
        """Return the leftovers on a device, for the `current` run, which holds the site's lock.

        `dead`: a run, of any computer, that the user has declared dead.
        """
        return DeviceHistory(self, site, device, current, dead)

    def sites(self) -> tuple[str, ...]:
        """Return the sites that have runs."""
        if not self.root.is_dir():
            return ()
        return tuple(sorted(path.name for path in self.root.iterdir() if (path / "runs").is_dir()))

    def _site(self, site: str) -> Path:
        return self.root / files.component(site)

    def _proof(self, site: str, link: str) -> Path:
        return self._site(site) / "proofs" / files.component(link)

    def _runs(self, site: str) -> Path:
        return self._site(site) / "runs"

    def _names(self, site: str) -> list[str]:
        return _list_names(self._runs(site))

    def _load(self, site: str, name: str) -> Run:
        """Read a run, also if it has just been archived."""
        directory = self._runs(site) / name
        return Run.load(directory if directory.is_dir() else self._site(site) / _ARCHIVE / name)

    def _archive(self, site: str) -> None:
        """Archive runs that are neither among the latest nor needed; we hold the site's lock.

        A run is needed if its outcome is open, or if it has the latest confirmed state of a device. On disk errors they
        stay.
        """
        names = self._names(site)
        load = cache(lambda name: self._load(site, name))
        archive = self._site(site) / _ARCHIVE
        with suppress(OSError):
            for place, name in enumerate(names[:-KEPT_RUNS]):
                if not _is_needed(load(name), map(load, reversed(names[place + 1 :]))):
                    (self._runs(site) / name).rename(files.make_private(archive) / name)

    def _create_run(self, site: str, name: str) -> Path:
        runs = self._runs(site)
        with files.os_errors_as("the journal", runs):
            files.make_private(runs)
            directory = files.new_run(runs, self._now(), name, archive=self._site(site) / _ARCHIVE)
            atomic_files.sync_directory(runs)
            return directory
