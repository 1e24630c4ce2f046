"""Bring one 4G unit to what is declared of its SIM, or only check it; what is told as done was read back."""

from __future__ import annotations

import hashlib
import json
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers.lte import Registration, rutos_client, rutos_settings
from atlantis_netcfg.bearers.lte.judge import quality
from atlantis_netcfg.console.types import ConsoleLost, ConsoleUnreachable
from atlantis_netcfg.core.errors import DeviceFailed, ExitCode, NetcfgError, complete
from atlantis_netcfg.core.events import Event, Stage
from atlantis_netcfg.core.verdicts import Verdict
from atlantis_netcfg.declaration.model import LteDriver
from atlantis_netcfg.journal import ActionsConfirmed, LayerSent, Outcome, Planned, PlannedAction, conclude, unrecorded
from atlantis_netcfg.operations.lte.unit import FINE, LteResult, NotRehearsed, words
from atlantis_netcfg.routeros.apply import Status

if TYPE_CHECKING:
    from atlantis_netcfg.bearers.lte.rutos_settings import Change
    from atlantis_netcfg.console.ssh import Commands
    from atlantis_netcfg.journal import Recorder
    from atlantis_netcfg.operations.lte.unit import Look, Unit


@dataclass(frozen=True, slots=True)
class Patience:
    """How long a unit may take to come back into its network after its settings were reloaded, in seconds."""

    settle_s: float = 120.0
    poll_s: float = 5.0


@dataclass(frozen=True, slots=True)
class Came:
    """What has become of the settings."""

    found: tuple[Change, ...] = ()
    done: bool = False
    held: str | None = None
    commands: int = 0
    taken_back: bool = False
    """The PIN was refused, and the unit does not hold it any more."""

    @property
    def hash(self) -> str:
        """Of what a person sees of the plan."""
        return hashlib.sha256(json.dumps([(one.line, one.removed) for one in self.found]).encode()).hexdigest()

    @property
    def diff(self) -> str:
        """What would be set, as a difference."""
        rows = ((f"- {one.removed}\n" if one.removed else "") + f"+ {one.line}\n" for one in self.found)
        return "".join(rows)


LAYER = "uci"
_TOUCHED = ("proto", "sim", "apn", "auto_apn", "auth", "username", "position", "deny_roaming")
_SECRET = ("password", "pincode")


def sections_of(shell: Commands) -> dict[tuple[str, str], dict[str, str]]:
    """The unit's configuration, by package and section. Raises SettingRefused, ConsoleLost."""
    end = shell.run(rutos_settings.SHOW)
    if end.code:
        said = (end.error.strip() or f"exit status {end.code}").splitlines()[0]
        raise rutos_settings.SettingRefused(
            f"the unit's configuration cannot be read over SSH: {said}",
            hint="is `admin_user` one who may log in over SSH, and is this a Teltonika unit?",
        )
    return rutos_settings.parse_show(end.out)


def masked(sections: dict[tuple[str, str], dict[str, str]]) -> str:
    """The configuration of before as far as a run may change it, secrets masked; other people's stands beside it."""
    return "".join(
        f"{package}.{section}.{option}='{'********' if option in _SECRET else value}'\n"
        for (package, section), options in sections.items()
        for option, value in options.items()
        if option in (*_TOUCHED, *_SECRET)
    )


def planned_action(number: int, one: Change) -> PlannedAction:
    """One setting as the journal holds it."""
    value = "********" if one.secret else one.value
    return PlannedAction(
        number=number,
        layer=LAYER,
        menu=f"{one.package}.{one.section}",
        verb="set",
        subject=one.option,
        values=((one.option, value),),
    )


_WORST = (Verdict.ERROR, Verdict.FAIL)
_SETTLED = (
    Registration.DENIED,
    Registration.SIM_MISSING,
    Registration.SIM_PIN_REQUIRED,
    Registration.SIM_PUK_REQUIRED,
    Registration.DISABLED,
)
"""States in which waiting for the network is in vain."""
_FINAL = "roaming-not-allowed"
"""The judge's word for a card that is in a network and will get no data there."""


class Converge:
    """One unit's turn in a run."""

    def __init__(
        self, unit: Unit, journal: Recorder, *, plan_only: bool, agreed: str | None, patience: Patience
    ) -> None:
        self._unit = unit
        self._journal = journal
        self._plan_only = plan_only
        self._agreed = agreed
        self._patience = patience
        self._touched = False

    def run(self) -> LteResult:
        """Look, set what differs, look again; whatever goes wrong is in the result. Faults of ours are raised."""
        began = time.monotonic()
        try:
            result = self._run()
        except NotRehearsed as nothing:
            result = LteResult(
                name=self._unit.name, status=Status.UNCHANGED, exit=ExitCode.NOTHING, message=str(nothing)
            )
        except NetcfgError as error:
            result = self._failed(error, Status.UNKNOWN if self._touched else Status.LEFT_AS_FOUND)
        result = replace(result, seconds=time.monotonic() - began)
        self._tell(Stage.DONE if result.exit in FINE else Stage.FAILED, result.message)
        outcome = Outcome(device=result.name, status=result.status.value, exit=int(result.exit), message=result.message)
        return unrecorded(result, conclude(self._journal, outcome))

    def _run(self) -> LteResult:
        self._tell(Stage.CONNECTING, f"driver {self._unit.device.driver}")
        look = self._unit.look()
        self._tell(Stage.OBSERVED, look.reading.state.value.replace("_", " "))
        if not self._unit.may_set:
            return self._told(look, Came())
        came = self._set(look)
        if came.done:
            try:
                look = self._settled(look)
                came = self._taken_back(look, came)
            except DeviceFailed as silent:
                return self._silent(look, came, silent)
        if not self._plan_only and look.reading.state is not Registration.SIM_PIN_REQUIRED:
            self._unit.tried.forget()
        return self._told(look, came)

    def _set(self, look: Look) -> Came:
        unit, wanted = self._unit, self._unit.settings
        with unit.shell() as shell:
            sections = sections_of(shell)
            held = rutos_settings.pin_held(look.reading, wanted, sections, tried=unit.tried.why_not)
            if held is not None:
                return Came(held=held, commands=shell.count)
            came = Came(rutos_settings.changes(look.reading, wanted, sections), commands=shell.count)
            self._tell(Stage.PLANNED, f"{len(came.found)} settings differ")
            if self._plan_only or not came.found:
                return came
            if self._agreed is not None and self._agreed != came.hash:
                raise DeviceFailed(
                    f"{unit.name}: what differs is no longer what was agreed to, so nothing was set",
                    hint="run it again and look at the plan",
                )
            self._write(shell, came, sections)
            return replace(came, done=True, commands=shell.count)

    def _write(self, shell: Commands, came: Came, sections: dict[tuple[str, str], dict[str, str]]) -> None:
        """Write and read back. What is about to be done is on disk before it is done. Raises DeviceFailed."""
        name, numbers = self._unit.name, tuple(range(1, len(came.found) + 1))
        self._journal.save(name, masked(sections))
        actions = tuple(planned_action(number, one) for number, one in zip(numbers, came.found, strict=True))
        self._journal.write(Planned(device=name, plan=came.hash, actions=actions))
        if any(one.option == rutos_settings.PIN for one in came.found):
            self._unit.tried.remember()
        self._journal.write(LayerSent(device=name, layer=LAYER, actions=numbers))
        self._touched = True
        self._tell(Stage.APPLYING, f"{len(numbers)} settings")
        said = shell.run(rutos_settings.WRITE, given=rutos_settings.batch(came.found)).error.strip()
        # A unit whose network reloads may drop the session: a new one tells what has come of it.
        with suppress(ConsoleLost):
            shell.run(rutos_settings.RELOAD)
        self._tell(Stage.VERIFYING, "reading back in a new session")
        now = self._read_back()
        kept = [one for one in came.found if now.get((one.package, one.section), {}).get(one.option) == one.value]
        if len(kept) != len(came.found):
            self._touched = bool(kept)
            lost = next(one for one in came.found if one not in kept)
            raise DeviceFailed(
                f"{name}: {len(kept)} of {len(came.found)} settings were kept; not kept: {lost.package}.{lost.section}."
                f"{lost.option}{f' ({said.splitlines()[0]})' if said else ''}",
                hint="is the unit's flash full, or its configuration locked? Look at its own page",
            )
        self._journal.write(ActionsConfirmed(device=name, actions=numbers))
        self._touched = False

    def _read_back(self) -> dict[tuple[str, str], dict[str, str]]:
        """Read in a new session, as soon as one comes about. Raises DeviceFailed."""
        until = time.monotonic() + self._patience.settle_s
        while True:
            try:
                with self._unit.shell() as fresh:
                    return sections_of(fresh)
            except (ConsoleLost, ConsoleUnreachable):
                if time.monotonic() > until:
                    raise
                time.sleep(self._patience.poll_s)

    def _taken_back(self, look: Look, came: Came) -> Came:
        """Take a PIN that the SIM has refused back from the unit, which would try it again at its next start."""
        wrong = next((one for one in came.found if one.option == rutos_settings.PIN), None)
        if wrong is None or look.reading.state is not Registration.SIM_PIN_REQUIRED:
            return came
        with self._unit.shell() as shell:
            shell.run(rutos_settings.WRITE, given=rutos_settings.removal(wrong))
            if rutos_settings.PIN in sections_of(shell).get((wrong.package, wrong.section), {}):
                raise DeviceFailed(
                    f"{self._unit.name}: the unit keeps the PIN that the SIM has refused, and would try it again",
                    hint="remove the PIN on the unit's own page before it starts again",
                )
            return replace(came, taken_back=True, commands=came.commands + shell.count)

    def _settled(self, before: Look) -> Look:
        """Look until the unit is in its network with a connection, or waiting is in vain."""
        until = time.monotonic() + self._patience.settle_s
        requests, sent, received = before.requests, before.sent, before.received
        while True:
            look = self._again()
            requests, sent, received = requests + look.requests, sent + look.sent, received + look.received
            quiet = not any(finding.verdict in _WORST for finding in look.findings)
            final = any(finding.code == _FINAL for finding in look.findings)
            if quiet or final or look.reading.state in _SETTLED or time.monotonic() > until:
                return replace(look, requests=requests, sent=sent, received=received)
            self._tell(Stage.WAITING, look.reading.state.value.replace("_", " "))
            time.sleep(self._patience.poll_s)

    def _again(self) -> Look:
        """The settings are read back and kept by now: a unit that reloads may be silent for a moment."""
        until = time.monotonic() + self._patience.settle_s
        while True:
            try:
                return self._unit.look()
            except rutos_client.RutosUnreachable:
                if time.monotonic() > until:
                    raise
                time.sleep(self._patience.poll_s)

    def _silent(self, before: Look, came: Came, silent: DeviceFailed) -> LteResult:
        """The settings are kept, and the unit has not answered since."""
        message = f"{len(came.found)} settings read back and kept; since then: {silent}"
        told = self._told(before, came)
        return replace(told, exit=ExitCode.CHECKS_FAILED, message=message, hint=silent.hint, findings=(), notes=())

    def _told(self, look: Look, came: Came) -> LteResult:
        worst = next((one for one in look.findings if one.verdict in _WORST), None)
        others = tuple(words(one) for one in look.findings if one is not worst)
        status, code, message = self._outcome(look, came)
        hint = None
        if worst is not None:
            message, hint = f"{message}; {worst.message}", worst.hint
            code = ExitCode.CHECKS_FAILED if code is ExitCode.DONE else code
        if came.held is not None:
            message = f"left as found, nothing was set: {came.held}"
        return LteResult(
            name=self._unit.name,
            status=status,
            exit=code,
            message=message,
            hint=hint,
            planned=len(came.found),
            confirmed=len(came.found) - came.taken_back if came.done else 0,
            diff=came.diff,
            notes=(*others, *self._unset()),
            plan_hash=came.hash,
            findings=look.findings,
            quality=quality(look.reading),
            requests=look.requests + came.commands,
            sent=look.sent,
            received=look.received,
            serial=look.serial,
        )

    def _outcome(self, look: Look, came: Came) -> tuple[Status, ExitCode, str]:
        if came.held is not None:
            return Status.LEFT_AS_FOUND, ExitCode.FAILED, came.held
        said = _state(look)
        if came.done:
            kept = f"{len(came.found) - came.taken_back} settings read back and kept"
            back = ", the PIN taken back" if came.taken_back else ""
            return Status.CHANGED, ExitCode.DONE, f"{kept}{back}; {said}"
        if came.found:
            return Status.PLANNED, ExitCode.CHANGES, f"{len(came.found)} settings would be set; {said}"
        if self._unit.device.driver is LteDriver.MANUAL:
            return Status.UNCHANGED, ExitCode.NOTHING, "not checked: only a person can look at this 4G unit"
        if self._unit.may_set:
            return Status.UNCHANGED, ExitCode.DONE, f"as declared, nothing was changed; {said}"
        return Status.UNCHANGED, ExitCode.DONE, f"checked only; {said}"

    def _unset(self) -> tuple[str, ...]:
        """What a person should know of how far the driver goes."""
        driver, sim = self._unit.device.driver, self._unit.device.sim
        if driver is LteDriver.RUTOS and not self._unit.may_set:
            return ("no `admin_user` is declared under `access`: the SIM's settings are compared, and not set",)
        if driver is LteDriver.RUTOS and sim.bands:
            return ("bands are compared with the band in use, and not set: the unit's own page sets them",)
        if driver in (LteDriver.AT, LteDriver.MODEMMANAGER):
            return (f"driver {driver} reads only: the SIM's settings are compared, and not set",)
        return ()

    def _failed(self, error: NetcfgError, status: Status) -> LteResult:
        code = ExitCode.UNKNOWN if status is Status.UNKNOWN else error.exit
        hint = error.hint and complete(error.hint, site=self._unit.host.site, device=self._unit.name)
        return LteResult(name=self._unit.name, status=status, exit=code, message=str(error), hint=hint)

    def _tell(self, stage: Stage, message: str) -> None:
        self._unit.notify(Event(self._unit.name, stage, message))


def _state(look: Look) -> str:
    """Where the unit is, in a few words."""
    reading = look.reading
    said = reading.state.value.replace("_", " ")
    network = " ".join(word for word in (reading.operator, reading.access_tech, reading.band) if word)
    return f"{said} ({network})" if network else said
