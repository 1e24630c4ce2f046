"""Run first contact: check the device, type the planned steps, verify the new access before removing the old."""

from __future__ import annotations

import time
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from atlantis_netcfg import runs
from atlantis_netcfg.core import errors, events
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros.console import types
from atlantis_netcfg.routeros.first_contact.steps import (
    CERTIFICATE,
    FACTORY_USER,
    AdoptionOutcome,
    AdoptionStatus,
    AdoptionStep,
    AdoptionTarget,
    BoxFacts,
    ConsoleRoute,
    ConsoleRoutes,
    DeviceState,
    clear,
    close_door,
    fingerprint,
    foreign,
    look,
    prepare,
    recognise,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.routeros.rsc import Export


class PreflightError(errors.DeviceError):
    """The device cannot reach the desired state; nothing was changed. `errors` lists all reasons."""

    def __init__(self, objections: Sequence[Objection]) -> None:
        super().__init__(join("; ", (item.message for item in objections)))
        self.errors = tuple(errors.DeviceError(objection.message, hint=objection.hint) for objection in objections)


class NotFactoryFresh(errors.DeviceError):
    """The device was already configured by somebody; nothing was changed."""


class StillToMove(errors.DeviceError):
    """Everything is ready and the old access still works, but the new one is not in use yet."""


class AdoptionIncomplete(errors.DeviceError):
    """The device did not reach the adopted state although every command was accepted."""


class CutOff(errors.OutcomeUnknown):
    """The connection was lost during first contact, which may be repeated."""


OLDEST = Version(6, 49)
_SPLIT = Version(7, 13)
_RADIO_PACKAGES = ("wireless", "wifi-qcom", "wifi-qcom-ac", "wifi-mediatek", "wifi")
ACTIVATION_MINUTES = 5
"""`activation-timeout` of `/system/device-mode/update`: the button must be pressed within this time."""

_ROWS = {
    "/system/scheduler": "scheduler",
    "/ip/hotspot": "hotspot",
    "/ip/ipsec/peer": "ipsec",
    "/interface/l2tp-client": "l2tp",
    "/interface/pptp-client": "pptp",
    "/container": "container",
    "/zerotier/interface": "zerotier",
}
_SERVICES = {
    "/ip/proxy": "proxy",
    "/ip/socks": "socks",
    "/ip/smb": "smb",
    "/tool/romon": "romon",
    "/tool/bandwidth-server": "bandwidth-test",
    "/interface/l2tp-server/server": "l2tp",
    "/interface/pptp-server/server": "pptp",
}


@dataclass(frozen=True, slots=True)
class Objection:
    """Why first contact is not possible, and what the user can do."""

    message: str
    hint: str


def features_of(desired_export: Export) -> dict[str, str]:
    """Return the device-mode features that a desired text needs, each with the menu that needs it."""
    features: dict[str, str] = {}
    for statement in desired_export.statements:
        values = dict(statement.values)
        if statement.verb == "add" and statement.menu in _ROWS and values.get("disabled") != "yes":
            features.setdefault(_ROWS[statement.menu], statement.menu)
        if statement.menu in _SERVICES and values.get("enabled") == "yes":
            features.setdefault(_SERVICES[statement.menu], statement.menu)
    return features


def objections(facts: BoxFacts, target: AdoptionTarget) -> tuple[Objection, ...]:
    """Return all objections together, so that one trip to the device is enough."""
    return (*_box(facts, target), *_software(facts, target), *_device_mode(facts, target))


def _box(facts: BoxFacts, target: AdoptionTarget) -> Iterator[Objection]:
    model, board = (target.model or "").lower(), facts.board.lower()
    if model and board and model not in board and board not in model:
        yield Objection(
            msg(
                f"{arg(target.name)} is a {arg(target.model)} in the inventory, but this is a {arg(facts.board)} "
                f"({arg(facts.architecture)})"
            ),
            "connect to the right device, or correct `model` in its host_vars file",
        )
    ports = {row.get("default-name") or row.get("name", "") for row in facts.ethernets}
    missing = [port for port in target.ports if port not in ports]
    if missing:
        yield Objection(
            msg(
                f"{arg(target.name)} has ports in the inventory that this {arg(facts.board or 'box')} does not have: "
                f"{arg(join(', ', missing))}"
            ),
            msg(
                f"it has {arg(join(', ', sorted(ports)))}; correct `ports` in its host_vars file, or use the right "
                "device"
            ),
        )


def _software(facts: BoxFacts, target: AdoptionTarget) -> Iterator[Objection]:
    if facts.version < OLDEST:
        yield Objection(
            msg(f"RouterOS {arg(facts.version)} is too old: adoption needs {arg(OLDEST)} or later"),
            msg(
                f"first upgrade it in Winbox (System > Packages) with the {arg(facts.architecture)} files of a newer "
                "version"
            ),
        )
    if target.radio and facts.version >= _SPLIT and not set(_RADIO_PACKAGES) & set(facts.packages):
        yield Objection(
            msg(
                f"RouterOS {arg(facts.version)} on this {arg(facts.board)} has no package for its radio: since 7.13 "
                "`wireless` is a separate package"
            ),
            msg(
                f"upload wireless-{arg(facts.version)}-{arg(facts.architecture)}.npk (or wifi-qcom, depending on its "
                "radio) in Winbox (Files), reboot the device, then run this command again"
            ),
        )


def _device_mode(facts: BoxFacts, target: AdoptionTarget) -> Iterator[Objection]:
    mode = facts.device_mode
    if mode is None:
        return
    mode_name = mode.get("mode", "unknown")
    forbidden = [name for name in target.features if mode.get(name) in ("false", "no")]
    if mode.get("flagged") in ("true", "yes"):
        yield Objection(
            "device-mode has flagged this router: it suspects that somebody has tampered with its configuration",
            msg(f"review its configuration; then {arg(_device_mode_hint('flagged=no'))}"),
        )
    if forbidden:
        menus = join(", ", (msg(f"{arg(name)} (for {arg(target.features[name])})") for name in forbidden))
        yield Objection(
            msg(f"device-mode `{arg(mode_name)}` of this router forbids what {arg(target.name)} needs: {arg(menus)}"),
            _device_mode_hint(" ".join(f"{name}=yes" for name in forbidden)),
        )


def _device_mode_hint(change: str) -> str:
    return msg(
        f"type on its console:  /system device-mode update {arg(change)} "
        f"activation-timeout={arg(ACTIVATION_MINUTES)}m\nwithin {arg(ACTIVATION_MINUTES)} minutes press its reset or "
        "mode button once, briefly, or unplug its power and plug it in again\nthe router restarts with the new mode; "
        "then run this command again"
    )


@contextmanager
def repeatable(target: AdoptionTarget) -> Iterator[None]:
    """Add to any lost connection the hint that the same command continues."""
    try:
        yield
    except types.ConsoleLost as lost:
        raise CutOff(
            f"{arg(target.name)}: {arg(lost)}",
            hint="run the same command again: first contact continues where it stopped",
        ) from lost
    except types.HostKeyMismatch as changed:
        raise types.HostKeyMismatch(
            msg(
                f"{arg(target.name)}: the SSH host key is not the one pinned at first contact; pinned "
                f"{arg(changed.pinned_key)}, presented {arg(changed.actual_key)}"
            ),
            pinned_key=changed.pinned_key,
            actual_key=changed.actual_key,
            hint=(
                "this is another device, or somebody intercepts the connection: no password was sent\nif the "
                "device was replaced, or reset on purpose: run the same command with --replaced"
            ),
        ) from changed
    except types.SafeModeHeld as unavailable:
        raise errors.DeviceError(
            f"{arg(target.name)}: somebody else holds safe mode on the device",
            hint="a lost session releases it after about 9 minutes; then run the same command again",
        ) from unavailable


def cut_off(target: AdoptionTarget, step: AdoptionStep, error: types.ConsoleLost) -> CutOff:
    """Return the error for a connection lost in this step."""
    hint = "run the same command again: first contact continues where it stopped"
    if step.key == "management":
        hint = msg(
            f"if the laptop is plugged into {arg(target.port)}, use another port (not the first, which is for the "
            "internet): this one is leaving the factory network. Wait up to 9 minutes until the router has undone "
            "the change, then run the same command again"
        )
    return CutOff(f"{arg(target.name)}: connection lost at: {arg(step.title)} ({arg(error)})", hint=hint)


def not_fresh(target: AdoptionTarget, facts: BoxFacts) -> NotFactoryFresh:
    """Return the error that lists foreign configuration, and how to adopt the device nevertheless."""
    foreign_items = foreign(facts, target)
    rest = msg(f", and {arg(len(foreign_items) - 5)} more" if len(foreign_items) > 5 else "")  # noqa: PLR2004 - what a person takes in
    return NotFactoryFresh(
        f"this device ({arg(facts.board)}) is not in its factory state, so it was not changed; it already has: "
        f"{arg(join(', ', foreign_items[:5]))}{arg(rest)}",
        hint=(
            f"if it is to become {arg(target.name)}: the same command with --take-over saves its configuration first, "
            "then continues"
        ),
    )


def still_to_move(target: AdoptionTarget, error: errors.NetcfgError) -> StillToMove:
    """Return the error that tells where to plug in the laptop."""
    return StillToMove(
        f"no response from {arg(target.host)} ({arg(error)}); the router still has its default configuration and can "
        "be reached at both addresses",
        hint=(
            f"plug the laptop into {arg(target.port)}, give it the address {arg(target.laptop)}, then run the same "
            "command again: it continues from here"
        ),
    )


GUARDED_LINES = 80
"""Actions in one safe mode: after the 100th a session silently leaves it (Manual, Configuration Management)."""
_HELD_S = 30.0
"""Maximum seconds to wait for safe mode: a lost session holds it until the device has undone its changes."""
_RETRY_S = 0.5


@dataclass(frozen=True, slots=True)
class ConsoleExecutor:
    """Types the steps; makes no decisions."""

    target: AdoptionTarget
    journal: runs.Recorder
    notify: events.Subscriber

    def do(self, steps: Sequence[AdoptionStep], console: types.Console, *, in_safe_mode: bool = False) -> None:
        """Type every line of every step. `in_safe_mode`: already held. Raises CutOff, ConsoleCommandError."""
        for step in steps:
            self.journal.write(runs.ContactStep(device=self.target.name, step=step.key, commands=len(step.lines)))
            self.notify(events.Event(self.target.name, events.Stage.APPLYING, step.title))
            try:
                self._type(step, console, is_guarded=step.is_guarded and not in_safe_mode)
            except types.ConsoleLost as lost:
                raise cut_off(self.target, step, lost) from lost
            self.journal.write(runs.ContactStepDone(device=self.target.name, step=step.key))

    def _type(self, step: AdoptionStep, console: types.Console, *, is_guarded: bool) -> None:
        size = GUARDED_LINES if is_guarded else len(step.lines)
        for start in range(0, len(step.lines), size):
            with safe(console) if is_guarded else nullcontext():
                for line in step.lines[start : start + size]:
                    console.run(line.text, timeout_s=line.timeout_s, secrets=line.secrets)


@contextmanager
def safe(console: types.Console) -> Iterator[None]:
    """Hold safe mode: release it on success, else end the session so that the device undoes the changes."""
    deadline = time.monotonic() + _HELD_S
    while True:
        try:
            console.take_safe_mode()
            break
        except types.SafeModeHeld:
            if time.monotonic() > deadline:
                raise
            time.sleep(_RETRY_S)
    yield
    console.release_safe_mode()


_PAUSE_S = 0.5
_STICKER = msg(
    f"the password of {arg(FACTORY_USER)} is on the device's sticker, or empty on older devices; type it when "
    "asked, or pass a file with it: password-file=FILE\nif the password is unknown: hold the reset button "
    "while switching the power on until the light blinks, then release it"
)


@dataclass(slots=True)
class FirstContact:
    """First contact with one device. Every step is journalled before it is typed, and may be repeated."""

    target: AdoptionTarget
    routes: ConsoleRoutes
    pins: runs.Pins
    journal: runs.Recorder
    notify: events.Subscriber
    factory_passwords: Callable[[], Iterator[Secret]]
    """Returns candidate passwords of the factory user, requested only as far as needed."""
    take_over: bool = False
    wait_s: float = 600.0
    """Seconds to wait for the laptop on the management port."""
    now: Callable[[], datetime] = field(default=lambda: datetime.now(UTC))
    _has_known_key: bool = False
    """Whether the SSH host key of the device was known before this run."""

    @property
    def _executor(self) -> ConsoleExecutor:
        return ConsoleExecutor(self.target, self.journal, self.notify)

    def plan(self) -> AdoptionOutcome:
        """Read, check, and return the steps; nothing is changed or pinned."""
        with repeatable(self.target), self._console(None) as (console, _):
            facts, state = self._judge(console)
        if state is DeviceState.ADOPTED:
            return AdoptionOutcome(AdoptionStatus.ALREADY, state, facts=facts)
        return AdoptionOutcome(AdoptionStatus.PLANNED, state, self._titles(facts), facts=facts)

    def adopt(self, agree: Callable[[AdoptionOutcome], None]) -> AdoptionOutcome:
        """Bring the device to the adopted state; `agree` raises if the user rejects the steps.

        Raises DeviceError (the device is unchanged, or a repeated run continues from there) and CutOff.
        """
        with repeatable(self.target):
            return self._adopt(agree)

    def _adopt(self, agree: Callable[[AdoptionOutcome], None]) -> AdoptionOutcome:
        with self._console(None) as (console, route):
            facts, device_state = self._judge(console)
            self._tell(
                events.Stage.OBSERVED, msg(f"{arg(facts.board)}, RouterOS {arg(facts.version)}, {arg(device_state)}")
            )
            if device_state is DeviceState.ADOPTED:
                return self._already_adopted(console, facts)
            if not route.serial and not self._has_known_key:
                self._tell(events.Stage.OBSERVED, msg(f"its SSH host key is {arg(self.routes.host_key)}"))
            plan = AdoptionOutcome(AdoptionStatus.PLANNED, device_state, self._titles(facts), facts=facts)
            agree(plan)
            state = facts.text if facts.text.endswith("\n") else f"{facts.text}\n"
            self.journal.save(self.target.name, state)
            self._record_host_key()
            self._prepare(console)
            pin = self._pin(console)
            by_factory = console.user != self.target.user
        notes: list[str] = []
        if by_factory:
            self._let_in(route)
        final = route if route.serial else self._move(route, pin, notes)
        with self._console(final) as (console, _):
            self._clear(console, final, pin)
            self._executor.do(close_door(look(console), self.target), console)
            facts = self._check_adoption(look(console))
        if final.serial:
            self._from_afar(pin, notes)
        return AdoptionOutcome(AdoptionStatus.ADOPTED, device_state, plan.steps, tuple(notes), facts)

    # --- looking ---------------------------------------------------------------------------------------------------

    def _judge(self, console: types.Console) -> tuple[BoxFacts, DeviceState]:
        facts = look(console)
        self._record_observation(facts)
        state = recognise(facts, self.target, self.now())
        if state is not DeviceState.ADOPTED:
            if reasons := objections(facts, self.target):
                raise PreflightError(reasons)
            if state is DeviceState.SOMEONES and not self.take_over:
                raise not_fresh(self.target, facts)
        return facts, state

    def _record_observation(self, facts: BoxFacts) -> None:
        identity = next(
            (dict(statement.values) for statement in facts.export.statements if statement.menu == "/system/identity"),
            {},
        )
        self.journal.write(
            runs.DeviceObservation(
                device=self.target.name, version=str(facts.version), identity=identity.get("name") or "", state=""
            )
        )

    def _titles(self, facts: BoxFacts) -> tuple[str, ...]:
        steps = [step.title for step in prepare(facts, self.target, self.now())]
        steps += [step.title for step in clear(facts)]
        return (*steps, *(step.title for step in close_door(facts, self.target)))

    # --- consoles --------------------------------------------------------------------------------------------------

    @contextmanager
    def _console(self, route: ConsoleRoute | None) -> Iterator[tuple[types.Console, ConsoleRoute]]:
        """Open a console on `route` as our user; without a route, on any route and as any accepted user."""
        if route is None:
            console, route = self._connect()
        else:
            console = route.open(self.target.user, self.target.password)
        try:
            yield console, route
        finally:
            console.close()

    def _connect(self) -> tuple[types.Console, ConsoleRoute]:
        """Connect where the technician plugged in; a known device may already be at its management address."""
        first, final = self.routes.first, self.routes.final
        self._has_known_key = self.routes.host_key is not None
        has_pin = self.pins.get(self.target.name) is not None
        if has_pin and not first.serial:
            with suppress(types.ConsoleUnreachable, types.ConsoleLoginError):
                return self._at_home(final), final
        self._tell(events.Stage.CONNECTING, msg(f"to {arg(first.label)}"))
        try:
            return self._log_in(first, ours_first=has_pin), first
        except types.ConsoleUnreachable:
            if has_pin or first.serial or first is final:
                raise
            with suppress(types.ConsoleUnreachable):
                return self._log_in(final, ours_first=True), final
            raise

    def _at_home(self, final: ConsoleRoute) -> types.Console:
        """Connect to the management address; an unknown host key is accepted if TLS has proved the device."""
        pin = self.pins.get(self.target.name)
        if self.routes.host_key is None and pin is not None:
            final.prove(pin)
        return final.open(self.target.user, self.target.password)

    def _log_in(self, route: ConsoleRoute, *, ours_first: bool) -> types.Console:
        """Log in; a device with an unconfirmed host key is sent the factory password, never ours."""
        is_trusted = route.serial or self._has_known_key
        if ours_first and is_trusted:
            with suppress(types.ConsoleLoginError):
                return route.open(self.target.user, self.target.password)
        for password in self.factory_passwords():
            with suppress(types.ConsoleLoginError):
                return route.open(FACTORY_USER, password)
        if not is_trusted:
            raise types.ConsoleLoginError(
                f"{arg(route.label)}: the device does not accept {arg(FACTORY_USER)}; its SSH host key is unknown "
                f"here, so the password of {arg(self.target.user)} was not tried",
                hint=(
                    f"if it was adopted on another computer: {arg(errors.TRUST)}, then run the same command "
                    f"again\n{arg(_STICKER)}"
                ),
            )
        try:
            return route.open(self.target.user, self.target.password)
        except types.ConsoleLoginError as failed:
            raise types.ConsoleLoginError(
                f"{arg(route.label)}: the device accepts neither {arg(FACTORY_USER)} nor {arg(self.target.user)}",
                hint=_STICKER,
            ) from failed

    def _let_in(self, route: ConsoleRoute) -> None:
        """Verify that our user can log in, before the factory user is disabled."""
        self._tell(events.Stage.VERIFYING, msg(f"user {arg(self.target.user)} logs in"))
        with self._console(route):
            return

    # --- typing ----------------------------------------------------------------------------------------------------

    def _prepare(self, console: types.Console) -> None:
        """Wait until no interrupted session holds safe mode, read again, then add what is missing."""
        with safe(console):
            pass
        self._executor.do(prepare(look(console), self.target, self.now()), console)

    def _clear(self, console: types.Console, route: ConsoleRoute, pin: str) -> None:
        """Remove the default configuration; a new session verifies the access before safe mode is released."""
        with safe(console):
            steps = clear(look(console))
            small = sum(len(step.lines) for step in steps) <= GUARDED_LINES
            if small:
                self._executor.do(steps, console, in_safe_mode=True)
                self._prove_route(route, pin)
        if not small:
            self._executor.do(steps, console)
            self._prove_route(route, pin)

    def _prove_route(self, route: ConsoleRoute, pin: str) -> None:
        if not route.serial:
            self._tell(events.Stage.VERIFYING, msg(f"api-ssl at {arg(route.label)}, in a new session"))
            route.prove(pin)

    # --- trust -----------------------------------------------------------------------------------------------------

    def _record_host_key(self) -> None:
        """Pin the SSH host key: from now on the device is ours."""
        key = self.routes.host_key
        if key is not None and self.pins.host_key(self.target.name) != key:
            self.pins.change_host_key(self.target.name, key)
            self._tell(events.Stage.CONNECTING, msg(f"its SSH host key is pinned: {arg(key)}"))

    def _pin(self, console: types.Console) -> str:
        """Pin the certificate as printed on the console, never as shown by TLS."""
        pin = fingerprint(console, CERTIFICATE)
        if not pin:
            raise AdoptionIncomplete(
                f"{arg(self.target.name)}: the device did not sign its certificate",
                hint="run the same command again",
            )
        if self.pins.get(self.target.name) != pin:
            self.pins.change(self.target.name, pin)
            self._tell(events.Stage.CONFIRMED, msg(f"its certificate is pinned: SHA-256 {arg(pin)}"))
        self.journal.write(runs.PinRecord(device=self.target.name, certificate=pin, host_key=self.routes.host_key))
        return pin

    def _already_adopted(self, console: types.Console, facts: BoxFacts) -> AdoptionOutcome:
        if self.pins.get(self.target.name) is None or self.pins.host_key(self.target.name) is None:
            self._record_host_key()
            self._pin(console)
        return AdoptionOutcome(AdoptionStatus.ALREADY, DeviceState.ADOPTED, facts=facts)

    # --- the new way -----------------------------------------------------------------------------------------------

    def _move(self, route: ConsoleRoute, pin: str, notes: list[str]) -> ConsoleRoute:
        """Continue over the management port as soon as the laptop is plugged in there."""
        final = self.routes.final
        if route is final:
            return final
        self._try_route(route, pin, notes)
        self._tell(
            events.Stage.WAITING,
            msg(
                f"now plug the laptop into {arg(self.target.port)}, with address {arg(self.target.laptop)}: the router "
                f"is at {arg(self.target.host)} from now on"
            ),
            self.wait_s,
        )
        deadline = time.monotonic() + self.wait_s
        while True:
            try:
                final.prove(pin)
            except errors.NetcfgError as error:
                if time.monotonic() > deadline:
                    raise still_to_move(self.target, error) from error
                time.sleep(_PAUSE_S)
            else:
                return final

    def _try_route(self, route: ConsoleRoute, pin: str, notes: list[str]) -> None:
        try:
            route.prove(pin)
        except errors.NetcfgError as error:
            notes.append(msg(f"api-ssl could not be tested at {arg(route.label)}: {arg(error)}"))

    def _from_afar(self, pin: str, notes: list[str]) -> None:
        """After a serial line, check whether the device is reachable over the network."""
        final = self.routes.final
        try:
            final.prove(pin)
            final.meet()
        except errors.NetcfgError:
            notes.append(
                msg(
                    f"not verified, because the laptop is on the serial line: that {arg(self.target.host)} responds on "
                    f"{arg(self.target.port)}; plug into {arg(self.target.port)} with address "
                    f"{arg(self.target.laptop)}, and `provision site=…` verifies it"
                )
            )
        self._record_host_key()

    def _check_adoption(self, facts: BoxFacts) -> BoxFacts:
        if recognise(facts, self.target, self.now()) is not DeviceState.ADOPTED:
            remaining_steps = join(", ", self._titles(facts)) or "no known step"
            raise AdoptionIncomplete(
                f"{arg(self.target.name)}: every command was accepted, but something is still to be done: "
                f"{arg(remaining_steps)}",
                hint="run the same command again; if the result is the same, check the device with Winbox",
            )
        return facts

    # --- words -----------------------------------------------------------------------------------------------------

    def _tell(self, stage: events.Stage, message: str, limit_s: float = 0.0) -> None:
        self.notify(events.Event(self.target.name, stage, message, limit_s=limit_s))
