"""Supervision of the roles in Ansible's main process: lock, journal, progress, one result per computer.

Ansible runs each task in a separate process, so nothing that lasts a whole run can be in a task. A callback plugin
passes every event to the `Watch`; a refusal by the watch is raised by the next task that calls `refuse`. The result has
the fields of a device's result, so that every report can include it.
"""

from __future__ import annotations

import hashlib
import time
from dataclasses import dataclass, field
from difflib import unified_diff
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core import errors, messages, remote_messages
from atlantis_netcfg.core.events import Event, Stage
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.operations.apply import RunName, SiteRun
from atlantis_netcfg.operations.common.request import EventStream, Mode, Request, open_inventory
from atlantis_netcfg.operations.computers._access import is_computer, key_trouble
from atlantis_netcfg.routeros.apply import Status
from atlantis_netcfg.runs import NOT_RECORDED, ActionConfirmation, JournalError, Outcome, conclude

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence
    from pathlib import Path


_MENU = "roles"
_NO_PAST = "a computer has no journal of its changes"
_PROTECTION = (
    "files are replaced whole; a firewall that would block access is refused; network changes have a rollback timer"
)


@dataclass(slots=True)
class ComputerResult:
    """The result of a computer, collected from its tasks so far."""

    name: str
    mode: Mode = Mode.APPLY
    site: str = ""
    changes: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    findings: list[str] = field(default_factory=list)
    """Deviations from the inventory that did not stop the run; the result is not green."""
    diffs: list[str] = field(default_factory=list)
    """Text differences in `diff -u` format."""
    failure: str | None = None
    hint: str | None = None
    status: Status = Status.UNCHANGED
    seconds: float = 0.0
    is_recorded: bool = True
    was_reached: bool = True

    def ok(self, task: str, values: Mapping[str, Any]) -> None:
        """Add a task's changes: modules of the toolkit name each change, for others the task's name is used."""
        self.notes += [str(note) for note in values.get("notes") or ()]
        self._add_findings([str(finding) for finding in values.get("findings") or ()], values.get("hint"))
        if not values.get("changed"):
            return
        self.changes += [str(change) for change in values.get("changes") or (task,)]
        self.diffs += _differences(values.get("diff"))
        if self.status is Status.UNCHANGED:
            self.status = self._change_status

    def _add_findings(self, findings: list[str], hint: object) -> None:
        if not findings:
            return
        self.findings += findings
        self.hint = self.hint or (str(hint) if hint else None)
        if self.mode is Mode.DRIFT:
            self.status = Status.DRIFTED

    def fail(self, task: str, values: Mapping[str, Any], status: Status) -> None:
        """Record why a task failed."""
        words = _text(values.get("msg")) or "no reason was given"
        self.failure = msg(f"{arg(task)}: {arg(words)}")
        self.hint = str(values["hint"]) if values.get("hint") else None
        self.changes += [str(change) for change in values.get("changes") or ()]
        self.status = status

    def not_reached(self, values: Mapping[str, Any]) -> None:
        """Record why the connection failed, in short form; the computer is unchanged."""
        words = _text(values.get("msg")) or "no response"
        self.hint = str(values["hint"]) if values.get("hint") else None
        if (trouble := key_trouble(self.name, words)) is not None:
            words, self.hint = trouble
        self.failure = msg(f"not reached: {arg(words.rpartition('reached over ssh: ')[2])}")
        self.was_reached = False
        self.status = Status.LEFT_AS_FOUND

    def recover(self) -> None:
        """Clear a failure that the role itself has handled."""
        if self.failure is None:
            return
        self.failure, self.hint, self.was_reached = None, None, True
        has_drift = self.findings and self.mode is Mode.DRIFT
        self.status = self._change_status if self.changes or has_drift else Status.UNCHANGED

    def add_journal_failure(self, failure: JournalError) -> None:
        """Record that the result is not in the journal, so that it is not green."""
        self.is_recorded = False
        self.hint = self.hint or failure.hint
        self.notes.append(str(failure))

    @property
    def _change_status(self) -> Status:
        return {Mode.PLAN: Status.PLANNED, Mode.DRIFT: Status.DRIFTED}.get(self.mode, Status.CHANGED)

    @property
    def exit(self) -> errors.ExitCode:
        """The exit code of a run with this computer alone."""
        has_findings = self.findings and self.status is not Status.PLANNED
        return self.status.exit if self.is_recorded and not has_findings else self.status.exit.unproven_code

    @property
    def confirmed_actions(self) -> int:
        """The number of changes that tasks have made; 0 for a failed run."""
        return 0 if self.mode.reads_only or self.failure is not None else len(self.changes)

    @property
    def message(self) -> str:
        """The computer's message in the report."""
        text = self._message
        for finding in self.findings:
            text = msg(f"{arg(text)}; finding: {arg(finding)}")
        return text if self.is_recorded else msg(f"{arg(text)}; {arg(NOT_RECORDED)}")

    @property
    def _message(self) -> str:
        if self.failure is not None:
            count = msg(f"{arg(len(self.changes))} change{'' if len(self.changes) == 1 else 's'}")
            return msg(f"{arg(self.failure)} (after {arg(count)})") if self.changes else self.failure
        if self.status is Status.UNCHANGED:
            return "nothing to change" if self.findings else "matches the inventory, nothing to change"
        if self.mode is Mode.DRIFT:
            differ = len(self.changes) + len(self.findings)
            return msg(f"{arg(differ)} differences" if differ > 1 else "1 difference")
        number = len(self.changes)
        if self.mode is Mode.PLAN:
            return msg(f"{arg(number)} change{'' if number == 1 else 's'} to make")
        return msg(f"{arg(number)} change{'' if number == 1 else 's'} made")

    def _comparison(self) -> dict[str, Any]:
        """Return the planned changes in the form of drift, without owner and time, which are unknown."""
        unsaid: dict[str, Any] = {
            "owner": "declared",
            "mark": "",
            "row": "",
            "fields": [],
            "since": "unknown",
            "history": None,
        }
        return {
            "menus": [_MENU],
            "confirmed": None,
            "differences": [
                {**unsaid, "menu": _MENU, "subject": change, "kind": "changed", "why_unknown": _NO_PAST, "counts": True}
                for change in (*self.changes, *self.findings)
            ],
        }

    def as_dict(self) -> dict[str, Any]:
        """Return JSON-able data with every key of a device's result."""
        lines = [*(msg(f"  {arg(change)}") for change in self.changes), *self.diffs]
        return {
            "status": self.status.value,
            "reached": self.was_reached,
            "exit": int(self.exit),
            "message": self.message,
            "hint": self.hint and errors.fill_hint(self.hint, site=self.site, device=self.name),
            "busy": "",
            "planned": len(self.changes),
            "confirmed": self.confirmed_actions,
            "diff": messages.join("\n", lines),
            "drift": [],
            "comparison": self._comparison() if self.mode is Mode.DRIFT and self.failure is None else None,
            "notes": list(dict.fromkeys(self.notes)),
            "estimate": None,
            "plan_hash": hashlib.sha256("\n".join(lines).encode()).hexdigest(),
            "protection": None,
            "protection_words": _PROTECTION,
            "round_trips": 0,
            "bytes": {"sent": 0, "received": 0},
            "seconds": round(self.seconds, 3),
            "version": None,
            "board": None,
            "changes": list(self.changes),
        }


def _text(value: object) -> str:
    """Return a message as it is, and other text without the blanks around it."""
    return value if isinstance(value, messages.Message) else str(value or "").strip()


def _differences(result: object) -> Iterator[str]:
    """Yield the texts of Ansible's `diff`."""
    for item in result if isinstance(result, list) else [result]:
        if not isinstance(item, dict):
            continue
        if "prepared" in item:
            yield str(item["prepared"]).rstrip()
        elif "before" in item or "after" in item:
            before, after = (str(item.get(side) or "").splitlines() for side in ("before", "after"))
            names = (str(item.get("before_header") or "before"), str(item.get("after_header") or "after"))
            yield "\n".join(unified_diff(before, after, *names, lineterm="", n=1))


_refusals: list[errors.NetcfgError] = []
"""Errors that stop this process; its tasks are child processes and see the list as it was when they started."""


def refuse() -> None:
    """Raise, in a task's process, the refusal that the watch has recorded."""
    if _refusals:
        raise _refusals[0]


@dataclass(slots=True)
class Watch:
    """Supervision of all plays over computers, from the first to the end."""

    inventory: Path
    request: Request
    plan_only: bool
    _turns: dict[str, SiteRun] = field(default_factory=dict)
    _sites: dict[str, str] = field(default_factory=dict)
    """Site by host."""
    _results: dict[str, ComputerResult] = field(default_factory=dict)
    _start_times: dict[str, float] = field(default_factory=dict)
    _answered_hosts: set[str] = field(default_factory=set)
    _running: dict[str, str] = field(default_factory=dict)
    """Running task by host."""

    _request_texts: list[str] = field(default_factory=list)
    """Marked texts of the desired state, which the roles hand to modules in plain English."""

    @property
    def _event_stream(self) -> EventStream:
        return EventStream(self.request.events_fd)

    @property
    def _reads_only(self) -> bool:
        return self.plan_only or self.request.mode.reads_only

    def begin(self, hosts: Sequence[str]) -> None:
        """Lock the sites of these hosts and open their journals, unless planning; a task raises any failure."""
        reads = self.plan_only and not self.request.mode.reads_only
        request = self.request.model_copy(update={"mode": Mode.PLAN}) if reads else self.request
        _refusals.clear()
        try:
            inventory = open_inventory(self.inventory)
            computers = [inventory.hosts[name] for name in hosts if is_computer(inventory.hosts[name])]
            run_name = RunName()
            for site in sorted({host.site for host in computers}):
                self._turns[site] = SiteRun(inventory, site, computers, request, run_name)
                self._turns[site].begin()
                self._tell_run(site)
        except errors.NetcfgError as error:
            _refusals.append(error)
            self.close()
            return
        self._sites = {host.name: host.site for host in computers}
        self._results = {name: ComputerResult(name, request.mode, site) for name, site in self._sites.items()}

    def start_task(self, host: str, task: str) -> None:
        """Record the start of a task on a host."""
        if host in self._results:
            self._start_times.setdefault(host, time.monotonic())
            self._running[host] = task
            stage = Stage.OBSERVED if self.plan_only else Stage.APPLYING
            self._event_stream.event(Event(host, stage, task))

    def ok(self, host: str, task: str, values: Mapping[str, Any]) -> None:
        """Record a successful task; one that computes the desired state or includes tasks contacts no host."""
        self._running.pop(host, None)
        if "per_host" in values:
            self._request_texts += remote_messages.checked_texts(values).get("texts", [])
        if host in self._results:
            self._results[host].ok(task, self._unpack(values))
            if "per_host" not in values and "include" not in values:
                self._answered_hosts.add(host)

    def _unpack(self, values: Mapping[str, Any]) -> dict[str, Any]:
        return remote_messages.unpack(values, self._request_texts)

    def fail_task(self, host: str, task: str, values: Mapping[str, Any]) -> None:
        """Record a failed task, and with it the host's failure."""
        self._running.pop(host, None)
        if host in self._results:
            status = Status.LEFT_AS_FOUND if not values.get("rolled_back") else Status.ROLLED_BACK
            self._results[host].fail(task, self._unpack(values), status)

    def unreachable(self, host: str, task: str, values: Mapping[str, Any]) -> None:
        """Record that a host does not respond: unchanged if it never did; otherwise the task's progress is unknown."""
        self._running.pop(host, None)
        if host in self._results:
            result, values = self._results[host], self._unpack(values)
            if host not in self._answered_hosts:
                result.not_reached(values)
            else:
                result.fail(task, values, Status.LEFT_AS_FOUND if result.mode.reads_only else Status.UNKNOWN)
            result.hint = result.hint or "check its power and its cable, then run the same command again"

    def end(self, failed_hosts: Collection[str]) -> None:
        """Report and journal the end of each host, release the sites; a failure not in `failed_hosts` was rescued."""
        for name, result in self._results.items():
            if name not in self._start_times:
                continue  # refused before its first task: that was told already
            if name not in failed_hosts:
                result.recover()
            result.seconds = time.monotonic() - self._start_times[name]
            turn = self._turns[self._sites[name]]
            self._journal(turn, result)
            runs = {} if self._reads_only else {self._sites[name]: {"computers": turn.run}}
            self._event_stream.outcome({name: result.as_dict()}, runs)
        self.close()

    def cut_off(self, reason: str) -> None:
        """End the results after an interrupted playbook: a running task may have been executed or partly executed."""
        for name, result in self._results.items():
            if result.failure is None and name in self._start_times:
                task = self._running.get(name)
                unknown = task is not None and name in self._answered_hosts and not result.mode.reads_only
                status = Status.UNKNOWN if unknown else Status.LEFT_AS_FOUND
                result.fail(task or "stopped before the next task", {"msg": reason}, status)
                result.hint = "run the same command again: it continues from the current state"
        self.end(self._results)

    def _tell_run(self, site: str) -> None:
        """Report the run's name as soon as it exists, since it is needed to resume the run."""
        run = self._turns[site].run
        self._event_stream.outcome({}, {site: {"computers": run}} if run else {})

    def close(self) -> None:
        """Unlock the sites; may be called repeatedly."""
        for turn in self._turns.values():
            turn.close()

    @staticmethod
    def _journal(turn: SiteRun, result: ComputerResult) -> None:
        """Record the end of a computer; after the last one of its site, the end of the run."""
        actions = tuple(range(1, result.confirmed_actions + 1))
        confirmations = (ActionConfirmation(device=result.name, actions=actions),) if actions else ()
        outcome = Outcome(device=result.name, status=result.status.value, exit=int(result.exit), message=result.message)
        for failure in (conclude(turn.journal, *confirmations, outcome), turn.finish(result)):
            if failure is not None:
                result.add_journal_failure(failure)
