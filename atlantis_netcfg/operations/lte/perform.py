"""Perform a request for the 4G units of a play: one journal and one lock a site, one unit after another."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

from atlantis_netcfg import __version__
from atlantis_netcfg.core.crash_report import crashed
from atlantis_netcfg.core.errors import ExitCode, worst
from atlantis_netcfg.declaration.model import LteRouter
from atlantis_netcfg.journal import (
    NOT_RECORDED,
    Journal,
    NoJournal,
    RunEnded,
    RunResumed,
    RunStarted,
    Store,
    conclude,
    unrecorded,
)
from atlantis_netcfg.operations.costs import gate
from atlantis_netcfg.operations.lte import is_unit
from atlantis_netcfg.operations.lte.converge import Patience
from atlantis_netcfg.operations.lte.unit import FINE, LteResult
from atlantis_netcfg.operations.request import Mode, Request, declaration_of, open_request, refuse_examples
from atlantis_netcfg.routeros.apply import Status

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.journal import Recorder
    from atlantis_netcfg.operations.request import EventStream

_REHEARSED = Patience(settle_s=1.0, poll_s=0.1)


def perform(
    inventory: Path,
    hosts: Sequence[str],
    request: Mapping[str, Any] | None,
    *,
    plan_only: bool,
    decrypt: Callable[[str], str],
) -> dict[str, Any]:
    """Do what is asked and give `per_host`, the result of each unit as Ansible shows it. Raises NetcfgError.

    Of the hosts those that the RouterOS engine handles are left to it. A run that goes back to an earlier state, or
    only saves or compares, is none of ours: then nothing is asked.
    """
    with open_request(request, plan_only=plan_only) as (performed, channel):
        declaration = declaration_of(inventory, decrypt)
        units = [declaration.hosts[name] for name in hosts if is_unit(declaration.hosts[name])]
        results = _perform(declaration, units, performed, channel) if _ours(performed) else {}
    return {"per_host": {name: _of_host(result) for name, result in results.items()}}


def _ours(request: Request) -> bool:
    forward = request.back_to is None and request.restore is None
    return forward and request.mode in (Mode.PLAN, Mode.APPLY, Mode.RESUME)


def _perform(
    declaration: Declaration, units: Sequence[Host], request: Request, channel: EventStream
) -> dict[str, LteResult]:
    if units:
        refuse_examples(declaration, rehearsed=request.rehearsed)
    gate(declaration, units, request)
    results: dict[str, LteResult] = {}
    for site in sorted({host.site for host in units}):
        results |= _site(declaration, site, [host for host in units if host.site == site], request, channel)
    return results


def _site(
    declaration: Declaration, site: str, units: Sequence[Host], request: Request, channel: EventStream
) -> dict[str, LteResult]:
    """The units of one site under its lock; a plan changes nothing and needs neither lock nor journal."""
    store = Store(request.state, rehearsed=request.rehearsed)
    results: dict[str, LteResult] = {}
    with ExitStack() as stack:
        journal: Recorder = NoJournal()
        run = ""
        if not request.mode.reads_only:
            stack.enter_context(store.lock(site, request.command))
            opened = stack.enter_context(_journal(declaration, site, units, request, store))
            journal, run = opened, opened.run
            channel.outcome({}, {site: {"4g": run}})
        for host in units:
            result = results[host.name] = _unit(host, request, store, journal, channel)
            if host is units[-1]:
                ended = RunEnded(exit=int(worst(result.exit for result in results.values())))
                result = results[host.name] = unrecorded(result, conclude(journal, ended))
                run = "" if NOT_RECORDED in result.message else run
            channel.outcome({host.name: result.as_dict()}, {} if request.mode.reads_only else {site: {"4g": run}})
    return results


def _unit(host: Host, request: Request, store: Store, journal: Recorder, channel: EventStream) -> LteResult:
    # Most runs have no unit, and the console with its libraries takes a tenth of a second in each task.
    from atlantis_netcfg.operations.lte.converge import Converge  # noqa: PLC0415
    from atlantis_netcfg.operations.lte.unit import Unit  # noqa: PLC0415

    assert isinstance(host.device, LteRouter)  # noqa: S101 - `is_unit` has said so
    unit = Unit(
        host,
        host.device,
        store,
        channel.event,
        rehearsed=request.rehearsed,
        target=request.targets.get(host.name) if request.rehearsed else None,
    )
    turn = Converge(
        unit,
        journal,
        plan_only=request.mode is Mode.PLAN,
        agreed=None if request.plans is None else request.plans.get(host.name, ""),
        patience=_REHEARSED if request.rehearsed else Patience(),
    )
    try:
        return turn.run()
    except Exception as fault:  # noqa: BLE001 - a fault of ours on one unit must not hide what became of the others
        problem = crashed(fault, request.command, lambda: request.state)
        return LteResult(
            name=host.name, status=Status.UNKNOWN, exit=problem.exit, message=str(problem), hint=problem.hint
        )


def _journal(declaration: Declaration, site: str, units: Sequence[Host], request: Request, store: Store) -> Journal:
    if request.mode is Mode.RESUME and request.run is not None:
        resumed = RunResumed(revision=declaration.revision, tool=__version__, command=request.command)
        return store.resume(site, request.run, resumed)
    return store.start(
        RunStarted(
            site=site,
            revision=declaration.revision,
            tool=__version__,
            hosts=tuple(host.name for host in units),
            rehearsed=request.rehearsed,
            command=request.command,
        )
    )


def _of_host(result: LteResult) -> dict[str, Any]:
    fine = result.exit in FINE
    message = f"{result.message} ({result.hint})" if result.hint else result.message
    diff = f"{result.name}:\n{result.diff}" if result.diff else ""
    changed = bool(result.planned) and result.exit in (ExitCode.DONE, ExitCode.CHANGES)
    return {**result.as_dict(), "ok": fine, "changed": changed, "message": message, "shown": diff}
