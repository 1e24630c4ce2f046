"""Upgrading one RouterOS device from given package files: look, judge, send, reboot, and read back what came of it.

Nothing is downloaded and nothing reboots by itself: the files are given by a person, who agrees to the plan. The whole
set is on the device, each file as the device itself reads it, before it is told to reboot. A run that was broken off is
repeated: files that are there whole are not sent again, and a device that has the version is left alone.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.console.ssh import upload
from atlantis_netcfg.core.errors import DeviceFailed, OutcomeUnknown
from atlantis_netcfg.core.events import Event, Stage
from atlantis_netcfg.journal import PackagesConfirmed, PackageSent, Rebooting
from atlantis_netcfg.operations.upgrade._look import REBOOTED_WITHIN_S, Seen, log_of, look
from atlantis_netcfg.packages import Upgrade, plan
from atlantis_netcfg.routeros.api import Command, Session, SessionLost

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.core.events import Subscriber
    from atlantis_netcfg.journal import Recorder
    from atlantis_netcfg.packages import Npk
    from atlantis_netcfg.routeros.api import Endpoint
    from atlantis_netcfg.routeros.apply import SshEndpoint

__all__ = ["Upgrading", "Waiting"]


_PROGRESS_STEPS = 20


@dataclass(frozen=True, slots=True)
class Waiting:
    """How long to wait for a device that reboots and installs, in seconds."""

    until_s: float = 900.0
    poll_s: float = 5.0
    connect_s: float = 15.0
    """For one attempt; an attempt that meets a device still booting must not use up all of the time."""


@dataclass(frozen=True, slots=True)
class Upgrading:
    """One device and the files for it."""

    name: str
    endpoint: Endpoint
    ssh: SshEndpoint
    """Where files go; without a pinned host key none is sent."""
    given: tuple[Npk, ...]
    give_up: tuple[str, ...] = ()
    notify: Subscriber = lambda _event: None
    waiting: Waiting = Waiting()

    async def look(self) -> tuple[Seen, Upgrade]:
        """Read the device and decide; nothing is changed. Raises UpgradeRefused, and what a session raises."""
        self._say(Stage.CONNECTING, f"to {self.endpoint}")
        seen = await look(self.endpoint)
        self._say(Stage.OBSERVED, f"{seen.installed.board}, RouterOS {seen.installed.version}")
        strangers = sorted(seen.files.keys() - {package.path.name for package in self.given})
        if strangers:
            raise DeviceFailed(
                f"other packages lie on the device, and its next reboot would install them: {', '.join(strangers)}",
                hint="remove them (/file remove), or give them too, then run the same command again",
            )
        return seen, plan(seen.installed, self.given, give_up=self.give_up)

    async def carry_out(self, seen: Seen, upgrade: Upgrade, journal: Recorder) -> Seen:
        """Send, reboot, wait, and return what was read back.

        Raises DeviceFailed with the device as it was, or OutcomeUnknown if it has not come back.
        """
        await self._send(seen, upgrade, journal)
        journal.write(Rebooting(device=self.name, version=str(upgrade.version)))
        self._say(Stage.APPLYING, f"rebooting into RouterOS {upgrade.version}")
        await _reboot(self.endpoint)
        back = await self._back()
        await self._verify(back, upgrade)
        journal.write(
            PackagesConfirmed(device=self.name, version=str(back.installed.version), packages=upgrade.expected)
        )
        self._say(Stage.CONFIRMED, f"RouterOS {back.installed.version}")
        return back

    async def _send(self, seen: Seen, upgrade: Upgrade, journal: Recorder) -> None:
        """Put every file on the device; what was put there is taken away again if one does not arrive."""
        done = 0
        try:
            for package in upgrade.send:
                if not seen.holds(package):
                    await asyncio.to_thread(self._upload, package, done, upgrade.size)
                done += package.size
                self._say(Stage.APPLYING, f"kB sent, {package.path.name} is whole", done // 1000, upgrade.size // 1000)
            await self._all_there(upgrade)
        except BaseException:
            await _remove(self.endpoint, upgrade.send)
            raise
        for package in upgrade.send:
            journal.write(PackageSent(device=self.name, file=package.path.name, sha256=package.sha256))

    async def _all_there(self, upgrade: Upgrade) -> None:
        there = await look(self.endpoint)
        missing = [package.path.name for package in upgrade.send if not there.holds(package)]
        if missing:
            raise DeviceFailed(f"the device does not take these files for packages: {', '.join(missing)}")

    def _upload(self, package: Npk, before: int, total: int) -> None:
        told = before

        def progress(sent: int, _size: int) -> None:
            nonlocal told
            if before + sent - told >= total // _PROGRESS_STEPS:
                told = before + sent
                self._say(Stage.APPLYING, f"kB sent, now {package.path.name}", told // 1000, total // 1000)

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

    async def _back(self) -> Seen:
        """Wait for a device that was up for less time than has gone by: then it has rebooted. Raises OutcomeUnknown."""
        clock = asyncio.get_running_loop().time
        asked = clock()
        patient_s = self.waiting.connect_s
        endpoint = replace(self.endpoint, connect_timeout_s=patient_s, reply_timeout_s=patient_s)
        why = "it did not answer"
        while (gone_s := clock() - asked) < self.waiting.until_s:
            self._say(Stage.WAITING, f"for the device to come back: {gone_s:.0f} s")
            await asyncio.sleep(self.waiting.poll_s)
            try:
                seen = await look(endpoint)
            except DeviceFailed as away:
                why = str(away)
                continue
            if seen.uptime_s <= clock() - asked + REBOOTED_WITHIN_S:
                return seen
            why = "it answers, but it has not rebooted"
        raise OutcomeUnknown(
            f"{self.name} was told to reboot and is not back after {self.waiting.until_s:.0f} s: {why}",
            hint="is it powered? Look at its lights or its serial line, then run the same command again",
        )

    async def _verify(self, back: Seen, upgrade: Upgrade) -> None:
        """Compare what came back with what was planned. Raises DeviceFailed with the device's own words."""
        there = {package.name: package for package in back.installed.packages if not package.disabled}
        wrong = [name for name in upgrade.expected if name not in there or there[name].version != upgrade.version]
        if back.installed.version == upgrade.version and not wrong:
            return
        words = await log_of(self.endpoint)
        told = f"; its log says: {'; '.join(words)}" if words else ""
        missing = f", without {', '.join(wrong)}" if wrong else ""
        raise DeviceFailed(
            f"{self.name} rebooted and runs RouterOS {back.installed.version}{missing}{told}",
            hint="are the files whole and from MikroTik, for this very board?",
        )

    def _say(self, stage: Stage, message: str, done: int = 0, total: int = 0) -> None:
        self.notify(Event(self.name, stage, message, done, total))


async def _reboot(endpoint: Endpoint) -> None:
    """Tell it; a device that goes down before it has answered has heard us."""
    session = await Session.open(endpoint)
    try:
        (await session.command(Command("/system/reboot"))).checked()
    except SessionLost:
        pass
    finally:
        await session.close()


async def _remove(endpoint: Endpoint, packages: Sequence[Npk]) -> None:
    """Take sent files away, as far as the device can be reached."""
    try:
        session = await Session.open(endpoint)
    except DeviceFailed:
        return
    try:
        await session.flight([Command("/file/remove", (("numbers", package.path.name),)) for package in packages])
    except DeviceFailed:
        return
    finally:
        await session.close()
