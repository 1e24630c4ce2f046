"""Enrolment of a site's router in the VPN: its certificate and tunnel are imported over its API.

A template cannot do it: the key of tls-crypt comes with an imported file and is in no menu. So this module installs the
identity, once and at each renewal, and `provision site=…` continues to configure the same interface by its name: the
values set here are those of the template.

    identity = identity_for(inventory, host, request)      # state/vpn/hosts/HOST.identity of this laptop
    installed = install(inventory, host, identity, request, notify, plan=False)

The files contain keys: they are written, imported and removed one after the other, and leftovers of an interrupted
session are removed by the next run before anything else. A second run changes nothing. For a rehearsal `request` has
the emulated devices' targets, and `rehearsed_identity` creates a substitute identity.
"""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from atlantis_netcfg import __version__, runs
from atlantis_netcfg.core import errors
from atlantis_netcfg.core.events import Subscriber, ignore
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory.model import Router
from atlantis_netcfg.operations.common.costs import require_consent
from atlantis_netcfg.operations.common.jobs import device_job
from atlantis_netcfg.operations.common.request import Request, refuse_examples
from atlantis_netcfg.routeros import apply
from atlantis_netcfg.vpn import routeros
from atlantis_netcfg.vpn.enrolment_package.profile import read_identity
from atlantis_netcfg.vpn.identity import Identity, KeyType
from atlantis_netcfg.vpn.rehearsal import rehearsed_identity
from atlantis_netcfg.vpn.router_import import RouterImport

if TYPE_CHECKING:
    from collections.abc import Iterable

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.operations.common.rehearsal import Rehearsal


@dataclass(frozen=True, slots=True)
class InstalledIdentity:
    """The result of an installation; everything reported as done was read back."""

    device: str
    status: apply.Status
    exit: errors.ExitCode
    message: str
    hint: str | None = None
    changes: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    run: str = ""

    def as_json(self) -> dict[str, Any]:
        """Return the object that `--json` prints."""
        return {
            "device": self.device,
            "status": self.status.value,
            "exit": int(self.exit),
            "message": self.message,
            "hint": self.hint,
            "changes": list(self.changes),
            "notes": list(self.notes),
            "run": self.run,
        }


def identity_for(inventory: Inventory, host: Host, request: Request) -> Identity:
    """Read a router's identity from this laptop, in a rehearsal from its authority; without one, create a substitute.

    Raises NoMatchError for a host that is no router, UsageError if there is no identity or another host's, and
    NotAnIdentity.
    """
    _require_router(host)
    path = request.identity_of(host.name)
    if request.rehearsed and (request.authority is None or path is None):
        return rehearsed_identity(inventory, host)
    if path is None:
        raise errors.UsageError(
            f"there is no identity of {arg(host.name)} on this computer",
            hint=(
                f"run `provision vpn onboard device={arg(host.name)}` on the computer of the authority; elsewhere "
                "`provision vpn accept file=FILE` with the enrolment package"
            ),
        )
    identity = read_identity(path.read_text(encoding="ascii"))
    if identity.member.name != host.name:
        raise errors.UsageError(f"{arg(path)} is the identity of {arg(identity.member.name)}, not of {arg(host.name)}")
    return identity


def install(  # noqa: PLR0913 - all that a command line says
    inventory: Inventory,
    host: Host,
    identity: Identity,
    request: Request,
    notify: Subscriber = ignore,
    *,
    plan: bool = False,
) -> InstalledIdentity:
    """Install the identity on the router, under the site's lock and with a journal; `plan` only plans it.

    Raises NoMatchError, UsageError and CostRefusal before the router is contacted, SiteBusy before it is changed. Later
    failures are in the result: `RouterTooOld` and other refusals leave the router unchanged.
    """
    importing, job = _prepare(inventory, host, identity, request, notify)
    try:
        observation = asyncio.run(importing.look())
    except errors.NetcfgError as failure:
        return _failure_result(importing, failure)
    if not observation.changes:
        return InstalledIdentity(
            host.name, apply.Status.UNCHANGED, errors.ExitCode.DONE, "unchanged", notes=observation.notes
        )
    if plan:
        message = msg(f"{arg(len(observation.changes))} changes to make")
        return InstalledIdentity(
            host.name,
            apply.Status.PLANNED,
            errors.ExitCode.CHANGES,
            message,
            changes=observation.changes,
            notes=observation.notes,
        )
    store = runs.Store(request.state, is_rehearsal=request.rehearsed)
    start_record = runs.RunStart(
        site=host.site,
        revision=inventory.revision,
        tool=__version__,
        hosts=(host.name,),
        rehearsed=request.rehearsed,
        command=request.command,
        purpose=runs.Purpose.INSTALL,
    )
    with store.lock(host.site, request.command), store.start(start_record) as journal:
        result = _run_with_journal(importing, replace(job, journal=runs.StatesOnly(journal)), journal)
        outcome = runs.Outcome(
            device=host.name, status=result.status.value, exit=int(result.exit), message=result.message
        )
        return runs.mark_unrecorded(result, runs.conclude(journal, outcome, runs.RunEnd(exit=int(result.exit))))


def enrol_routers(inventory: Inventory, rehearsal: Rehearsal, hosts: Iterable[Host], request: Request) -> None:
    """Install the identities of the VPN's routers among `hosts` on their emulated devices, all at the same time.

    Raises DeviceError with the message of the first device that refuses, UsageError, and SiteBusy.
    """
    request = request.model_copy(update={**rehearsal.request_fields, "rehearsed": True})
    routers = [
        host
        for host in hosts
        if isinstance(host.device, Router) and host.device.vpn_client is not None and host.name in request.targets
    ]

    def enrol(host: Host) -> InstalledIdentity:
        return install(inventory, host, identity_for(inventory, host, request), request)

    with ThreadPoolExecutor(max_workers=max(1, len(routers))) as pool:
        for result in pool.map(enrol, routers):
            if result.exit is not errors.ExitCode.DONE:
                raise errors.DeviceError(msg(f"{arg(result.device)}: {arg(result.message)}"), hint=result.hint)


def _require_router(host: Host) -> None:
    if not isinstance(host.device, Router):
        kind = host.device.kind.replace("_", " ")
        raise errors.NoMatchError(
            f"{arg(host.name)} is a {arg(kind)}: identities are installed only on routers",
            hint=f"gateways get theirs from `provision site={arg(host.site)}`",
        )


def _prepare(
    inventory: Inventory, host: Host, identity: Identity, request: Request, notify: Subscriber
) -> tuple[RouterImport, apply.DeviceJob]:
    _require_router(host)
    tunnel = routeros.find_tunnel(inventory, host)
    if tunnel is None:
        raise errors.UsageError(
            f"{arg(host.name)} is not the VPN endpoint of its site",
            hint=f"set `vpn_client:` in host_vars/{arg(host.name)}.yml",
        )
    if identity.certificate.not_after <= datetime.now(UTC):
        raise errors.UsageError(
            f"the identity of {arg(host.name)} expired on {arg(identity.certificate.not_after):%Y-%m-%d}",
            hint=(
                f"run `provision vpn renew name={arg(host.name)}` on the computer of the authority, then install the "
                "new enrolment package here"
            ),
        )
    refuse_examples(inventory, is_rehearsal=request.rehearsed)
    require_consent(inventory, [host], request)
    job = device_job(inventory, host, request, runs.NoJournal(), notify)
    importing = RouterImport(
        name=host.name,
        site=host.site,
        endpoint=job.endpoint,
        tunnel=tunnel,
        identity=identity,
        profile=routeros.profile(inventory, identity),
        is_rehearsal=request.rehearsed,
        notify=notify,
    )
    return importing, job


def _run_with_journal(importing: RouterImport, job: apply.DeviceJob, journal: runs.Journal) -> InstalledIdentity:
    try:
        changes, notes = asyncio.run(_run(importing, job))
    except errors.NetcfgError as failure:
        return replace(_failure_result(importing, failure), run=journal.run)
    message = msg(
        f"{arg(importing.tunnel.name)} is imported with certificate {arg(importing.tunnel.certificate)} (read back)"
    )
    notes = (*notes, *_key_notes(importing.identity))
    return InstalledIdentity(
        importing.name,
        apply.Status.CHANGED,
        errors.ExitCode.DONE,
        message,
        changes=changes,
        notes=notes,
        run=journal.run,
    )


async def _run(importing: RouterImport, job: apply.DeviceJob) -> tuple[tuple[str, ...], tuple[str, ...]]:
    backup = await apply.converge(job, mode=apply.JobMode.BACKUP)
    if backup.exit is not errors.ExitCode.DONE:
        raise errors.DeviceError(
            f"its state could not be saved, so nothing was sent: {arg(backup.message)}", hint=backup.hint
        )
    observation = await importing.carry_out()
    return observation.changes, observation.notes


def _key_notes(identity: Identity) -> tuple[str, ...]:
    if identity.certificate.key is KeyType.RSA:
        return ()
    name = identity.member.name
    return (msg(f"its elliptic-curve key is untested with RouterOS: `provision vpn renew name={arg(name)} key=rsa`"),)


def _failure_result(importing: RouterImport, failure: errors.NetcfgError) -> InstalledIdentity:
    status = apply.Status.UNKNOWN if failure.exit is errors.ExitCode.UNKNOWN else apply.Status.LEFT_AS_FOUND
    hint = failure.hint and errors.fill_hint(failure.hint, site=importing.site, device=importing.name)
    return InstalledIdentity(importing.name, status, failure.exit, str(failure), hint)
