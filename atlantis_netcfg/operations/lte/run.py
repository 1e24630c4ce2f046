"""A run for 4G units without RouterOS: set their SIM settings to the inventory's, and judge them.

It performs a request for the 4G units of a play: one journal and one lock per site, one unit after another. A change
counts once it was read back.
"""

from __future__ import annotations

import hashlib
import json
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from atlantis_netcfg import __version__, runs
from atlantis_netcfg.core import errors, events
from atlantis_netcfg.core.crash_report import report_crash
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory.model import LteDriver, LteRouter
from atlantis_netcfg.links.lte import Registration, rutos_client, rutos_settings
from atlantis_netcfg.links.lte.judge import quality
from atlantis_netcfg.operations.common.costs import require_consent
from atlantis_netcfg.operations.common.kinds import is_other_lte_unit
from atlantis_netcfg.operations.common.request import Mode, Request, open_inventory, open_request, refuse_examples
from atlantis_netcfg.operations.lte.units import FINE, EmulationUnavailable, LteResult, LteUnit, UnitStatus, words
from atlantis_netcfg.routeros.apply import Status
from atlantis_netcfg.routeros.console.types import ConsoleLost, ConsoleUnreachable

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.links.lte.rutos_settings import SettingChange
    from atlantis_netcfg.operations.common.request import EventStream
    from atlantis_netcfg.routeros.console.ssh import Commands


@dataclass(frozen=True, slots=True)
class UnitPatience:
    """Timeouts, in seconds, for a unit to reconnect after its settings were reloaded."""

    settle_s: float = 120.0
    poll_s: float = 5.0


@dataclass(frozen=True, slots=True)
class SettingsResult:
    """The result of changing the settings."""

    changes: tuple[SettingChange, ...] = ()
    is_done: bool = False
    refusal: str | None = None
    commands: int = 0
    taken_back: bool = False
    """Whether a refused PIN was removed from the unit."""

    @property
    def hash(self) -> str:
        """SHA-256 of the plan as a person sees it."""
        return hashlib.sha256(
            json.dumps([(item.line, item.previous_line) for item in self.changes]).encode()
        ).hexdigest()

    @property
    def diff(self) -> str:
        """The planned settings as a diff."""
        rows = (
            (f"- {item.previous_line}\n" if item.previous_line else "") + f"+ {item.line}\n" for item in self.changes
        )
        return "".join(rows)


LAYER = "uci"
_MANAGED_OPTIONS = ("proto", "sim", "apn", "auto_apn", "auth", "username", "position", "deny_roaming")
_SECRET = ("password", "pincode")


def sections_of(shell: Commands) -> dict[tuple[str, str], dict[str, str]]:
    """Return the unit's configuration by package and section; raise SettingError or ConsoleLost."""
    end = shell.run(rutos_settings.SHOW)
    if end.code:
        words = (end.error.strip() or msg(f"exit status {arg(end.code)}")).splitlines()[0]
        raise rutos_settings.SettingError(
            f"cannot read the unit's configuration over SSH: {arg(words)}",
            hint="may `admin_user` log in over SSH, and is this a Teltonika unit?",
        )
    return rutos_settings.parse_show(end.out)


def mask_secrets(sections: dict[tuple[str, str], dict[str, str]]) -> str:
    """Render the options that a run may change, secrets masked; all others are left out."""
    return "".join(
        f"{package}.{section}.{option}='{'********' if option in _SECRET else value}'\n"
        for (package, section), options in sections.items()
        for option, value in options.items()
        if option in (*_MANAGED_OPTIONS, *_SECRET)
    )


def planned_action(number: int, change: SettingChange) -> runs.PlannedAction:
    """Convert one setting to the journal's form, secrets masked."""
    value = "********" if change.secret else change.value
    return runs.PlannedAction(
        number=number,
        layer=LAYER,
        menu=f"{change.package}.{change.section}",
        verb="set",
        subject=change.option,
        values=((change.option, value),),
    )


_WORST = (events.Verdict.ERROR, events.Verdict.FAIL)
_FINAL_STATES = (
    Registration.DENIED,
    Registration.SIM_MISSING,
    Registration.SIM_PIN_REQUIRED,
    Registration.SIM_PUK_REQUIRED,
    Registration.DISABLED,
)
"""States in which waiting for the network is pointless."""
_FINAL = "roaming-not-allowed"
"""Finding code of a SIM that is registered in a network but will get no data there."""


class UnitConvergence:
    """The run of one unit."""

    def __init__(
        self,
        unit: LteUnit,
        journal: runs.Recorder,
        *,
        plan_only: bool,
        approved_hash: str | None,
        patience: UnitPatience,
    ) -> None:
        self._unit = unit
        self._journal = journal
        self._plan_only = plan_only
        self._approved_hash = approved_hash
        self._patience = patience
        self._touched = False

    def run(self) -> LteResult:
        """Read, set what differs, read again; device errors are in the result, internal errors are raised."""
        began = time.monotonic()
        try:
            result = self._run()
        except EmulationUnavailable as nothing:
            result = LteResult(
                name=self._unit.name, status=Status.UNCHANGED, exit=errors.ExitCode.NOTHING, message=str(nothing)
            )
        except errors.NetcfgError as error:
            result = self._failure_result(error, Status.UNKNOWN if self._touched else Status.LEFT_AS_FOUND)
        result = replace(result, seconds=time.monotonic() - began)
        self._tell(events.Stage.DONE if result.exit in FINE else events.Stage.FAILED, result.message)
        outcome = runs.Outcome(
            device=result.name, status=result.status.value, exit=int(result.exit), message=result.message
        )
        return runs.mark_unrecorded(result, runs.conclude(self._journal, outcome))

    def _run(self) -> LteResult:
        self._tell(events.Stage.CONNECTING, msg(f"driver {arg(self._unit.device.driver)}"))
        reading = self._unit.look()
        self._tell(events.Stage.OBSERVED, reading.reading.state.words)
        if not self._unit.may_set:
            return self._result(reading, SettingsResult())
        settings = self._apply_settings(reading)
        if settings.is_done:
            try:
                reading = self._wait_for_connection(reading)
                settings = self._taken_back(reading, settings)
            except errors.DeviceError as silent:
                return self._silent(reading, settings, silent)
        if not self._plan_only and reading.reading.state is not Registration.SIM_PIN_REQUIRED:
            self._unit.pin_attempt.forget()
        return self._result(reading, settings)

    def _apply_settings(self, reading: UnitStatus) -> SettingsResult:
        unit, desired_settings = self._unit, self._unit.settings
        with unit.shell() as shell:
            sections = sections_of(shell)
            refusal = rutos_settings.why_pin_blocks(
                reading.reading, desired_settings, sections, pin_refusal=unit.pin_attempt.why_not
            )
            if refusal is not None:
                return SettingsResult(refusal=refusal, commands=shell.count)
            settings = SettingsResult(
                rutos_settings.changes(reading.reading, desired_settings, sections), commands=shell.count
            )
            self._tell(events.Stage.PLANNED, msg(f"{arg(len(settings.changes))} settings differ"))
            if self._plan_only or not settings.changes:
                return settings
            if self._approved_hash is not None and self._approved_hash != settings.hash:
                raise errors.DeviceError(
                    f"{arg(unit.name)}: the differences are no longer those that were confirmed, so nothing was set",
                    hint="run it again and review the plan",
                )
            self._write(shell, settings, sections)
            return replace(settings, is_done=True, commands=shell.count)

    def _write(
        self, shell: Commands, settings: SettingsResult, sections: dict[tuple[str, str], dict[str, str]]
    ) -> None:
        """Write the settings and read them back; the plan is on disk first. Raise DeviceError."""
        name, numbers = self._unit.name, tuple(range(1, len(settings.changes) + 1))
        self._journal.save(name, mask_secrets(sections))
        actions = tuple(
            planned_action(number, change) for number, change in zip(numbers, settings.changes, strict=True)
        )
        self._journal.write(runs.PlanRecord(device=name, plan=settings.hash, actions=actions))
        if any(entry.option == rutos_settings.PIN for entry in settings.changes):
            self._unit.pin_attempt.remember()
        self._journal.write(runs.LayerSent(device=name, layer=LAYER, actions=numbers))
        self._touched = True
        self._tell(events.Stage.APPLYING, msg(f"{arg(len(numbers))} settings"))
        words = shell.run(rutos_settings.WRITE, input_text=rutos_settings.batch(settings.changes)).error.strip()
        # A unit whose network reloads may drop the session: a new one tells what has come of it.
        with suppress(ConsoleLost):
            shell.run(rutos_settings.RELOAD)
        self._tell(events.Stage.VERIFYING, "verifying in a new session")
        now = self._read_back()
        applied_changes = [
            item
            for item in settings.changes
            if now.get((item.package, item.section), {}).get(item.option) == item.value
        ]
        if len(applied_changes) != len(settings.changes):
            self._touched = bool(applied_changes)
            missing_change = next(element for element in settings.changes if element not in applied_changes)
            raise errors.DeviceError(
                f"{arg(name)}: {arg(len(applied_changes))} of {arg(len(settings.changes))} settings were saved; not "
                f"saved: {arg(missing_change.package)}.{arg(missing_change.section)}.{arg(missing_change.option)}"
                f"{f' ({arg(words.splitlines()[0])})' if words else ''}",
                hint="is the unit's flash full, or its configuration locked? Check its own web page",
            )
        self._journal.write(runs.ActionConfirmation(device=name, actions=numbers))
        self._touched = False

    def _read_back(self) -> dict[tuple[str, str], dict[str, str]]:
        """Read in a new session as soon as one can be opened; raise DeviceError."""
        until = time.monotonic() + self._patience.settle_s
        while True:
            try:
                with self._unit.shell() as fresh:
                    return sections_of(fresh)
            except (ConsoleLost, ConsoleUnreachable):
                if time.monotonic() > until:
                    raise
                time.sleep(self._patience.poll_s)

    def _taken_back(self, reading: UnitStatus, settings: SettingsResult) -> SettingsResult:
        """Remove a PIN that the SIM refused from the unit, which would try it again at its next start."""
        wrong = next((item for item in settings.changes if item.option == rutos_settings.PIN), None)
        if wrong is None or reading.reading.state is not Registration.SIM_PIN_REQUIRED:
            return settings
        with self._unit.shell() as shell:
            shell.run(rutos_settings.WRITE, input_text=rutos_settings.removal(wrong))
            if rutos_settings.PIN in sections_of(shell).get((wrong.package, wrong.section), {}):
                raise errors.DeviceError(
                    f"{arg(self._unit.name)}: the unit still stores the PIN that the SIM refused, and would send it "
                    "again",
                    hint="remove the PIN on the unit's web page before it restarts",
                )
            return replace(settings, taken_back=True, commands=settings.commands + shell.count)

    def _wait_for_connection(self, before: UnitStatus) -> UnitStatus:
        """Poll until the unit is connected, or waiting is pointless or timed out."""
        until = time.monotonic() + self._patience.settle_s
        requests, sent_bytes, received_bytes = before.requests, before.sent_bytes, before.received_bytes
        while True:
            reading = self._again()
            requests, sent_bytes, received_bytes = (
                requests + reading.requests,
                sent_bytes + reading.sent_bytes,
                received_bytes + reading.received_bytes,
            )
            quiet = not any(finding.verdict in _WORST for finding in reading.findings)
            final = any(finding.code == _FINAL for finding in reading.findings)
            if quiet or final or reading.reading.state in _FINAL_STATES or time.monotonic() > until:
                return replace(reading, requests=requests, sent_bytes=sent_bytes, received_bytes=received_bytes)
            self._tell(events.Stage.WAITING, reading.reading.state.words)
            time.sleep(self._patience.poll_s)

    def _again(self) -> UnitStatus:
        """Read the unit again; after the settings were verified, a reloading unit may be silent for a while."""
        until = time.monotonic() + self._patience.settle_s
        while True:
            try:
                return self._unit.look()
            except rutos_client.RutosUnreachable:
                if time.monotonic() > until:
                    raise
                time.sleep(self._patience.poll_s)

    def _silent(self, before: UnitStatus, settings: SettingsResult, silent: errors.DeviceError) -> LteResult:
        """Return the result for a unit that has not responded since its settings were written."""
        message = msg(f"{arg(len(settings.changes))} settings applied and verified; since then: {arg(silent)}")
        result = self._result(before, settings)
        return replace(
            result, exit=errors.ExitCode.CHECKS_FAILED, message=message, hint=silent.hint, findings=(), notes=()
        )

    def _result(self, reading: UnitStatus, settings: SettingsResult) -> LteResult:
        worst = next((finding for finding in reading.findings if finding.verdict in _WORST), None)
        others = tuple(words(item) for item in reading.findings if item is not worst)
        status, code, message = self._outcome(reading, settings)
        hint = None
        if worst is not None:
            message, hint = msg(f"{arg(message)}; {arg(worst.message)}"), worst.hint
            code = errors.ExitCode.CHECKS_FAILED if code is errors.ExitCode.DONE else code
        if settings.refusal is not None:
            message = msg(f"not changed: {arg(settings.refusal)}")
        return LteResult(
            name=self._unit.name,
            status=status,
            exit=code,
            message=message,
            hint=hint,
            planned_actions=len(settings.changes),
            confirmed_actions=len(settings.changes) - settings.taken_back if settings.is_done else 0,
            diff=settings.diff,
            notes=(*others, *self._unset()),
            plan_hash=settings.hash,
            findings=reading.findings,
            quality=quality(reading.reading),
            requests=reading.requests + settings.commands,
            sent_bytes=reading.sent_bytes,
            received_bytes=reading.received_bytes,
            serial=reading.serial,
        )

    def _outcome(self, reading: UnitStatus, settings: SettingsResult) -> tuple[Status, errors.ExitCode, str]:
        if settings.refusal is not None:
            return Status.LEFT_AS_FOUND, errors.ExitCode.FAILED, settings.refusal
        words = _state(reading)
        if settings.is_done:
            summary = msg(f"{arg(len(settings.changes) - settings.taken_back)} settings applied and verified")
            back = ", PIN removed" if settings.taken_back else ""
            return Status.CHANGED, errors.ExitCode.DONE, msg(f"{arg(summary)}{arg(back)}; {arg(words)}")
        if settings.changes:
            return (
                Status.PLANNED,
                errors.ExitCode.CHANGES,
                msg(f"{arg(len(settings.changes))} settings would be set; {arg(words)}"),
            )
        if self._unit.device.driver is LteDriver.MANUAL:
            return Status.UNCHANGED, errors.ExitCode.NOTHING, "not checked: this 4G unit must be checked by hand"
        if self._unit.may_set:
            return (
                Status.UNCHANGED,
                errors.ExitCode.DONE,
                msg(f"matches the inventory, nothing was changed; {arg(words)}"),
            )
        return Status.UNCHANGED, errors.ExitCode.DONE, msg(f"checked only; {arg(words)}")

    def _unset(self) -> tuple[str, ...]:
        """Return notes on settings that the driver does not change."""
        driver, sim = self._unit.device.driver, self._unit.device.sim
        if driver is LteDriver.RUTOS and not self._unit.may_set:
            return ("no `admin_user` under `access`: the SIM settings are compared but not set",)
        if driver is LteDriver.RUTOS and sim.bands:
            return ("bands are compared with the band in use but not set: set them on the unit's web page",)
        if driver in (LteDriver.AT, LteDriver.MODEMMANAGER):
            return (msg(f"driver {arg(driver)} is read-only: the SIM settings are compared but not set"),)
        return ()

    def _failure_result(self, error: errors.NetcfgError, status: Status) -> LteResult:
        code = errors.ExitCode.UNKNOWN if status is Status.UNKNOWN else error.exit
        hint = error.hint and errors.fill_hint(error.hint, site=self._unit.host.site, device=self._unit.name)
        return LteResult(name=self._unit.name, status=status, exit=code, message=str(error), hint=hint)

    def _tell(self, stage: events.Stage, message: str) -> None:
        self._unit.notify(events.Event(self._unit.name, stage, message))


def _state(look: UnitStatus) -> str:
    """Return the unit's state as a short text."""
    reading = look.reading
    words = reading.state.words
    network = " ".join(word for word in (reading.operator, reading.access_tech, reading.band) if word)
    return msg(f"{arg(words)} ({arg(network)})") if network else words


_REHEARSAL_PATIENCE = UnitPatience(settle_s=1.0, poll_s=0.1)


def perform(
    inventory: Path,
    hosts: Sequence[str],
    request: Mapping[str, Any] | None,
    *,
    plan_only: bool,
    decrypt: Callable[[str], str],
) -> dict[str, Any]:
    """Run the request and return `per_host`, each unit's result for Ansible; raise NetcfgError.

    Hosts that the RouterOS engine handles are left to it. A run that restores an earlier state, or only saves or
    compares, does not apply to these units: then nothing is read.
    """
    with open_request(request, plan_only=plan_only) as (run_request, channel):
        pilot_inventory = open_inventory(inventory, decrypt)
        units = [pilot_inventory.hosts[name] for name in hosts if is_other_lte_unit(pilot_inventory.hosts[name])]
        results = _perform(pilot_inventory, units, run_request, channel) if _is_forward_run(run_request) else {}
    return {"per_host": {name: _host_result(result) for name, result in results.items()}}


def _is_forward_run(request: Request) -> bool:
    forward = request.back_to is None and request.restore is None
    return forward and request.mode in (Mode.PLAN, Mode.APPLY, Mode.RESUME)


def _perform(
    inventory: Inventory, units: Sequence[Host], request: Request, channel: EventStream
) -> dict[str, LteResult]:
    if units:
        refuse_examples(inventory, is_rehearsal=request.rehearsed)
    require_consent(inventory, units, request)
    results: dict[str, LteResult] = {}
    for site in sorted({host.site for host in units}):
        results |= _site(inventory, site, [host for host in units if host.site == site], request, channel)
    return results


def _site(
    inventory: Inventory, site: str, units: Sequence[Host], request: Request, channel: EventStream
) -> dict[str, LteResult]:
    """Run the units of one site under its lock; a plan changes nothing and needs neither lock nor journal."""
    store = runs.Store(request.state, is_rehearsal=request.rehearsed)
    results: dict[str, LteResult] = {}
    with ExitStack() as stack:
        journal: runs.Recorder = runs.NoJournal()
        run = ""
        if not request.mode.reads_only:
            stack.enter_context(store.lock(site, request.command))
            run_journal = stack.enter_context(_journal(inventory, site, units, request, store))
            journal, run = run_journal, run_journal.run
            channel.outcome({}, {site: {"4g": run}})
        for host in units:
            result = results[host.name] = _converge_unit(host, request, store, journal, channel)
            if host is units[-1]:
                end_record = runs.RunEnd(exit=int(errors.worst(result.exit for result in results.values())))
                result = results[host.name] = runs.mark_unrecorded(result, runs.conclude(journal, end_record))
                run = "" if runs.NOT_RECORDED in result.message else run
            channel.outcome({host.name: result.as_dict()}, {} if request.mode.reads_only else {site: {"4g": run}})
    return results


def _converge_unit(
    host: Host, request: Request, store: runs.Store, journal: runs.Recorder, channel: EventStream
) -> LteResult:
    # Most runs have no unit, and the console with its libraries takes a tenth of a second in each task.

    assert isinstance(host.device, LteRouter)  # noqa: S101 - `is_other_lte_unit` is true
    unit = LteUnit(
        host,
        host.device,
        store,
        channel.event,
        is_rehearsal=request.rehearsed,
        target=request.targets.get(host.name) if request.rehearsed else None,
    )
    turn = UnitConvergence(
        unit,
        journal,
        plan_only=request.mode is Mode.PLAN,
        approved_hash=None if request.plans is None else request.plans.get(host.name, ""),
        patience=_REHEARSAL_PATIENCE if request.rehearsed else UnitPatience(),
    )
    try:
        return turn.run()
    except Exception as fault:  # noqa: BLE001 - a fault of ours on one unit must not hide what became of the others
        problem = report_crash(fault, request.command, lambda: request.state)
        return LteResult(
            name=host.name, status=Status.UNKNOWN, exit=problem.exit, message=str(problem), hint=problem.hint
        )


def _journal(
    inventory: Inventory, site: str, units: Sequence[Host], request: Request, store: runs.Store
) -> runs.Journal:
    if request.mode is Mode.RESUME and request.run is not None:
        record = runs.RunResume(revision=inventory.revision, tool=__version__, command=request.command)
        return store.resume(site, request.run, record)
    return store.start(
        runs.RunStart(
            site=site,
            revision=inventory.revision,
            tool=__version__,
            hosts=tuple(host.name for host in units),
            rehearsed=request.rehearsed,
            command=request.command,
        )
    )


def _host_result(result: LteResult) -> dict[str, Any]:
    fine = result.exit in FINE
    message = msg(f"{arg(result.message)} ({arg(result.hint)})") if result.hint else result.message
    diff = msg(f"{arg(result.name)}:\n{arg(result.diff)}" if result.diff else "")
    has_changed = bool(result.planned_actions) and result.exit in (errors.ExitCode.DONE, errors.ExitCode.CHANGES)
    return {**result.as_dict(), "ok": fine, "changed": has_changed, "message": message, "shown": diff}
