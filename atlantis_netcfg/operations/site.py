"""Performs a request for the hosts of a play: one journal and one lock a site, one job a device."""

from __future__ import annotations

import asyncio
from contextlib import ExitStack, suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from atlantis_netcfg import __version__, paths
from atlantis_netcfg.crash import crashed
from atlantis_netcfg.errors import ExitCode, NetcfgError, UsageError
from atlantis_netcfg.journal import Journal, JournalFailed, NoJournal, RunEnded, RunResumed, RunStarted, Store
from atlantis_netcfg.operations.channel import Channel
from atlantis_netcfg.operations.jobs import device_job
from atlantis_netcfg.operations.request import Mode, Request
from atlantis_netcfg.report.drift import drift_lines
from atlantis_netcfg.routeros import fleet
from atlantis_netcfg.site import load

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.journal import Confirmed, Recorder
    from atlantis_netcfg.routeros.apply import DeviceResult
    from atlantis_netcfg.site import Declaration, Host

__all__ = ["perform"]


def perform(
    inventory: Path,
    hosts: Sequence[str],
    request: Mapping[str, Any] | None,
    *,
    plan_only: bool,
    decrypt: Callable[[str], str],
) -> dict[str, Any]:
    """Do what is asked and give `changed`, `per_host` and `diff` as Ansible shows them. Raises NetcfgError."""
    asked = Request.model_validate(request) if request else Request(state=paths.state_dir())
    if plan_only:
        asked = asked.model_copy(update={"mode": Mode.PLAN})
    channel = Channel(asked.events_fd)
    try:
        results, runs = _perform(load(inventory, decrypt=decrypt), hosts, asked, channel)
    except NetcfgError as error:
        channel.error(error)
        raise
    except Exception as fault:
        problem = crashed(fault, asked.command, lambda: asked.state)
        channel.error(problem)
        raise problem from fault
    results = [_logged(result, asked) for result in results]
    channel.outcome({result.name: result.as_dict() for result in results}, runs)
    return _for_ansible(results)


def _logged(result: DeviceResult, request: Request) -> DeviceResult:
    """A fault of ours on one device goes to a log file, and its place into the result."""
    if result.fault is None:
        return result
    return replace(result, hint=crashed(result.fault, request.command, lambda: request.state).hint)


def _perform(
    declaration: Declaration, names: Sequence[str], request: Request, channel: Channel
) -> tuple[list[DeviceResult], dict[str, str]]:
    if declaration.pilot.example_values and not request.rehearsed:
        raise UsageError(
            "the inventory still holds example values, which lead to nobody's devices: only a rehearsal may use them",
            hint="replace them and set `example_values: false` in group_vars/all/pilot.yml, or add --rehearse",
        )
    hosts = [declaration.hosts[name] for name in names]
    with ExitStack() as stack:
        sites = {site: _Site(declaration, site, hosts, request, stack) for site in sorted({one.site for one in hosts})}
        jobs = [device_job(declaration, host, request, sites[host.site].journal, channel.event) for host in hosts]
        jobs = [replace(job, confirmed=sites[job.site].confirmed.get(job.name)) for job in jobs]
        results = asyncio.run(fleet.run(jobs, mode=request.mode.value))
        for site in sites.values():
            site.end(results)
    return results, {name: site.run for name, site in sites.items() if site.run}


class _Site:
    """A site's lock and journal while the request is performed; a plan changes nothing and needs neither."""

    def __init__(
        self, declaration: Declaration, site: str, hosts: Sequence[Host], request: Request, stack: ExitStack
    ) -> None:
        self.hosts = frozenset(host.name for host in hosts if host.site == site)
        self.journal: Recorder = NoJournal()
        self.run = ""
        self.confirmed: Mapping[str, Confirmed] = {}
        if not request.mode.reads_only:
            store = Store(request.state, rehearsed=request.rehearsed)
            stack.enter_context(store.lock(site, request.command))
            opened = _open(store, declaration, site, sorted(self.hosts), request)
            self.journal = stack.enter_context(opened)
            self.run = opened.run
        elif not request.rehearsed:
            # An emulated device is new with every rehearsal: what an earlier one was says nothing about it.
            self.confirmed = Store(request.state).last_confirmed(site, self.hosts)

    def end(self, results: Sequence[DeviceResult]) -> None:
        """Write the last record: nothing of this run is open any more.

        A disk that is full by now is told in the devices' own results, which must not be lost over it.
        """
        worst = max((result.exit for result in results if result.name in self.hosts), default=ExitCode.NOTHING)
        with suppress(JournalFailed):
            self.journal.write(RunEnded(exit=int(worst)))


def _open(store: Store, declaration: Declaration, site: str, hosts: Sequence[str], request: Request) -> Journal:
    if request.mode is Mode.RESUME and request.run is not None:
        resumed = RunResumed(revision=declaration.revision, tool=__version__, command=request.command)
        return store.resume(site, request.run, resumed)
    return store.start(
        RunStarted(
            site=site,
            revision=declaration.revision,
            tool=__version__,
            hosts=tuple(hosts),
            rehearsed=request.rehearsed,
            command=request.command,
            back_to=request.back_to,
            restore=request.restore,
        )
    )


def _for_ansible(results: Sequence[DeviceResult]) -> dict[str, Any]:
    fine = (ExitCode.DONE, ExitCode.CHANGES)
    return {
        "changed": any(result.planned and result.exit in fine for result in results),
        "per_host": {
            result.name: {**result.as_dict(), "ok": result.exit in fine, "message": _words(result)}
            for result in results
        },
        "diff": [{"prepared": shown} for result in results if (shown := _shown(result))],
    }


def _shown(result: DeviceResult) -> str:
    """What `--diff` prints of a device: the lines that would change, then the same told as drift."""
    told = "" if result.comparison is None else drift_lines(result.comparison.as_dict())
    return f"{result.name}:\n{result.diff}{told}" if result.diff or told else ""


def _words(result: DeviceResult) -> str:
    return f"{result.message} ({result.hint})" if result.hint else result.message
