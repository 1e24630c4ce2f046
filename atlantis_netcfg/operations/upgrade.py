"""Upgrade of RouterOS on one device of the inventory, from package files that a person supplies.

`PreparedUpgrade.of` reads the files and the device and plans the upgrade without changes; a person agrees; `carry_out`
saves the device's state, sends the files, reboots, and reads back. It never starts automatically and downloads nothing.
"""

from __future__ import annotations

import asyncio
import re
from dataclasses import dataclass, field, replace
from math import ceil
from typing import TYPE_CHECKING, Any, Self

from atlantis_netcfg import __version__, runs
from atlantis_netcfg.core import errors, events
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.inventory.model import Router
from atlantis_netcfg.links.cost import MeteredLink, Preview, preview
from atlantis_netcfg.operations.common.costs import require_consent, unpaid
from atlantis_netcfg.operations.common.jobs import device_job
from atlantis_netcfg.operations.common.request import Mode as RequestMode
from atlantis_netcfg.operations.common.request import Request
from atlantis_netcfg.operations.common.session_link import site_link_of
from atlantis_netcfg.operations.common.site_links import link_of
from atlantis_netcfg.routeros import api, apply
from atlantis_netcfg.routeros.console.ssh import upload
from atlantis_netcfg.routeros.estimate import LinkMetrics, beforehand
from atlantis_netcfg.routeros.packages import InstalledSystem, Npk, RouterOsPackage, Upgrade, plan, read_npk

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.inventory import Host, Inventory

_PROGRESS_STEPS = 20


@dataclass(frozen=True, slots=True)
class WaitingUpgrade:
    """Timeouts in seconds for a device that reboots and installs."""

    until_s: float = 900.0
    poll_s: float = 5.0
    connect_s: float = 15.0
    """Timeout of one attempt; an attempt that meets a booting device must not use up the whole time."""


@dataclass(frozen=True, slots=True)
class Upgrading:
    """The upgrade of one device, with its files."""

    name: str
    endpoint: api.Endpoint
    ssh: apply.SshEndpoint
    """Destination of the files; without a pinned host key no file is sent."""
    packages: tuple[Npk, ...]
    give_up: tuple[str, ...] = ()
    notify: events.Subscriber = lambda _event: None
    waiting: WaitingUpgrade = WaitingUpgrade()

    async def look(self) -> tuple[SeenPackages, Upgrade]:
        """Read the device and plan the upgrade without changes; raise UpgradeError or a session's errors."""
        self._say(events.Stage.CONNECTING, msg(f"to {arg(self.endpoint)}"))
        observation = await look(self.endpoint)
        self._say(
            events.Stage.OBSERVED,
            msg(f"{arg(observation.software.board)}, RouterOS {arg(observation.software.version)}"),
        )
        strangers = sorted(observation.files.keys() - {package.path.name for package in self.packages})
        if strangers:
            raise errors.DeviceError(
                "other packages are on the device, and its next reboot would install them: "
                f"{arg(join(', ', strangers))}",
                hint="remove them (/file remove), or give their files too, then run the same command again",
            )
        return observation, plan(observation.software, self.packages, give_up=self.give_up)

    async def carry_out(self, observation: SeenPackages, upgrade: Upgrade, journal: runs.Recorder) -> SeenPackages:
        """Send the files, reboot, wait, and return the state read back.

        Raises DeviceError with the device unchanged, or OutcomeUnknown if it does not come back.
        """
        await self._send(observation, upgrade, journal)
        journal.write(runs.Rebooting(device=self.name, version=str(upgrade.version)))
        self._say(events.Stage.APPLYING, msg(f"rebooting into RouterOS {arg(upgrade.version)}"))
        before = asyncio.get_running_loop().time()
        await _reboot(self.endpoint)
        back = await self._back(before)
        await self._verify(back, upgrade)
        journal.write(
            runs.PackageConfirmation(
                device=self.name, version=str(back.software.version), packages=upgrade.expected_packages
            )
        )
        self._say(events.Stage.CONFIRMED, f"RouterOS {back.software.version}")
        return back

    async def _send(self, observation: SeenPackages, upgrade: Upgrade, journal: runs.Recorder) -> None:
        """Upload every file; remove the uploaded ones again if one fails."""
        sent_bytes = 0
        try:
            for package in upgrade.send:
                if not observation.holds(package):
                    await asyncio.to_thread(self._upload, package, sent_bytes, upgrade.size)
                sent_bytes += package.size
                self._say(
                    events.Stage.APPLYING,
                    msg(f"kB sent, {arg(package.path.name)} is complete"),
                    sent_bytes // 1000,
                    upgrade.size // 1000,
                )
            await self._check_files_present(upgrade)
        except BaseException:
            await _remove(self.endpoint, upgrade.send)
            raise
        for package in upgrade.send:
            journal.write(runs.PackageSent(device=self.name, file=package.path.name, sha256=package.sha256))

    async def _check_files_present(self, upgrade: Upgrade) -> None:
        there = await look(self.endpoint)
        missing = [package.path.name for package in upgrade.send if not there.holds(package)]
        if missing:
            raise errors.DeviceError(
                f"the device does not recognise these files as packages: {arg(join(', ', missing))}"
            )

    def _upload(self, package: Npk, before: int, total: int) -> None:
        reported_bytes = before

        def progress(sent_bytes: int, _size: int) -> None:
            nonlocal reported_bytes
            if before + sent_bytes - reported_bytes >= total // _PROGRESS_STEPS:
                reported_bytes = before + sent_bytes
                self._say(
                    events.Stage.APPLYING,
                    msg(f"kB sent, now {arg(package.path.name)}"),
                    reported_bytes // 1000,
                    total // 1000,
                )

        ssh = self.ssh
        upload(
            ssh.host,
            ssh.port,
            ssh.user,
            ssh.password,
            pin=ssh.pin,
            source=package.path,
            name=package.path.name,
            progress=progress,
        )

    async def _back(self, before: float) -> SeenPackages:
        """Wait until the device's uptime is shorter than the time since `before`: then it has rebooted.

        `before` is a time of the loop before the reboot command. Raises OutcomeUnknown.
        """
        clock = asyncio.get_running_loop().time
        began = clock()
        patient_s = self.waiting.connect_s
        endpoint = replace(self.endpoint, connect_timeout_s=patient_s, reply_timeout_s=patient_s)
        why = "no response"
        while (gone_s := clock() - began) < self.waiting.until_s:
            words = msg(
                f"for the device to come back: {arg(gone_s):.0f} s of at most {arg(self.waiting.until_s):.0f} s"
            )
            self._say(events.Stage.WAITING, words)
            await asyncio.sleep(self.waiting.poll_s)
            try:
                observation = await look(endpoint)
            except errors.DeviceError as away:
                why = str(away)
                continue
            if observation.uptime_s <= clock() - before + REBOOTED_WITHIN_S:
                return observation
            why = "it responds, but it has not rebooted"
        raise errors.OutcomeUnknown(
            f"{arg(self.name)} did not come back within {arg(self.waiting.until_s):.0f} s after the reboot command: "
            f"{arg(why)}",
            hint="does it have power? Check its lights or its serial console, then run the same command again",
        )

    async def _verify(self, back: SeenPackages, upgrade: Upgrade) -> None:
        """Compare the device after the reboot with the plan; raise DeviceError with the device's own messages."""
        there = {package.name: package for package in back.software.packages if not package.is_disabled}
        wrong = [
            name for name in upgrade.expected_packages if name not in there or there[name].version != upgrade.version
        ]
        if back.software.version == upgrade.version and not wrong:
            return
        words = await log_of(self.endpoint)
        log_words = msg(f"; its log says: {arg(join('; ', words))}" if words else "")
        missing = msg(f", without {arg(join(', ', wrong))}" if wrong else "")
        raise errors.DeviceError(
            f"{arg(self.name)} rebooted and runs RouterOS {arg(back.software.version)}{arg(missing)}{arg(log_words)}",
            hint="are the files complete, from MikroTik, and for this board?",
        )

    def _say(self, stage: events.Stage, message: str, amount: int = 0, total: int = 0, limit_s: float = 0.0) -> None:
        self.notify(events.Event(self.name, stage, message, amount, total, limit_s=limit_s))


async def _reboot(endpoint: api.Endpoint) -> None:
    """Reboot the device; a connection lost before the response counts as success."""
    session = await api.Session.open(endpoint)
    try:
        (await session.command(api.Command("/system/reboot"))).check()
    except api.SessionLost:
        pass
    finally:
        await session.close()


async def _remove(endpoint: api.Endpoint, packages: Sequence[Npk]) -> None:
    """Remove uploaded files, if the device can be reached."""
    try:
        session = await api.Session.open(endpoint)
    except errors.DeviceError:
        return
    try:
        await session.flight([api.Command("/file/remove", (("numbers", package.path.name),)) for package in packages])
    except errors.DeviceError:
        return
    finally:
        await session.close()


_OVERHEAD = 1.1
"""Bytes on the wire for one byte of a file: SSH, TCP and IP (inferred)."""


@dataclass(frozen=True, slots=True)
class UpgradeResult:
    """The result of an upgrade; everything reported as done was read back."""

    device: str
    status: apply.Status
    exit: errors.ExitCode
    message: str
    hint: str | None = None
    before: str = ""
    after: str = ""
    packages: tuple[str, ...] = ()
    run: str = ""
    notes: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return the object that `--json` prints."""
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
class PreparedUpgrade:
    """An upgrade that is planned and not started."""

    upgrading: Upgrading
    observation: SeenPackages
    upgrade: Upgrade
    link: LinkMetrics
    cost: Preview
    """Cost of sending the files, with backup and read-back; the reboot itself sends nothing."""
    job: apply.DeviceJob = field(repr=False)

    @classmethod
    def of(  # noqa: PLR0913 - all that a command line says
        cls,
        inventory: Inventory,
        host: Host,
        files: Sequence[Path],
        request: Request,
        notify: events.Subscriber,
        *,
        give_up: Sequence[str] = (),
        waiting: WaitingUpgrade = WaitingUpgrade(),
    ) -> Self:
        """Read the files, then the device; raise NotAPackage and CostRefusal before contacting it.

        Raises UpgradeError and DeviceError afterwards.
        """
        if not isinstance(host.device, Router):
            raise errors.NoMatchError(
                f"{arg(host.name)} is a {arg(host.device.kind.replace('_', ' '))}: only routers can be upgraded"
            )
        packages = tuple(read_npk(path) for path in files)
        require_consent(inventory, [host], request.model_copy(update={"mode": RequestMode.PLAN}))
        job = device_job(inventory, host, request, runs.NoJournal(), notify)
        assert job.ssh is not None  # noqa: S101 - every router of the inventory has it
        upgrading = Upgrading(host.name, job.endpoint, job.ssh, packages, tuple(give_up), notify, waiting)
        observation, upgrade = asyncio.run(upgrading.look())
        link = site_link_of(inventory, host, request.via.get(host.name))
        cost = _cost(upgrade, link, link_of(inventory, host.site, link.name))
        return cls(upgrading, observation, upgrade, link, cost, job)

    @property
    def seconds(self) -> float:
        """The duration of the upload at the link's rate in the inventory, without the reboot."""
        return self.upgrade.size * _OVERHEAD * 8 / self.link.rate_up_bps

    def carry_out(self, inventory: Inventory, request: Request) -> UpgradeResult:
        """Carry out the upgrade under the site's lock, with a journal.

        Raises CostRefusal, SiteBusy and JournalError before anything is sent.
        """
        self.affordable(request)
        if self.link.is_metered and not request.rehearsed and not request.accept_cost:
            raise unpaid([self.cost.words], request.command)
        store = runs.Store(request.state, is_rehearsal=request.rehearsed)
        with (
            store.lock(self.job.site, request.command),
            store.start(self._start_record(inventory, request)) as journal,
        ):
            result = self._run_with_journal(journal)
            outcome = runs.Outcome(
                device=result.device, status=result.status.value, exit=int(result.exit), message=result.message
            )
            return runs.mark_unrecorded(result, runs.conclude(journal, outcome, runs.RunEnd(exit=int(result.exit))))

    def affordable(self, request: Request) -> None:
        """Raise CostRefusal for files beyond the link's cap, even with consent; not in a rehearsal."""
        if self.cost.over_cap and not request.rehearsed:
            raise self.cost.refusal()

    def plan_result(self) -> UpgradeResult:
        """Return the result of a plan: nothing was sent."""
        before, after = str(self.observation.software.version), str(self.upgrade.version)
        message = msg(
            f"planned: RouterOS {arg(before)} -> {arg(after)}, {arg(len(self.upgrade.send))} files, "
            f"{arg(self.upgrade.size)} bytes"
        )
        names = tuple(package.name for package in self.upgrade.send)
        return UpgradeResult(
            self.job.name, apply.Status.PLANNED, errors.ExitCode.CHANGES, message, None, before, after, names
        )

    def unchanged_result(self) -> UpgradeResult:
        """Return the result for a device that is up to date."""
        version = str(self.observation.software.version)
        return UpgradeResult(
            self.job.name,
            apply.Status.UNCHANGED,
            errors.ExitCode.DONE,
            msg(f"unchanged: RouterOS {arg(version)}"),
            before=version,
            after=version,
            packages=self.upgrade.expected_packages,
        )

    def _start_record(self, inventory: Inventory, request: Request) -> runs.RunStart:
        return runs.RunStart(
            site=self.job.site,
            revision=inventory.revision,
            tool=__version__,
            hosts=(self.job.name,),
            rehearsed=request.rehearsed,
            command=request.command,
            purpose=runs.Purpose.UPGRADE,
        )

    def _run_with_journal(self, journal: runs.Journal) -> UpgradeResult:
        before = str(self.observation.software.version)
        try:
            back, differs = asyncio.run(self._run(journal))
        except errors.NetcfgError as failure:
            status = apply.Status.UNKNOWN if failure.exit is errors.ExitCode.UNKNOWN else apply.Status.LEFT_AS_FOUND
            hint = failure.hint and errors.fill_hint(failure.hint, site=self.job.site, device=self.job.name)
            return UpgradeResult(self.job.name, status, failure.exit, str(failure), hint, before, run=journal.run)
        after = str(back.software.version)
        return UpgradeResult(
            self.job.name,
            apply.Status.CHANGED,
            errors.ExitCode.DONE,
            msg(f"RouterOS {arg(before)} -> {arg(after)}, verified: {arg(join(', ', self.upgrade.expected_packages))}"),
            None,
            before,
            after,
            self.upgrade.expected_packages,
            journal.run,
            (_configuration(differs, self.job.site),),
        )

    async def _run(self, journal: runs.Journal) -> tuple[SeenPackages, apply.DeviceResult]:
        backup = await apply.converge(replace(self.job, journal=runs.StatesOnly(journal)), mode=apply.JobMode.BACKUP)
        if backup.exit is not errors.ExitCode.DONE:
            raise errors.DeviceError(
                f"its state could not be saved, so nothing was sent: {arg(backup.message)}", hint=backup.hint
            )
        back = await self.upgrading.carry_out(self.observation, self.upgrade, journal)
        return back, await apply.converge(self.job, mode=apply.JobMode.PLAN)


def _cost(upgrade: Upgrade, site_link: LinkMetrics, link: MeteredLink) -> Preview:
    beside = (beforehand(site_link, exports=True), beforehand(site_link), beforehand(site_link))
    sent_bytes = ceil(upgrade.size * _OVERHEAD) + sum(each.wire_bytes for each in beside)
    return preview(
        sent_bytes, upgrade.size * _OVERHEAD * 8 / site_link.rate_up_bps + sum(each.seconds for each in beside), link
    )


def _configuration(result: apply.DeviceResult, site: str) -> str:
    """Return a text on the configuration under the new version."""
    if result.exit is errors.ExitCode.DONE:
        return "the configuration matches the inventory"
    if result.exit is errors.ExitCode.CHANGES:
        return msg(
            f"{arg(result.planned_count)} changes to match the inventory: review with `provision plan site={arg(site)} "
            f"device={arg(result.name)}`"
        )
    return msg(f"cannot compare the configuration: {arg(result.message)}")


REBOOTED_WITHIN_S = 5.0
"""Tolerated difference in seconds between the device's uptime and our clock."""

_RESOURCE = "version,architecture-name,board-name,free-hdd-space,factory-software,uptime"
_READS = (
    api.Command("/system/resource/print", ((".proplist", _RESOURCE),)),
    api.Command("/system/package/print", ((".proplist", "name,version,disabled"),)),
    api.Command("/interface/print", ((".proplist", "name,type"),), ("?type=wlan", "?type=wifi", "?#|")),
    api.Command(
        "/file/print",
        ((".proplist", "name,size,package-name,package-version,package-architecture"),),
        ("?type=package",),
    ),
)
_WEIGHT_S = {"w": 604800, "d": 86400, "h": 3600, "m": 60, "s": 1}
_LOG_LINES = 6


@dataclass(frozen=True, slots=True)
class SeenPackages:
    """The packages and files of a device at one moment."""

    software: InstalledSystem
    uptime_s: float
    files: Mapping[str, Mapping[str, str]]
    """Package files on the device's flash by name, as `/file` shows them."""

    def holds(self, package: Npk) -> bool:
        """Return whether this package is complete on the flash: of its size, and recognised by the device."""
        file = self.files.get(package.path.name)
        if file is None or file.get("size") != str(package.size):
            return False
        return "package-name" not in file or file.get("package-version") == str(package.version)


async def look(endpoint: api.Endpoint) -> SeenPackages:
    """Read in one session of two round trips; raise DeviceError, also for replies that cannot be parsed."""
    session = await api.Session.open(endpoint)
    try:
        resource, packages, radios, files = await session.flight(_READS)
    finally:
        await session.close()
    about = next(iter(resource.check().rows), {})
    return SeenPackages(
        InstalledSystem(
            version=_version(about.get("version", "")),
            architecture=about.get("architecture-name", ""),
            board=about.get("board-name", ""),
            packages=tuple(_packages(packages)),
            free_bytes=_number(about.get("free-hdd-space", "")),
            radios=tuple(row.get("name", "") for row in radios.check().rows),
            factory=_parse_version_or_none(about.get("factory-software", "")),
        ),
        uptime_s=_seconds(about.get("uptime", "")),
        files={row.get("name", ""): row for row in files.check().rows},
    )


async def log_of(endpoint: api.Endpoint) -> list[str]:
    """Return the device's log messages about packages, latest last; empty if it cannot be read."""
    try:
        session = await api.Session.open(endpoint)
    except errors.DeviceError:
        return []
    try:
        reply = await session.command(api.Command("/log/print", ((".proplist", "topics,message"),)))
    except errors.DeviceError:
        return []
    finally:
        await session.close()
    about = re.compile(r"install|package|npk|removed", re.IGNORECASE)
    return [row["message"] for row in reply.rows if about.search(row.get("message", ""))][-_LOG_LINES:]


def _packages(reply: api.Reply) -> list[RouterOsPackage]:
    """Return the installed packages; from 7.18 on the list also has available ones, without a version."""
    return [
        RouterOsPackage(row.get("name", ""), _version(row["version"]), row.get("disabled") in ("true", "yes"))
        for row in reply.check().rows
        if row.get("version")
    ]


def _version(text: str) -> Version:
    result = _parse_version_or_none(text)
    if result is None:
        raise errors.DeviceError(f"unknown RouterOS version `{arg(text)}`")
    return result


def _parse_version_or_none(text: str) -> Version | None:
    try:
        return Version.parse(text)
    except ValueError:
        return None


def _number(text: str) -> int:
    return int(text) if text.isdecimal() else 0


def _seconds(text: str) -> float:
    """Parse `1w2d3h4m5s` to seconds."""
    return float(sum(int(count) * _WEIGHT_S[unit] for count, unit in re.findall(r"(\d+)([wdhms])(?![a-z])", text)))
