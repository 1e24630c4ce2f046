"""Execution of a request for the RouterOS hosts of a play: one journal and lock per site, one job per device.

Also the run of one site: its lock and its journal, from its first device to its last.
"""

from __future__ import annotations

from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

from atlantis_netcfg import __version__, runs
from atlantis_netcfg.core.crash_report import report_crash
from atlantis_netcfg.core.errors import ExitCode, worst
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.processes.worker import run_until_settled
from atlantis_netcfg.operations.common import schedule
from atlantis_netcfg.operations.common.costs import Costs, require_consent
from atlantis_netcfg.operations.common.jobs import device_job
from atlantis_netcfg.operations.common.kinds import is_supported
from atlantis_netcfg.operations.common.request import (
    EventStream,
    Mode,
    Request,
    open_inventory,
    open_request,
    refuse_examples,
)
from atlantis_netcfg.routeros import Status, fleet
from atlantis_netcfg.runs.report.drift import drift_lines

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.routeros.apply import DeviceJob, DeviceResult
    from atlantis_netcfg.routeros.pair import Pair


class HostResult(Protocol):
    """The part of a device's result that the scheduler needs."""

    @property
    def name(self) -> str:
        """The host's name."""

    @property
    def exit(self) -> ExitCode:
        """The exit code of a run with this device alone."""


@dataclass(slots=True)
class RunName:
    """The run's name in the journals of all its sites, chosen by the first one."""

    name: str = ""


class SiteRun:
    """One site during a request; a plan changes nothing and needs neither lock nor journal.

    In a run over many sites each is locked when its first device starts and released after its last: a site in use by
    another run fails alone, and a run over hundreds of sites keeps few files open. Locks are taken in the order of the
    sites' names and never waited for, so that two such runs cannot deadlock.
    """

    def __init__(
        self, inventory: Inventory, site: str, hosts: Sequence[Host], request: Request, run_name: RunName
    ) -> None:
        self._inventory = inventory
        self._run_name = run_name
        self._site = site
        self._request = request
        self._hosts = sorted(host.name for host in hosts if host.site == site)
        self._left = set(self._hosts)
        self._ends: list[ExitCode] = []
        self._open = ExitStack()
        self._opened = False
        self.journal: runs.Recorder = runs.NoJournal()
        self.run = ""
        """Run name as listed by `provision report runs`; empty before the site's turn, and for a plan."""
        self.confirmed: Mapping[str, runs.SavedState] = {}

    def begin(self) -> None:
        """Lock the site and open its journal, unless done already; raise SiteBusy or JournalError."""
        if self._opened:
            return
        request = self._request
        if not request.mode.reads_only:
            store = runs.Store(request.state, is_rehearsal=request.rehearsed)
            with ExitStack() as opening:
                opening.enter_context(store.lock(self._site, request.command))
                journal = opening.enter_context(self._journal(store))
                self._open = opening.pop_all()
            self.journal, self.run = journal, journal.run
            self._run_name.name = self._run_name.name or journal.run
        elif not request.rehearsed:
            # An emulated device is new with every rehearsal: what an earlier one was says nothing about it.
            self.confirmed = runs.Store(request.state).last_confirmed(self._site, self._hosts)
        self._opened = True

    def finish(self, result: HostResult) -> runs.JournalError | None:
        """Record the result of one of the site's devices; after the last one, end the journal and unlock the site.

        Returns the error if the last record could not be written: the result of this device reports it. A run without a
        final record has no name any more.
        """
        self._left.discard(result.name)
        self._ends.append(result.exit)
        failure = None
        if not self._left:
            failure = runs.conclude(self.journal, runs.RunEnd(exit=int(worst(self._ends))))
            self.run = "" if failure is not None else self.run
            self.close()
        return failure

    def close(self) -> None:
        """Unlock the site; may be called repeatedly."""
        self._open.close()
        self.journal = runs.NoJournal()

    def _journal(self, store: runs.Store) -> runs.Journal:
        request, revision = self._request, self._inventory.revision
        if request.mode is Mode.RESUME and request.run is not None:
            record = runs.RunResume(revision=revision, tool=__version__, command=request.command)
            with suppress(runs.NoSuchRun):  # it had not come to this site, which has the other end of a bridge
                return store.resume(self._site, request.run, record)
        return store.start(
            runs.RunStart(
                site=self._site,
                revision=revision,
                tool=__version__,
                hosts=tuple(self._hosts),
                rehearsed=request.rehearsed,
                command=request.command,
                back_to=request.back_to,
                restore=request.restore,
                purpose=runs.Purpose.BACKUP if request.mode is Mode.BACKUP else runs.Purpose.CONFIGURE,
                prepares=request.prepares,
            ),
            self._run_name.name,
        )


_FINE = (ExitCode.DONE, ExitCode.CHANGES)
_REHEARSED_GRACE_S = 0.5
"""An emulated radio changes at once: its response arrives within this time, or after the link is back."""


def perform(
    inventory: Path,
    hosts: Sequence[str],
    request: Mapping[str, Any] | None,
    *,
    plan_only: bool,
    decrypt: Callable[[str], str],
) -> dict[str, Any]:
    """Run the request and return `per_host`: each device's result for Ansible. Raise NetcfgError.

    Hosts that the engine does not handle are skipped and have no entry.
    """
    with open_request(request, plan_only=plan_only) as (run_request, channel):
        results = _perform(open_inventory(inventory, decrypt), hosts, run_request, channel)
    return _for_ansible(results, hosts)


def _log_fault(result: DeviceResult, request: Request) -> DeviceResult:
    """Write an internal error on one device to a log file, and the file's path into the result."""
    if result.fault is None:
        return result
    return replace(result, hint=report_crash(result.fault, request.command, lambda: request.state).hint)


def _perform(
    inventory: Inventory, names: Sequence[str], request: Request, channel: EventStream
) -> dict[str, Mapping[str, Any]]:
    """Return each device's result as data; the engine's objects, with rows and plans, are released one by one."""
    refuse_examples(inventory, is_rehearsal=request.rehearsed)
    members = schedule.members_of(inventory, [name for name in names if is_supported(inventory.hosts[name])], request)
    hosts = [host for member in members for host in member.hosts]
    require_consent(inventory, hosts, request)
    store, costs = runs.Store(request.state, is_rehearsal=request.rehearsed), Costs(inventory, request)
    run_name = RunName()
    site_runs = {
        site: SiteRun(inventory, site, hosts, request, run_name) for site in sorted({item.site for item in hosts})
    }
    results: dict[str, Mapping[str, Any]] = {}
    bridge_ends = [member.bridge.ends for member in members if member.bridge is not None]
    others = {end.name: other_end.name for ends in bridge_ends for end, other_end in (ends, ends[::-1])}

    def finish(result: DeviceResult) -> None:
        site = inventory.hosts[result.name].site
        cost_report = costs.report(result, site_runs[site].journal, store)
        final_result = runs.mark_unrecorded(_log_fault(result, request), site_runs[site].finish(result))
        notes = list(dict.fromkeys((*cost_report["notes"], *final_result.notes)))
        results[final_result.name] = {
            **final_result.as_dict(),
            **cost_report,
            "notes": notes,
            "other_end": others.get(final_result.name),
        }
        channel.outcome(
            {final_result.name: results[final_result.name]},
            {} if request.mode.reads_only else {site: {"routers": site_runs[site].run}},
        )

    with ExitStack() as stack:
        for site_run in site_runs.values():
            stack.callback(site_run.close)
        waiting = _waiting(costs, members, site_runs, channel)
        run_until_settled(fleet.stream(waiting, finish, mode=request.mode.value))
    return results


def _waiting(
    costs: Costs, members: Sequence[schedule.RunUnit], site_runs: Mapping[str, SiteRun], channel: EventStream
) -> list[fleet.PendingJob]:
    """Return one pending job per device, site by site; raise what prevents a request's only site from starting.

    A bridge to another site waits for its turn in any case: only its two ends fail if that site is in use.
    """

    def start_site(site: str) -> SiteRun:
        site_runs[site].begin()
        channel.outcome({}, {site: {"routers": site_runs[site].run}} if site_runs[site].run else {})
        return site_runs[site]

    def job_of(host: Host) -> DeviceJob:
        site_run = start_site(host.site)
        job = device_job(costs.inventory, host, costs.request, site_run.journal, channel.event)
        return costs.with_meter(replace(job, confirmed_state=site_run.confirmed.get(host.name)))

    def build_job(member: schedule.RunUnit) -> DeviceJob | Pair:
        if member.bridge is None:
            return job_of(member.hosts[0])
        for site in sorted({host.site for host in member.hosts}):
            start_site(site)
        near, far = (job_of(host) for host in member.bridge.ends)
        pair = schedule.pair_of(
            member.bridge, near, replace(far, link=schedule.far_link(costs.inventory, member.bridge, near))
        )
        return replace(pair, grace_s=_REHEARSED_GRACE_S) if costs.request.rehearsed else pair

    alone = len({host.site for member in members if member.bridge is None for host in member.hosts}) == 1
    ordered_members = sorted(members, key=lambda member: member.hosts[0].site)
    return [
        fleet.PendingJob(
            member.hosts[0].name,
            partial(_unchanged_job, build_job(member))
            if alone and member.bridge is None
            else partial(build_job, member),
            member.bridge.far.name if member.bridge is not None else None,
            member.after,
        )
        for member in (members if alone else ordered_members)
    ]


def _unchanged_job(job: DeviceJob | Pair) -> DeviceJob | Pair:
    return job


def _for_ansible(results: Mapping[str, Mapping[str, Any]], names: Sequence[str]) -> dict[str, Any]:
    """Convert each device's result to Ansible's form; the action `recap` assigns it to the device's host.

    The other end of a bridge may be outside the play: then the end in the play reports both, and fails with it.
    """
    for_hosts = {name: _host_result(name, result) for name, result in results.items()}
    for name, result in results.items():
        other_end = str(result["other_end"])
        if other_end in names and name not in names:
            here, there = for_hosts[other_end], for_hosts[name]
            for_hosts[other_end] = {
                **here,
                "ok": here["ok"] and there["ok"],
                "changed": (here["changed"] or there["changed"]) and here["ok"] and there["ok"],
                "message": msg(f"{arg(here['message'])}; {arg(name)}: {arg(there['message'])}"),
                "shown": here["shown"] + there["shown"],
            }
    return {"per_host": for_hosts}


def _host_result(name: str, result: Mapping[str, Any]) -> dict[str, Any]:
    fine = result["exit"] in _FINE
    return {
        **result,
        "ok": fine,
        "changed": result["status"] in (Status.CHANGED, Status.PLANNED) and fine,
        "message": _message_text(result),
        "shown": _diff_text(name, result),
    }


def _diff_text(name: str, result: Mapping[str, Any]) -> str:
    """Return a device's `--diff` text: the lines that would change, then the same as drift."""
    lines = () if result["comparison"] is None else drift_lines(result["comparison"])
    drift = join("", (msg(f"{arg(line)}\n") for line in lines))
    return msg(f"{arg(name)}:\n{arg(result['diff'])}{arg(drift)}" if result["diff"] or drift else "")


def _message_text(result: Mapping[str, Any]) -> str:
    return msg(f"{arg(result['message'])} ({arg(result['hint'])})") if result["hint"] else str(result["message"])
