"""Bring files, links, steps and units of a computer to the desired state, in one call.

The order: check the SSH access; read everything; write every file that differs beside its destination and validate it;
only then move the first one to its destination. Steps and systemd units compare stamps, so that the next run completes
one that was interrupted at any point. With `check` the same steps run without a change.
"""

from __future__ import annotations

import hashlib
import json
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Callable, Iterable, Mapping

from atlantis_netcfg.core.messages import arg, msg

from . import ssh_access
from .errors import ModuleError
from .file_transaction import FileTransaction, clear, unknown_paths
from .filesystem import ABSENT, FileSystem, Stamps
from .programs import ProgramResult, last_lines, require_success, run
from .ssh_access import hold_lock

if TYPE_CHECKING:
    from .desired_state import ConvergeStep, DesiredState, Unit

_NO_INSTALL = ("static", "generated", "transient", "alias", "indirect", "enabled-runtime", "linked")
"""Unit file states in which `systemctl enable` has no useful effect."""
_SETTLE_S = 1.0
"""Seconds a service must run to count as started; one that cannot run mostly exits at once."""


@dataclass(frozen=True)
class ConfigureState:
    """State of a unit as reported by systemd."""

    load: str
    active: str
    sub: str
    file: str
    condition: bool
    stale: bool
    """Whether its file is newer than what systemd has read."""

    @property
    def is_known(self) -> bool:
        """Whether systemd knows the unit."""
        return self.load not in ("not-found", "")

    def enabled_as(self, *, should_start: bool) -> bool:
        """Return whether the unit's start at boot is already as desired, or cannot be enabled at all."""
        if self.file in _NO_INSTALL:
            return True
        return (self.file == "enabled") == should_start


class Systemd:
    """systemd of this computer; tests replace `run` and `sleep`."""

    def __init__(
        self, run: Callable[[list[str]], ProgramResult] = run, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        self.run = run
        self.sleep = sleep

    def unit_state(self, name: str) -> ConfigureState:
        """Query the state of a unit."""
        properties = "LoadState,ActiveState,SubState,UnitFileState,ConditionResult,NeedDaemonReload"
        result = self.run(["systemctl", "show", "--property", properties, "--", name])
        if result.code != 0:
            raise ModuleError(
                f"systemd does not respond:\n{arg(last_lines(result.output))}",
                "`systemctl is-system-running` shows why; a container without systemd cannot be a gateway",
            )
        values = dict(line.split("=", 1) for line in result.output.splitlines() if "=" in line)
        return ConfigureState(
            load=values.get("LoadState", ""),
            active=values.get("ActiveState", ""),
            sub=values.get("SubState", ""),
            file=values.get("UnitFileState", ""),
            condition=values.get("ConditionResult") != "no",
            stale=values.get("NeedDaemonReload") == "yes",
        )

    def reload_manager(self) -> None:
        """Make systemd reload the unit files."""
        require_success(self.run(["systemctl", "daemon-reload"]), "systemd could not reload its unit files")

    def enable(self, name: str, *, should_start: bool) -> None:
        """Enable or disable the start of a unit at boot."""
        result = self.run(["systemctl", "enable" if should_start else "disable", "--", name])
        require_success(result, msg(f"unit {arg(name)} could not be {'enabled' if should_start else 'disabled'}"))

    def control(self, verb: str, name: str, *, wait: bool = True) -> None:
        """Start, stop, restart or reload a unit; without `wait`, only queue the job."""
        if verb != "stop":
            self.run(["systemctl", "reset-failed", "--", name])
        result = self.run(["systemctl", verb, *([] if wait else ["--no-block"]), "--", name])
        if result.code != 0:
            raise self._failure(msg(f"systemctl {arg(verb)} {arg(name)} failed"), name)

    def settle(self) -> None:
        """Wait until a service that cannot run has died."""
        self.sleep(_SETTLE_S)

    def require_running(self, name: str, *, has_waited: bool) -> None:
        """Check that a unit runs; if `has_waited` is false, a unit that is still starting is accepted."""
        state = self.unit_state(name)
        if state.active in ("active", "reloading") or (not has_waited and state.active == "activating"):
            return
        if state.active == "inactive" and not state.condition:
            raise ModuleError(
                f"unit {arg(name)} did not start: a condition of its unit file is not met on this computer",
                f"`systemctl status {arg(name)}` names the condition",
            )
        if state.active == "inactive" and not has_waited:
            return
        raise self._failure(
            msg(f"unit {arg(name)} does not keep running: it is {arg(state.active)} ({arg(state.sub)})"), name
        )

    def _failure(self, what: str, name: str) -> ModuleError:
        text = last_lines(self.run(["journalctl", "--unit", name, "--lines", "8", "--output", "cat", "--quiet"]).output)
        return ModuleError(
            f"{arg(what)}:\n{arg(text)}" if text else what,
            f"on the computer: `systemctl status {arg(name)}`, `journalctl -eu {arg(name)}`",
        )


_UNIT_FOLDERS = ("/etc/systemd/system/", "/usr/lib/systemd/system/", "/lib/systemd/system/")
_MANAGER = "systemd has reloaded its unit files"
_NOTE = "note: "


class Configure:
    """One call of the module. `changes` and `diff` are its result; in check mode, the planned changes."""

    def __init__(
        self,
        tree: FileSystem,
        wishes: DesiredState,
        *,
        check: bool = False,
        run: Callable[[list[str]], ProgramResult] = run,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.tree = tree
        self.wishes = wishes
        self.check = check
        self.run = run
        self.stamps = Stamps(tree)
        self.systemd = Systemd(run, sleep)
        self.changes: list[str] = []
        self.diff: list[dict[str, str]] = []
        self.notes: list[str] = []
        """Output lines of steps that begin with `note: `, and notes on files that were not delivered yet."""
        self.findings: list[tuple[str, str]] = []
        """Deviations from the inventory that stopped nothing, with hints; reported in every run."""
        self._left: set[str] = set()
        """Rejected files; steps and units that depend on them are skipped."""
        self._to_come: dict[str, str] = {}
        """Path -> digest that it will have, for paths that this call has not written yet."""

    def converge(self, environment: Mapping[str, str]) -> None:
        """Apply the desired state. Raises `ModuleError`; `changes` then lists what was done before."""
        if self.wishes.way_in is not None:
            ssh_access.require_access(self.wishes.way_in, self.tree, environment)
        if self.check:
            self._apply_all()
        else:
            with hold_lock(self.tree, environment):
                self._apply_all()

    def _apply_all(self) -> None:
        self._place_files()
        self._read_unit_files()
        for step in self.wishes.steps:
            if self._left.isdisjoint(step.after):
                self._run_step(step)
        self._apply_units()
        self.notes += [brought.note for brought in self.wishes.brought if self.tree.find(brought.path) is None]
        self.findings += [
            (check.finding, check.hint) for check in self.wishes.checks if self.run(list(check.run)).code != 0
        ]

    def _place_files(self) -> None:
        stray_paths = unknown_paths(self.tree, self.wishes)
        self.wishes = replace(self.wishes, absent=(*self.wishes.absent, *stray_paths))
        placing = FileTransaction(self.tree, self.wishes, self.run)
        if self.check:
            placing.validate_aside()
            self._to_come = {
                **{file.path: _digest(file.data) for file in self.wishes.files if file.path not in placing.left},
                **{link.path: _digest(link.target.encode()) for link in self.wishes.links},
                **dict.fromkeys(self.wishes.absent, ABSENT),
            }
        else:
            placing.place()
            clear(self.tree, self.wishes, stray_paths)
        self.findings += placing.left.values()
        self._left = {*placing.left}
        self.changes += placing.changes()
        self.diff += placing.differences()

    def _read_unit_files(self) -> None:
        wishes = self.wishes
        paths = [*(file.path for file in wishes.files), *(link.path for link in wishes.links), *wishes.absent]
        digests = self._digests(path for path in paths if path.startswith(_UNIT_FOLDERS))
        if not self.stamps.holds(_MANAGER, digests):
            self._reload_manager()
            if not self.check:
                self.stamps.note(_MANAGER, digests)

    def _reload_manager(self) -> None:
        if not self.check:
            self.systemd.reload_manager()
        self.changes.append(_MANAGER)

    def _run_step(self, step: ConvergeStep) -> None:
        after = self._digests(step.after)
        digests = {**after, "run": _digest(json.dumps(step.run).encode())}
        is_absent = set(after.values()) == {ABSENT}
        if self.stamps.holds(step.name, after if is_absent else digests):
            return
        if not self.check:
            self.stamps.begin(step.name, digests)
            result = self.run(list(step.run))
            require_success(result, msg(f"step `{arg(step.name)}` failed"), "the next run tries it again")
            self.notes += [line[len(_NOTE) :] for line in result.output.splitlines() if line.startswith(_NOTE)]
            self.stamps.note(step.name, digests)
        self.changes.append(msg(f"step {arg(step.name)}"))

    def _apply_units(self) -> None:
        started_units: list[tuple[Unit, dict[str, str]]] = []
        for unit in self.wishes.units:
            if not self._left.isdisjoint(unit.after):
                continue
            state = self._state(unit)
            if state is None:
                continue
            if unit.enabled is not None and not state.enabled_as(should_start=unit.enabled):
                if not self.check:
                    self.systemd.enable(unit.name, should_start=unit.enabled)
                self.changes.append(msg(f"unit {arg(unit.name)} {'enabled' if unit.enabled else 'disabled'}"))
            digests = self._digests(unit.after)
            if self._order(unit, state, digests):
                started_units.append((unit, digests))
        if started_units and not self.check:
            self.systemd.settle()
            for unit, digests in started_units:
                self.systemd.require_running(unit.name, has_waited=unit.wait)
                self.stamps.note(_stamp(unit), digests)

    def _state(self, unit: Unit) -> ConfigureState | None:
        """Return the state of a unit; None if nothing is to be done because the unit neither exists nor is wanted."""
        state = self.systemd.unit_state(unit.name)
        if state.stale:
            self._reload_manager()
            state = state if self.check else self.systemd.unit_state(unit.name)
        if state.is_known and state.load != "masked":
            return state
        if not unit.enabled and not unit.active:
            return None
        if state.load == "masked":
            raise ModuleError(
                f"unit {arg(unit.name)} is masked: somebody has disabled it",
                f"to allow it to start: `systemctl unmask {arg(unit.name)}`",
            )
        if self.check:
            return state
        raise ModuleError(
            f"unit {arg(unit.name)} does not exist on this computer", "the package that provides it is not installed"
        )

    def _order(self, unit: Unit, state: ConfigureState, digests: dict[str, str]) -> bool:
        """Start, stop, restart or reload as needed; return True if the unit must be verified as running afterwards."""
        runs = state.active in ("active", "reloading", "activating")
        stamp = _stamp(unit)
        fresh = self.stamps.holds(stamp, digests)
        if unit.active is False or (unit.active is None and not runs):
            if runs and not self.check:
                self.systemd.control("stop", unit.name)
            if not fresh and not self.check:
                self.stamps.note(stamp, digests)
            if runs:
                self.changes.append(msg(f"unit {arg(unit.name)} stopped"))
            return False
        if runs and fresh:
            return False
        verb, text = "start", msg(f"unit {arg(unit.name)} started")
        if runs and unit.reload:
            verb, text = "reload-or-restart", msg(f"unit {arg(unit.name)} reloaded")
        elif runs:
            verb, text = "restart", msg(f"unit {arg(unit.name)} restarted")
        if not self.check:
            self.stamps.begin(stamp, digests)
            self.systemd.control(verb, unit.name, wait=unit.wait)
        self.changes.append(text)
        return True

    def _digests(self, paths: Iterable[str]) -> dict[str, str]:
        return {path: self._digest_at(path) for path in paths}

    def _digest_at(self, path: str) -> str:
        if path in self._to_come:
            return self._to_come[path]
        file = self.tree.find(path)
        if file is not None and file.kind == "link" and path in {link.path for link in self.wishes.links}:
            return _digest(file.target.encode())
        content = self.tree.read(path)
        return ABSENT if content is None else _digest(content)


def _stamp(unit: Unit) -> str:
    return f"unit {unit.name}"


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
