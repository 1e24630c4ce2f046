"""One site in a run: its lock and its journal, from its first device to its last."""

from __future__ import annotations

from contextlib import ExitStack, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from atlantis_netcfg import __version__
from atlantis_netcfg.core.errors import worst
from atlantis_netcfg.journal import (
    Journal,
    NoJournal,
    NoSuchRun,
    Purpose,
    RunEnded,
    RunResumed,
    RunStarted,
    Store,
    conclude,
)
from atlantis_netcfg.operations.request import Mode

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.journal import Confirmed, JournalFailed, Recorder
    from atlantis_netcfg.operations.request import Request


class Ended(Protocol):
    """What a turn has to know of a device's result."""

    @property
    def name(self) -> str:
        """The host's."""

    @property
    def exit(self) -> ExitCode:
        """As of a run that ended so on its only device."""


@dataclass(slots=True)
class RunName:
    """What a request is called in the journals of all its sites: the first one chooses."""

    name: str = ""


class SiteRun:
    """One site while a request is performed; a plan changes nothing and needs neither lock nor journal.

    In a run over many sites each is locked when its first device has its turn and is free again after its last: a site
    on which somebody works fails alone, and a run over hundreds of sites holds few files open. Locks are taken in the
    order of the sites' names and never waited for, so that two such runs cannot block each other.
    """

    def __init__(
        self, declaration: Declaration, site: str, hosts: Sequence[Host], request: Request, called: RunName
    ) -> None:
        self._declaration = declaration
        self._called = called
        self._site = site
        self._request = request
        self._hosts = sorted(host.name for host in hosts if host.site == site)
        self._left = set(self._hosts)
        self._ends: list[ExitCode] = []
        self._open = ExitStack()
        self._opened = False
        self.journal: Recorder = NoJournal()
        self.run = ""
        """The run's name, as `provision runs` lists it; empty before the site's turn, and for a plan."""
        self.confirmed: Mapping[str, Confirmed] = {}

    def begin(self) -> None:
        """Lock the site and open its journal, unless that is done. Raises SiteBusy, JournalFailed."""
        if self._opened:
            return
        request = self._request
        if not request.mode.reads_only:
            store = Store(request.state, rehearsed=request.rehearsed)
            with ExitStack() as opening:
                opening.enter_context(store.lock(self._site, request.command))
                journal = opening.enter_context(self._journal(store))
                self._open = opening.pop_all()
            self.journal, self.run = journal, journal.run
            self._called.name = self._called.name or journal.run
        elif not request.rehearsed:
            # An emulated device is new with every rehearsal: what an earlier one was says nothing about it.
            self.confirmed = Store(request.state).last_confirmed(self._site, self._hosts)
        self._opened = True

    def ended(self, result: Ended) -> JournalFailed | None:
        """Take the result of one of its devices; after the last one, write the last record and free the site.

        Returns why that could not be written: the result of this device says so. A run that is not recorded to its end
        has no name any more.
        """
        self._left.discard(result.name)
        self._ends.append(result.exit)
        failure = None
        if not self._left:
            failure = conclude(self.journal, RunEnded(exit=int(worst(self._ends))))
            self.run = "" if failure is not None else self.run
            self.close()
        return failure

    def close(self) -> None:
        """Free the site; may be repeated."""
        self._open.close()
        self.journal = NoJournal()

    def _journal(self, store: Store) -> Journal:
        request, revision = self._request, self._declaration.revision
        if request.mode is Mode.RESUME and request.run is not None:
            resumed = RunResumed(revision=revision, tool=__version__, command=request.command)
            with suppress(NoSuchRun):  # it had not come to this site, which has the other end of a bridge
                return store.resume(self._site, request.run, resumed)
        return store.start(
            RunStarted(
                site=self._site,
                revision=revision,
                tool=__version__,
                hosts=tuple(self._hosts),
                rehearsed=request.rehearsed,
                command=request.command,
                back_to=request.back_to,
                restore=request.restore,
                purpose=Purpose.BACKUP if request.mode is Mode.BACKUP else Purpose.CONFIGURE,
            ),
            self._called.name,
        )
