"""Beside the roles, in Ansible's main process: lock, journal, progress, and one result a computer.

Ansible runs each task in a process that ends with it, so that nothing which lasts a whole run can live in a task. A
callback plugin hands every event to the `Watch`; what the watch has to refuse is raised by the next task that asks.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.core.events import Event, Stage
from atlantis_netcfg.journal import ActionsConfirmed, Outcome, conclude
from atlantis_netcfg.operations.computers._access import is_computer
from atlantis_netcfg.operations.computers._result import ComputerResult
from atlantis_netcfg.operations.request import EventStream, Mode, Request, declaration_of
from atlantis_netcfg.operations.site_run import RunName, SiteRun
from atlantis_netcfg.routeros.apply import Status

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence
    from pathlib import Path

__all__ = ["Watch", "refuse"]

_refusals: list[NetcfgError] = []
"""Why this process may not go on: its tasks are children of it, and see what it held when they began."""


def refuse() -> None:
    """Raise what the watch of this run has found, in the process of a task."""
    if _refusals:
        raise _refusals[0]


@dataclass(slots=True)
class Watch:
    """The plays over computers, from the first one to the end."""

    inventory: Path
    request: Request
    plan_only: bool
    _turns: dict[str, SiteRun] = field(default_factory=dict)
    _sites: dict[str, str] = field(default_factory=dict)
    """Host to site."""
    _results: dict[str, ComputerResult] = field(default_factory=dict)
    _started: dict[str, float] = field(default_factory=dict)
    _answered: set[str] = field(default_factory=set)
    _running: dict[str, str] = field(default_factory=dict)
    """Host to the task that it is at."""

    @property
    def _channel(self) -> EventStream:
        return EventStream(self.request.events_fd)

    @property
    def _reads_only(self) -> bool:
        return self.plan_only or self.request.mode.reads_only

    def begin(self, hosts: Sequence[str]) -> None:
        """Lock the sites of these hosts and open their journals; a plan needs neither. What fails a task raises."""
        reads = self.plan_only and not self.request.mode.reads_only
        request = self.request.model_copy(update={"mode": Mode.PLAN}) if reads else self.request
        _refusals.clear()
        try:
            declaration = declaration_of(self.inventory)
            computers = [declaration.hosts[name] for name in hosts if is_computer(declaration.hosts[name])]
            called = RunName()
            for site in sorted({host.site for host in computers}):
                self._turns[site] = SiteRun(declaration, site, computers, request, called)
                self._turns[site].begin()
                self._tell_run(site)
        except NetcfgError as error:
            _refusals.append(error)
            self.close()
            return
        self._sites = {host.name: host.site for host in computers}
        self._results = {name: ComputerResult(name, request.mode, site) for name, site in self._sites.items()}

    def started(self, host: str, task: str) -> None:
        """A task begins on a host."""
        if host in self._results:
            self._started.setdefault(host, time.monotonic())
            self._running[host] = task
            stage = Stage.OBSERVED if self.plan_only else Stage.APPLYING
            self._channel.event(Event(host, stage, task))

    def ok(self, host: str, task: str, values: Mapping[str, Any]) -> None:
        """A task ended well; one that works out what is wanted, or takes in other tasks, has contacted nobody."""
        self._running.pop(host, None)
        if host in self._results:
            self._results[host].ok(task, values)
            if "per_host" not in values and "include" not in values:
                self._answered.add(host)

    def failed(self, host: str, task: str, values: Mapping[str, Any]) -> None:
        """A task failed, and with it the host."""
        self._running.pop(host, None)
        if host in self._results:
            status = Status.LEFT_AS_FOUND if not values.get("rolled_back") else Status.ROLLED_BACK
            self._results[host].failed(task, values, status)

    def unreachable(self, host: str, task: str, values: Mapping[str, Any]) -> None:
        """The host does not answer: if it never did it is as it was; how far a task had come nobody knows."""
        self._running.pop(host, None)
        if host in self._results:
            result = self._results[host]
            if host not in self._answered:
                result.not_reached(values)
            else:
                result.failed(task, values, Status.LEFT_AS_FOUND if result.mode.reads_only else Status.UNKNOWN)
            result.hint = result.hint or "look at its power and its cable, then type the same again"

    def end(self, failed: Collection[str]) -> None:
        """Tell and journal how each host ended, and free the sites; a failure of a host not in `failed` was rescued."""
        for name, result in self._results.items():
            if name not in self._started:
                continue  # refused before its first task: that was told already
            if name not in failed:
                result.rescued()
            result.seconds = time.monotonic() - self._started[name]
            turn = self._turns[self._sites[name]]
            self._journal(turn, result)
            runs = {} if self._reads_only else {self._sites[name]: {"computers": turn.run}}
            self._channel.outcome({name: result.as_dict()}, runs)
        self.close()

    def cut_off(self, reason: str) -> None:
        """The playbook has ended without its last event: whoever was at a task may have carried it out, or a part."""
        for name, result in self._results.items():
            if result.failure is None and name in self._started:
                task = self._running.get(name)
                unknown = task is not None and name in self._answered and not result.mode.reads_only
                status = Status.UNKNOWN if unknown else Status.LEFT_AS_FOUND
                result.failed(task or "stopped before its next task", {"msg": reason}, status)
                result.hint = "type the same again: it goes on from whatever is there"
        self.end(self._results)

    def _tell_run(self, site: str) -> None:
        """Name the run as soon as there is one: who asked may have to say how to resume it."""
        run = self._turns[site].run
        self._channel.outcome({}, {site: {"computers": run}} if run else {})

    def close(self) -> None:
        """Free the sites; may be repeated."""
        for turn in self._turns.values():
            turn.close()

    @staticmethod
    def _journal(turn: SiteRun, result: ComputerResult) -> None:
        """Record how a computer ended; after the last one of its site, how the run ended."""
        actions = tuple(range(1, result.confirmed + 1))
        confirmed = (ActionsConfirmed(device=result.name, actions=actions),) if actions else ()
        outcome = Outcome(device=result.name, status=result.status.value, exit=int(result.exit), message=result.message)
        for failure in (conclude(turn.journal, *confirmed, outcome), turn.ended(result)):
            if failure is not None:
                result.unrecorded(failure)
