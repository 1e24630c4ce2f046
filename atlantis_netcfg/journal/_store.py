"""The state directory: runs, locks and pins of real sites, and apart from them those of rehearsals."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.journal._errors import NoSuchRun
from atlantis_netcfg.journal._files import component, make_private, sync_directory, translated
from atlantis_netcfg.journal._lock import SiteLock
from atlantis_netcfg.journal._pins import Pins
from atlantis_netcfg.journal._runs import Confirmed, Run
from atlantis_netcfg.journal._usage import Usage
from atlantis_netcfg.journal._writer import Journal, utc_now

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from datetime import datetime
    from pathlib import Path

    from atlantis_netcfg.journal.records import RunResumed, RunStarted

__all__ = ["Store"]


class Store:
    """Everything that outlives a run, for real sites or for rehearsals."""

    def __init__(self, state: Path, *, rehearsed: bool = False, now: Callable[[], datetime] = utc_now) -> None:
        self.root = state / ("rehearsal" if rehearsed else "real")
        self._now = now

    @property
    def pins(self) -> Pins:
        """The pinned certificates."""
        return Pins(self.root / "pins.json")

    def usage(self, site: str) -> Usage:
        """What the site's bearers have carried."""
        return Usage(self._site(site) / "usage.json")

    def lock(self, site: str, command: str) -> SiteLock:
        """The site's lock, to be entered before anything of the site is read for a change."""
        return SiteLock(self._site(site) / "lock", site, command)

    def start(self, started: RunStarted, name: str = "") -> Journal:
        """Open the journal of a new run, under this name if it is free. Raises JournalFailed.

        A run that changes devices of two sites as one has one name at both, so that it is resumed and taken back whole.
        """
        directory = self._new(started.site, name)
        journal = Journal(directory, self._now)
        with translated("the journal", directory):
            sync_directory(directory)
        journal.write(started)
        return journal

    def resume(self, site: str, run: str, resumed: RunResumed) -> Journal:
        """Open the journal of an old run again. Raises NoSuchRun, JournalFailed."""
        journal = Journal(self.run(site, run).directory, self._now)
        journal.write(resumed)
        return journal

    def run(self, site: str, run: str) -> Run:
        """One run by its name. Raises NoSuchRun."""
        known = self._names(site)
        if run not in known:
            listing = ", ".join(known[-5:]) or "none yet"
            raise NoSuchRun(f"{site} has no run {run}", hint=f"its latest runs: {listing}")
        return Run.load(self._runs(site) / run)

    def runs(self, site: str) -> tuple[Run, ...]:
        """All runs of a site, oldest first."""
        return tuple(Run.load(self._runs(site) / name) for name in self._names(site))

    def last_confirmed(self, site: str, devices: Iterable[str]) -> dict[str, Confirmed]:
        """The latest confirmed state of each of these devices that has one; no journal is read in vain."""
        missing = set(devices)
        found: dict[str, Confirmed] = {}
        for name in reversed(self._names(site)):
            if not missing:
                break
            run = Run.load(self._runs(site) / name)
            states = {device: run.confirmed_state(device) for device in missing}
            found |= {device: state for device, state in states.items() if state is not None}
            missing -= found.keys()
        return found

    def unfinished(self, site: str) -> tuple[Run, ...]:
        """Runs that were killed, or left a device unknown, and that no later run has settled; oldest first."""
        later: set[str] = set()
        found: list[Run] = []
        for run in reversed(self.runs(site)):
            if set(run.unsettled) - later:
                found.append(run)
            later |= run.settled
        return tuple(reversed(found))

    def sites(self) -> tuple[str, ...]:
        """Sites that have runs."""
        if not self.root.is_dir():
            return ()
        return tuple(sorted(path.name for path in self.root.iterdir() if (path / "runs").is_dir()))

    def _site(self, site: str) -> Path:
        return self.root / component(site)

    def _runs(self, site: str) -> Path:
        return self._site(site) / "runs"

    def _names(self, site: str) -> list[str]:
        runs = self._runs(site)
        return sorted(path.name for path in runs.iterdir()) if runs.is_dir() else []

    def _new(self, site: str, name: str) -> Path:
        runs = self._runs(site)
        stamp = name or self._now().strftime("%Y%m%dT%H%M%SZ")
        with translated("the journal", runs):
            make_private(runs)
            number = 1
            while True:
                directory = runs / (stamp if number == 1 else f"{stamp}-{number:02}")
                try:
                    directory.mkdir(mode=0o700)
                except FileExistsError:
                    number += 1
                    continue
                sync_directory(runs)
                return directory
