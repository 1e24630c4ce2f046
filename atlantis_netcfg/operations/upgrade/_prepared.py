"""From the declaration and a person's files to one upgrade: prepared, shown, carried out under the site's lock."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field, replace
from math import ceil
from typing import TYPE_CHECKING, Any, Self

from atlantis_netcfg import __version__
from atlantis_netcfg.bearers.cost import preview
from atlantis_netcfg.core.errors import DeviceFailed, ExitCode, NetcfgError, NothingMatched, complete
from atlantis_netcfg.declaration.model import Router
from atlantis_netcfg.journal import (
    Journal,
    NoJournal,
    Outcome,
    Purpose,
    RunEnded,
    RunStarted,
    StatesOnly,
    Store,
    conclude,
    unrecorded,
)
from atlantis_netcfg.operations.bearers import bearer_of
from atlantis_netcfg.operations.costs import gate, link_of, unpaid
from atlantis_netcfg.operations.jobs import device_job
from atlantis_netcfg.operations.request import Mode as Asked
from atlantis_netcfg.operations.upgrade._device import Upgrading, Waiting
from atlantis_netcfg.packages import read_npk
from atlantis_netcfg.routeros.apply import Mode, Status, converge
from atlantis_netcfg.routeros.estimate import beforehand

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from atlantis_netcfg.bearers.cost import Link, Preview
    from atlantis_netcfg.core.events import Subscriber
    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.operations.request import Request
    from atlantis_netcfg.operations.upgrade._look import Seen
    from atlantis_netcfg.packages import Upgrade
    from atlantis_netcfg.routeros.apply import DeviceJob, DeviceResult
    from atlantis_netcfg.routeros.estimate import Bearer

__all__ = ["Prepared", "Upgraded"]

_OVERHEAD = 1.1
"""Bytes on the wire for one byte of a file: SSH, TCP and IP (inferred)."""


@dataclass(frozen=True, slots=True)
class Upgraded:
    """How it ended; what is told as done was read back."""

    device: str
    status: Status
    exit: ExitCode
    message: str
    hint: str | None = None
    before: str = ""
    after: str = ""
    packages: tuple[str, ...] = ()
    run: str = ""
    notes: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """The object that `--json` prints."""
        return {
            "device": self.device,
            "status": self.status.value,
            "exit": int(self.exit),
            "message": self.message,
            "hint": self.hint,
            "before": self.before,
            "after": self.after,
            "packages": list(self.packages),
            "run": self.run,
            "notes": list(self.notes),
        }


@dataclass(frozen=True, slots=True)
class Prepared:
    """An upgrade that has been judged and not begun."""

    upgrading: Upgrading
    seen: Seen
    upgrade: Upgrade
    bearer: Bearer
    cost: Preview
    """What sending comes to, with saving and reading back; the reboot itself sends nothing."""
    job: DeviceJob = field(repr=False)

    @classmethod
    def of(  # noqa: PLR0913 - all that a command line says
        cls,
        declaration: Declaration,
        host: Host,
        files: Sequence[Path],
        request: Request,
        notify: Subscriber,
        *,
        give_up: Sequence[str] = (),
        waiting: Waiting = Waiting(),  # noqa: B008 - frozen
    ) -> Self:
        """Read files, then the device. Raises NotAPackage and CostRefused before it is contacted.

        UpgradeRefused and DeviceFailed after.
        """
        if not isinstance(host.device, Router):
            raise NothingMatched(f"{host.name} is a {host.device.kind.replace('_', ' ')}: only routers are upgraded")
        given = tuple(read_npk(path) for path in files)
        gate(declaration, [host], request.model_copy(update={"mode": Asked.PLAN}))
        job = device_job(declaration, host, request, NoJournal(), notify)
        assert job.ssh is not None  # noqa: S101 - every router of the declaration has it
        upgrading = Upgrading(host.name, job.endpoint, job.ssh, given, tuple(give_up), notify, waiting)
        seen, upgrade = asyncio.run(upgrading.look())
        bearer = bearer_of(declaration, host, request.via.get(host.name))
        cost = _cost(upgrade, bearer, link_of(declaration, host.site, bearer.name))
        return cls(upgrading, seen, upgrade, bearer, cost, job)

    @property
    def seconds(self) -> float:
        """How long sending takes at the bearer's declared rate; the reboot comes on top."""
        return self.upgrade.size * _OVERHEAD * 8 / self.bearer.rate_up_bps

    def carry_out(self, declaration: Declaration, request: Request) -> Upgraded:
        """Do it under the site's lock, with a journal.

        Raises CostRefused, SiteBusy and JournalFailed before anything is sent.
        """
        self.affordable(request)
        if self.bearer.metered and not request.rehearsed and not request.accept_cost:
            raise unpaid([self.cost.words], request.command)
        store = Store(request.state, rehearsed=request.rehearsed)
        with store.lock(self.job.site, request.command), store.start(self._started(declaration, request)) as journal:
            result = self._journalled(journal)
            outcome = Outcome(
                device=result.device, status=result.status.value, exit=int(result.exit), message=result.message
            )
            return unrecorded(result, conclude(journal, outcome, RunEnded(exit=int(result.exit))))

    def affordable(self, request: Request) -> None:
        """Raise CostRefused for files beyond the bearer's cap, which nobody's consent lifts; a rehearsal goes on."""
        if self.cost.over_cap and not request.rehearsed:
            raise self.cost.refusal()

    def planned(self) -> Upgraded:
        """The words for a plan: nothing was sent."""
        before, after = str(self.seen.installed.version), str(self.upgrade.version)
        message = f"planned: RouterOS {before} -> {after}, {len(self.upgrade.send)} files, {self.upgrade.size} bytes"
        names = tuple(package.name for package in self.upgrade.send)
        return Upgraded(self.job.name, Status.PLANNED, ExitCode.CHANGES, message, None, before, after, names)

    def unchanged(self) -> Upgraded:
        """The words for a device that has all of it."""
        version = str(self.seen.installed.version)
        return Upgraded(
            self.job.name,
            Status.UNCHANGED,
            ExitCode.DONE,
            f"already so: RouterOS {version}",
            before=version,
            after=version,
            packages=self.upgrade.expected,
        )

    def _started(self, declaration: Declaration, request: Request) -> RunStarted:
        return RunStarted(
            site=self.job.site,
            revision=declaration.revision,
            tool=__version__,
            hosts=(self.job.name,),
            rehearsed=request.rehearsed,
            command=request.command,
            purpose=Purpose.UPGRADE,
        )

    def _journalled(self, journal: Journal) -> Upgraded:
        before = str(self.seen.installed.version)
        try:
            back, differs = asyncio.run(self._run(journal))
        except NetcfgError as failure:
            status = Status.UNKNOWN if failure.exit is ExitCode.UNKNOWN else Status.LEFT_AS_FOUND
            hint = failure.hint and complete(failure.hint, site=self.job.site, device=self.job.name)
            return Upgraded(self.job.name, status, failure.exit, str(failure), hint, before, run=journal.run)
        after = str(back.installed.version)
        return Upgraded(
            self.job.name,
            Status.CHANGED,
            ExitCode.DONE,
            f"RouterOS {before} -> {after}, read back: {', '.join(self.upgrade.expected)}",
            None,
            before,
            after,
            self.upgrade.expected,
            journal.run,
            (_configuration(differs, self.job.site),),
        )

    async def _run(self, journal: Journal) -> tuple[Seen, DeviceResult]:
        saved = await converge(replace(self.job, journal=StatesOnly(journal)), mode=Mode.BACKUP)
        if saved.exit is not ExitCode.DONE:
            raise DeviceFailed(f"its state could not be saved, so nothing was sent: {saved.message}", hint=saved.hint)
        back = await self.upgrading.carry_out(self.seen, self.upgrade, journal)
        return back, await converge(self.job, mode=Mode.PLAN)


def _cost(upgrade: Upgrade, bearer: Bearer, link: Link) -> Preview:
    beside = (beforehand(bearer, exports=True), beforehand(bearer), beforehand(bearer))
    sent = ceil(upgrade.size * _OVERHEAD) + sum(each.wire_bytes for each in beside)
    return preview(sent, upgrade.size * _OVERHEAD * 8 / bearer.rate_up_bps + sum(each.seconds for each in beside), link)


def _configuration(planned: DeviceResult, site: str) -> str:
    """Say what the new version made of the configuration."""
    if planned.exit is ExitCode.DONE:
        return "the configuration is as declared"
    if planned.exit is ExitCode.CHANGES:
        return (
            f"{planned.planned} changes to the declared configuration: look at them with "
            f"`provision site={site} only={planned.name} --plan`"
        )
    return f"the configuration could not be compared: {planned.message}"
