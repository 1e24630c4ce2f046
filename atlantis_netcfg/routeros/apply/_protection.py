"""The protection of a change on this device, and its description.

    RouterOS 7.18 and later      safe mode of the API session (`/safe-mode`)
    before, with SSH             safe mode of an SSH session, and a dead-man job where device-mode allows one
    before, without SSH          the dead-man job alone
    none of these                only harmless changes, unless the user decides otherwise

Safe mode: manual, Configuration Management. One session holds it. When that session ends, the device undoes what was
not released: at once after a clean close, after about nine minutes if the link died. It undoes changes of all sessions,
so an SSH session can hold it while the API session writes. Device-mode: manual, Device-mode (from RouterOS 7.17).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.routeros import safe_mode
from atlantis_netcfg.routeros.scheduler_jobs import forbidden

if TYPE_CHECKING:
    from atlantis_netcfg.routeros._types import Facts, Plan
    from atlantis_netcfg.routeros.apply._job import DeviceJob


class Protection(StrEnum):
    """Mechanism that undoes an unfinished change."""

    SAFE_MODE = "safe-mode"
    """Safe mode of the session that writes."""
    CONSOLE = "console-safe-mode"
    """Safe mode of an additional SSH session."""
    DEAD_MAN = "dead-man"
    """A job of the device's scheduler that rolls back unless it is removed in time."""
    NONE = "none"
    """No protection: only for changes that can do no harm by themselves; we restore the old state ourselves."""

    @property
    def holds(self) -> bool:
        """True if safe mode is held during the writes."""
        return self in (Protection.SAFE_MODE, Protection.CONSOLE)


class InterferenceError(DeviceError):
    """Somebody else has changed the device since it was read, so the plan no longer fits."""


@dataclass(frozen=True, slots=True)
class ProtectionChoice:
    """The protection of a change, and why there is no better one."""

    protection: Protection
    dead_man_s: float | None = None
    """Seconds from arming until the dead-man job runs; None: no job."""
    why: str = ""
    """Why no better protection is possible."""

    @property
    def value(self) -> str:
        """The choice as recorded in the journal: `console-safe-mode dead-man`."""
        both = self.dead_man_s is not None and self.protection is Protection.CONSOLE
        return f"{self.protection.value} {Protection.DEAD_MAN.value}" if both else self.protection.value

    @property
    def words(self) -> str:
        """The line of the plan, after `protection: `."""
        minutes = msg("" if self.dead_man_s is None else f"{arg(self.dead_man_s / 60):.0f} min")
        line = {
            Protection.SAFE_MODE: "safe mode of the API session",
            Protection.CONSOLE: msg(
                "safe mode of an SSH session" + (f" and a dead-man job, {arg(minutes)}" if minutes else "")
            ),
            Protection.DEAD_MAN: msg(f"a dead-man job, {arg(minutes)}"),
            Protection.NONE: "none",
        }[self.protection]
        return msg(f"{arg(line)} ({arg(self.why)})") if self.why else line


def choose(plan: Plan, facts: Facts, job: DeviceJob, *, invertible: str | None, seconds: float) -> ProtectionChoice:
    """Choose the protection. `invertible`: why no script can undo the plan, or None; `seconds`: maximum duration."""
    if not plan.actions:
        return ProtectionChoice(Protection.NONE, why="nothing changes")
    if facts.has_safe_mode:
        return ProtectionChoice(Protection.SAFE_MODE)
    if all(action.inert for action in plan.actions):
        return ProtectionChoice(Protection.NONE, why="nothing in it can do harm")
    no_ssh = _ssh_missing_reason(job)
    no_job = forbidden(facts) or invertible
    wait_s = max(job.patience.dead_man_s, 3 * seconds)
    if no_ssh is None:
        # Longer than a dead session keeps safe mode. Assumption: dead-man-after-silence
        both_s = None if no_job else job.patience.undo_s + wait_s
        return ProtectionChoice(Protection.CONSOLE, both_s, msg(f"no dead-man job: {arg(no_job)}" if no_job else ""))
    if no_job is None:
        return ProtectionChoice(Protection.DEAD_MAN, wait_s, msg(f"no safe mode: {arg(no_ssh)}"))
    return ProtectionChoice(Protection.NONE, why=msg(f"no safe mode: {arg(no_ssh)}; no dead-man job: {arg(no_job)}"))


def _ssh_missing_reason(job: DeviceJob) -> str | None:
    if job.ssh is None:
        return "RouterOS before 7.18 has safe mode on a console only, and the inventory has no SSH for this device"
    if job.ssh.pin is None:
        return "RouterOS before 7.18 has safe mode on a console only, and the SSH host key is not pinned"
    return None


def safe_mode_of(choice: ProtectionChoice, job: DeviceJob) -> safe_mode.SafeMode:
    """Return the safe-mode handler of a choice; nothing is held yet."""
    if choice.protection is Protection.SAFE_MODE:
        return safe_mode.ApiSafeMode()
    return console_safe_mode(job) if choice.protection is Protection.CONSOLE else safe_mode.NoSafeMode()


def console_safe_mode(job: DeviceJob) -> safe_mode.SafeMode:
    """Return console safe mode if the device has a console that we may use, else none."""
    if job.ssh is None or job.ssh.pin is None:
        return safe_mode.NoSafeMode()
    from atlantis_netcfg.routeros.apply._console import ConsoleSafeMode  # noqa: PLC0415 - the SSH client is heavy

    return ConsoleSafeMode(job.console, job.ssh, job.patience.verify_s)
