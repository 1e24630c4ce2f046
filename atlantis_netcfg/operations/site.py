"""Perform a request for the RouterOS hosts of a play: one journal and one lock a site, one job a device."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.crash_report import crashed
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.worker import run_until_settled
from atlantis_netcfg.journal import Store, unrecorded
from atlantis_netcfg.operations.costs import Costs, gate
from atlantis_netcfg.operations.jobs import device_job
from atlantis_netcfg.operations.kinds import handled
from atlantis_netcfg.operations.request import declaration_of, open_request, refuse_examples
from atlantis_netcfg.operations.schedule import RunUnit, far_bearer, members_of, pair_of
from atlantis_netcfg.operations.site_run import RunName, SiteRun
from atlantis_netcfg.report.drift import drift_lines
from atlantis_netcfg.routeros import Status, fleet

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.operations.request import EventStream, Request
    from atlantis_netcfg.routeros.apply import DeviceJob, DeviceResult
    from atlantis_netcfg.routeros.pair import Pair

_FINE = (ExitCode.DONE, ExitCode.CHANGES)
_REHEARSED_GRACE_S = 0.5
"""An emulated radio changes at once: either its answer is here by then, or it is heard when the link is back."""


def perform(
    inventory: Path,
    hosts: Sequence[str],
    request: Mapping[str, Any] | None,
    *,
    plan_only: bool,
    decrypt: Callable[[str], str],
) -> dict[str, Any]:
    """Do what is asked and give `per_host`, each device's result as Ansible shows it. Raises NetcfgError.

    Of `hosts`, those that the engine does not handle are passed over, and have no entry.
    """
    with open_request(request, plan_only=plan_only) as (performed, channel):
        results = _perform(declaration_of(inventory, decrypt), hosts, performed, channel)
    return _for_ansible(results, hosts)


def _logged(result: DeviceResult, request: Request) -> DeviceResult:
    """A fault of ours on one device goes to a log file, and its place into the result."""
    if result.fault is None:
        return result
    return replace(result, hint=crashed(result.fault, request.command, lambda: request.state).hint)


def _perform(
    declaration: Declaration, names: Sequence[str], request: Request, channel: EventStream
) -> dict[str, Mapping[str, Any]]:
    """Give each device's result as data; the engine's own objects, with rows and plans, are let go one by one."""
    refuse_examples(declaration, rehearsed=request.rehearsed)
    members = members_of(declaration, [name for name in names if handled(declaration.hosts[name])], request)
    hosts = [host for member in members for host in member.hosts]
    gate(declaration, hosts, request)
    store, costs = Store(request.state, rehearsed=request.rehearsed), Costs(declaration, request)
    called = RunName()
    site_runs = {
        site: SiteRun(declaration, site, hosts, request, called) for site in sorted({item.site for item in hosts})
    }
    results: dict[str, Mapping[str, Any]] = {}
    bridged = [member.bridge.ends for member in members if member.bridge is not None]
    others = {end.name: other_end.name for ends in bridged for end, other_end in (ends, ends[::-1])}

    def ended(result: DeviceResult) -> None:
        site = declaration.hosts[result.name].site
        paid = costs.report(result, site_runs[site].journal, store)
        recorded = unrecorded(_logged(result, request), site_runs[site].ended(result))
        notes = list(dict.fromkeys((*paid["notes"], *recorded.notes)))
        results[recorded.name] = {**recorded.as_dict(), **paid, "notes": notes, "other_end": others.get(recorded.name)}
        channel.outcome(
            {recorded.name: results[recorded.name]},
            {} if request.mode.reads_only else {site: {"routers": site_runs[site].run}},
        )

    with ExitStack() as stack:
        for site_run in site_runs.values():
            stack.callback(site_run.close)
        waiting = _waiting(costs, members, site_runs, channel)
        run_until_settled(fleet.stream(waiting, ended, mode=request.mode.value))
    return results


def _waiting(
    costs: Costs, members: Sequence[RunUnit], site_runs: Mapping[str, SiteRun], channel: EventStream
) -> list[fleet.Waiting]:
    """One turn a device, site by site; whatever refuses the only site of a request refuses the request. Raises that.

    A bridge to another site waits for its turn in any case: only its two ends fail if somebody works at that site.
    """

    def begun(site: str) -> SiteRun:
        site_runs[site].begin()
        channel.outcome({}, {site: {"routers": site_runs[site].run}} if site_runs[site].run else {})
        return site_runs[site]

    def job_of(host: Host) -> DeviceJob:
        site_run = begun(host.site)
        job = device_job(costs.declaration, host, costs.request, site_run.journal, channel.event)
        return costs.beside(replace(job, confirmed=site_run.confirmed.get(host.name)))

    def make(member: RunUnit) -> DeviceJob | Pair:
        if member.bridge is None:
            return job_of(member.hosts[0])
        for site in sorted({host.site for host in member.hosts}):
            begun(site)
        near, far = (job_of(host) for host in member.bridge.ends)
        pair = pair_of(member.bridge, near, replace(far, bearer=far_bearer(costs.declaration, member.bridge, near)))
        return replace(pair, grace_s=_REHEARSED_GRACE_S) if costs.request.rehearsed else pair

    alone = len({host.site for member in members if member.bridge is None for host in member.hosts}) == 1
    ordered = sorted(members, key=lambda member: member.hosts[0].site)
    return [
        fleet.Waiting(
            member.hosts[0].name,
            partial(_ready, make(member)) if alone and member.bridge is None else partial(make, member),
            member.bridge.far.name if member.bridge is not None else None,
            member.after,
        )
        for member in (members if alone else ordered)
    ]


def _ready(job: DeviceJob | Pair) -> DeviceJob | Pair:
    return job


def _for_ansible(results: Mapping[str, Mapping[str, Any]], names: Sequence[str]) -> dict[str, Any]:
    """Each device's result in the words of Ansible; the action `recap` gives it to the device's own host.

    The other end of a bridge may not be of the play: then the end that is tells of both, and fails with it.
    """
    for_hosts = {name: _of_host(name, result) for name, result in results.items()}
    for name, result in results.items():
        other_end = str(result["other_end"])
        if other_end in names and name not in names:
            here, there = for_hosts[other_end], for_hosts[name]
            for_hosts[other_end] = {
                **here,
                "ok": here["ok"] and there["ok"],
                "changed": (here["changed"] or there["changed"]) and here["ok"] and there["ok"],
                "message": f"{here['message']}; {name}: {there['message']}",
                "shown": here["shown"] + there["shown"],
            }
    return {"per_host": for_hosts}


def _of_host(name: str, result: Mapping[str, Any]) -> dict[str, Any]:
    fine = result["exit"] in _FINE
    return {
        **result,
        "ok": fine,
        "changed": result["status"] in (Status.CHANGED, Status.PLANNED) and fine,
        "message": _words(result),
        "shown": _diff_text(name, result),
    }


def _diff_text(name: str, result: Mapping[str, Any]) -> str:
    """What `--diff` prints of a device: the lines that would change, then the same told as drift."""
    drift = "" if result["comparison"] is None else drift_lines(result["comparison"])
    return f"{name}:\n{result['diff']}{drift}" if result["diff"] or drift else ""


def _words(result: Mapping[str, Any]) -> str:
    return f"{result['message']} ({result['hint']})" if result["hint"] else str(result["message"])
