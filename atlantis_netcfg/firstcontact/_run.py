"""The executor: opens consoles, types the planned steps, proves the new way before the old one goes."""

from __future__ import annotations

import time
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from typing import TYPE_CHECKING, Protocol

from atlantis_netcfg.console import ConsoleLost, ConsoleUnreachable, HostKeyChanged, LoginFailed, SafeModeHeld
from atlantis_netcfg.errors import DeviceFailed, NetcfgError
from atlantis_netcfg.events import Event, Stage, Subscriber
from atlantis_netcfg.firstcontact._errors import CutOff, NotFactoryFresh, PreflightRefused, StillToMove, TooMany
from atlantis_netcfg.firstcontact._preflight import objections
from atlantis_netcfg.firstcontact._read import fingerprint, look
from atlantis_netcfg.firstcontact._recognise import foreign, recognise
from atlantis_netcfg.firstcontact._steps import Step, clear, close_door, prepare
from atlantis_netcfg.firstcontact._wish import CERTIFICATE, FACTORY_USER, Facts, Standing, Wish
from atlantis_netcfg.journal import ContactStep, ContactStepDone, DeviceObserved, Pinned

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from atlantis_netcfg.console import Console
    from atlantis_netcfg.journal import Pins, Recorder
    from atlantis_netcfg.secret import Secret

__all__ = ["Adopted", "Doorway", "FirstContact", "Status", "Way"]

GUARDED_LINES = 80
"""Actions in one safe mode: after the 100th a session leaves it without a word (Manual, Configuration Management)."""
_HELD_S = 30.0
"""A session that was cut holds safe mode until the device has undone its changes."""
_PAUSE_S = 0.5
_SHORT_S = 5.0


class Way(Protocol):
    """A way to a device's console."""

    shown: str
    """As a person would say it: an address, or a serial line."""
    serial: bool

    def open(self, user: str, password: Secret) -> Console:
        """Log in. Raises ConsoleUnreachable, LoginFailed, HostKeyChanged, ConsoleLost."""

    def prove(self, pin: str) -> None:
        """Log in by api-ssl as our user, under this certificate alone. Raises NetcfgError."""


class Doorway(Protocol):
    """The two ways, and what is known of the device."""

    first: Way
    """Where the technician has plugged in."""
    final: Way
    """The management address."""

    @property
    def host_key(self) -> str | None:
        """The host key that the device has shown; None as long as nobody came by SSH."""


class Status(StrEnum):
    """How first contact ended."""

    ALREADY = "unchanged"
    PLANNED = "planned"
    ADOPTED = "changed"


@dataclass(frozen=True, slots=True)
class Adopted:
    """What came of it; `notes` say what nobody has verified, and what to do now."""

    status: Status
    standing: Standing
    steps: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    facts: Facts | None = None


@dataclass(slots=True)
class FirstContact:
    """First contact with one device. Every step is journalled before it is typed, and may be repeated."""

    wish: Wish
    doorway: Doorway
    pins: Pins
    journal: Recorder
    notify: Subscriber
    factory_passwords: Callable[[], Iterator[Secret]]
    """Passwords of the factory's user to be tried, asked for only as far as needed."""
    take_over: bool = False
    wait_s: float = 600.0
    """How long to wait for the laptop on the management port."""
    now: Callable[[], datetime] = field(default=lambda: datetime.now(UTC))

    def plan(self) -> Adopted:
        """Look, judge, and tell the steps; nothing is changed or pinned."""
        with self._repeatable(), self._console(None) as (console, _):
            facts, standing = self._judge(console)
        if standing is Standing.ADOPTED:
            return Adopted(Status.ALREADY, standing, facts=facts)
        return Adopted(Status.PLANNED, standing, self._titles(facts), facts=facts)

    def adopt(self, agree: Callable[[Adopted], None]) -> Adopted:
        """Bring the device to the adopted state; `agree` raises if a person does not want the steps.

        Raises DeviceFailed with the device as it was, or as far as a repeated run goes on from; CutOff.
        """
        with self._repeatable():
            return self._adopt(agree)

    def _adopt(self, agree: Callable[[Adopted], None]) -> Adopted:
        with self._console(None) as (console, way):
            facts, standing = self._judge(console)
            self._tell(Stage.OBSERVED, f"{facts.board}, RouterOS {facts.version}, {standing}")
            if standing is Standing.ADOPTED:
                return self._already(console, facts)
            planned = Adopted(Status.PLANNED, standing, self._titles(facts), facts=facts)
            agree(planned)
            state = facts.text if facts.text.endswith("\n") else f"{facts.text}\n"
            self.journal.save(self.wish.name, state)
            self._known()
            self._prepare(console)
            pin = self._pin(console)
            by_factory = console.user != self.wish.user
        notes: list[str] = []
        if by_factory:
            self._let_in(way)
        final = way if way.serial else self._move(way, pin, notes)
        with self._console(final) as (console, _):
            self._clear(console, final, pin)
            self._do(close_door(look(console), self.wish), console)
            facts = self._settled(look(console))
        if final.serial:
            self._from_afar(pin, notes)
        return Adopted(Status.ADOPTED, standing, planned.steps, tuple(notes), facts)

    # --- looking ---------------------------------------------------------------------------------------------------

    def _judge(self, console: Console) -> tuple[Facts, Standing]:
        facts = look(console)
        self._observed(facts)
        standing = recognise(facts, self.wish, self.now())
        if standing is not Standing.ADOPTED:
            if refused := objections(facts, self.wish):
                raise PreflightRefused(refused)
            if standing is Standing.SOMEONES and not self.take_over:
                raise self._not_fresh(facts)
        return facts, standing

    def _observed(self, facts: Facts) -> None:
        identity = next((dict(one.values) for one in facts.export.statements if one.menu == "/system/identity"), {})
        self.journal.write(
            DeviceObserved(
                device=self.wish.name, version=str(facts.version), identity=identity.get("name") or "", state=""
            )
        )

    def _not_fresh(self, facts: Facts) -> NotFactoryFresh:
        found = foreign(facts, self.wish)
        rest = f", and {len(found) - 5} more" if len(found) > 5 else ""  # noqa: PLR2004 - what a person takes in
        return NotFactoryFresh(
            f"this device ({facts.board}) is not factory-fresh, so it was not touched; "
            f"somebody has configured: {', '.join(found[:5])}{rest}",
            hint="if it is really to become "
            f"{self.wish.name}: the same command with --take-over saves its export first, then goes on",
        )

    def _titles(self, facts: Facts) -> tuple[str, ...]:
        steps = [step.title for step in prepare(facts, self.wish, self.now())]
        steps += [step.title for step in clear(facts)]
        return (*steps, *(step.title for step in close_door(facts, self.wish)))

    # --- consoles --------------------------------------------------------------------------------------------------

    @contextmanager
    def _console(self, way: Way | None) -> Iterator[tuple[Console, Way]]:
        """A console on `way` as our user; without a way: wherever and as whoever the device lets us in."""
        if way is None:
            console, way = self._entered()
        else:
            console = way.open(self.wish.user, self.wish.password)
        try:
            yield console, way
        finally:
            console.close()

    def _entered(self) -> tuple[Console, Way]:
        """Where the technician says; a device that was met before may be at its management address by now."""
        first, final = self.doorway.first, self.doorway.final
        met = self.pins.get(self.wish.name) is not None
        if met and not first.serial:
            with suppress(ConsoleUnreachable, LoginFailed):
                return final.open(self.wish.user, self.wish.password), final
        self._tell(Stage.CONNECTING, f"to {first.shown}")
        try:
            return self._tried(first, ours_first=met), first
        except ConsoleUnreachable:
            if met or first.serial or first is final:
                raise
            with suppress(ConsoleUnreachable):
                return self._tried(final, ours_first=True), final
            raise

    def _tried(self, way: Way, *, ours_first: bool) -> Console:
        if ours_first:
            with suppress(LoginFailed):
                return way.open(self.wish.user, self.wish.password)
        for password in self.factory_passwords():
            with suppress(LoginFailed):
                return way.open(FACTORY_USER, password)
        try:
            return way.open(self.wish.user, self.wish.password)
        except LoginFailed as failed:
            raise LoginFailed(
                f"{way.shown}: the device let in neither {FACTORY_USER} nor {self.wish.user}",
                hint=f"the password of {FACTORY_USER} is on the device's sticker, and empty on older devices; "
                "type it when asked, or name a file with it: password-file=FILE\n"
                "if nobody knows it: hold the reset button while the power comes on, until the light blinks, "
                "then let go",
            ) from failed

    def _let_in(self, way: Way) -> None:
        """Our user has to be seen to log in before the factory's is disabled."""
        self._tell(Stage.VERIFYING, f"user {self.wish.user} logs in")
        with self._console(way):
            return

    # --- typing ----------------------------------------------------------------------------------------------------

    def _prepare(self, console: Console) -> None:
        """Wait until no cut session holds safe mode any more, look again, then add what is missing."""
        with self._safe(console):
            pass
        self._do(prepare(look(console), self.wish, self.now()), console)

    def _clear(self, console: Console, way: Way, pin: str) -> None:
        """Remove the default configuration; a new session proves the way before safe mode lets it go for good."""
        with self._safe(console):
            steps = clear(look(console))
            small = sum(len(step.lines) for step in steps) <= GUARDED_LINES
            if small:
                self._do(steps, console, held=True)
                self._still_there(way, pin)
        if not small:
            self._do(steps, console)
            self._still_there(way, pin)

    def _still_there(self, way: Way, pin: str) -> None:
        if not way.serial:
            self._tell(Stage.VERIFYING, f"api-ssl at {way.shown}, in a new session")
            way.prove(pin)

    def _do(self, steps: Sequence[Step], console: Console, *, held: bool = False) -> None:
        for step in steps:
            self.journal.write(ContactStep(device=self.wish.name, step=step.key, commands=len(step.lines)))
            self._tell(Stage.APPLYING, step.title)
            try:
                self._type(step, console, guarded=step.guarded and not held)
            except ConsoleLost as lost:
                raise self._cut(step, lost) from lost
            self.journal.write(ContactStepDone(device=self.wish.name, step=step.key))

    def _type(self, step: Step, console: Console, *, guarded: bool) -> None:
        size = GUARDED_LINES if guarded else len(step.lines)
        for start in range(0, len(step.lines), size):
            with self._safe(console) if guarded else nullcontext():
                for line in step.lines[start : start + size]:
                    console.run(line.text, timeout_s=line.timeout_s, secrets=line.secrets)

    @contextmanager
    def _safe(self, console: Console) -> Iterator[None]:
        """Safe mode: released when all went well, else the session ends and the device undoes."""
        deadline = time.monotonic() + _HELD_S
        while True:
            try:
                console.take_safe_mode()
                break
            except SafeModeHeld:
                if time.monotonic() > deadline:
                    raise
                time.sleep(_PAUSE_S)
        yield
        console.release_safe_mode()

    # --- trust -----------------------------------------------------------------------------------------------------

    def _known(self) -> None:
        """Record the host key: from here on the device is ours."""
        key = self.doorway.host_key
        if key is not None and self.pins.host_key(self.wish.name) != key:
            self.pins.change_host_key(self.wish.name, key)
            self._tell(Stage.CONNECTING, f"its SSH host key is pinned: {key}")

    def _pin(self, console: Console) -> str:
        """Pin the certificate by what the console says: never by what TLS shows."""
        pin = fingerprint(console, CERTIFICATE)
        if not pin:
            raise TooMany(
                f"{self.wish.name}: the device has not signed its certificate",
                hint="run the same command again",
            )
        if self.pins.get(self.wish.name) != pin:
            self.pins.change(self.wish.name, pin)
            self._tell(Stage.CONFIRMED, f"its certificate is pinned: SHA-256 {pin}")
        self.journal.write(Pinned(device=self.wish.name, certificate=pin, host_key=self.doorway.host_key))
        return pin

    def _already(self, console: Console, facts: Facts) -> Adopted:
        if self.pins.get(self.wish.name) is None or self.pins.host_key(self.wish.name) is None:
            self._known()
            self._pin(console)
        return Adopted(Status.ALREADY, Standing.ADOPTED, facts=facts)

    # --- the new way -----------------------------------------------------------------------------------------------

    def _move(self, way: Way, pin: str, notes: list[str]) -> Way:
        """Go on over the management port as soon as somebody is plugged in there."""
        final = self.doorway.final
        if way is final:
            return final
        self._prove_here(way, pin, notes)
        self._tell(
            Stage.WAITING,
            f"now plug the laptop into {self.wish.port}, with address {self.wish.laptop}: "
            f"{self.wish.host} is where the router is from now on",
        )
        deadline = time.monotonic() + self.wait_s
        while True:
            try:
                final.prove(pin)
            except NetcfgError as error:
                if time.monotonic() > deadline:
                    raise self._still_to_move(error) from error
                time.sleep(_PAUSE_S)
            else:
                return final

    def _prove_here(self, way: Way, pin: str, notes: list[str]) -> None:
        try:
            way.prove(pin)
        except NetcfgError as error:
            notes.append(f"api-ssl could not be tried at {way.shown}: {error}")

    def _still_to_move(self, error: NetcfgError) -> StillToMove:
        return StillToMove(
            f"nobody answered at {self.wish.host} ({error}); the default configuration is still on the router, "
            f"which can be reached both ways",
            hint=f"plug the laptop into {self.wish.port}, give it the address {self.wish.laptop}, "
            "then run the same command again: it goes on from here",
        )

    def _from_afar(self, pin: str, notes: list[str]) -> None:
        try:
            self.doorway.final.prove(pin)
        except NetcfgError:
            notes.append(
                f"not verified, because the laptop is on the serial line: that {self.wish.host} answers on "
                f"{self.wish.port}; plug into {self.wish.port} with address {self.wish.laptop}, and "
                "`provision site=...` verifies it"
            )

    def _settled(self, facts: Facts) -> Facts:
        if recognise(facts, self.wish, self.now()) is not Standing.ADOPTED:
            left = ", ".join(self._titles(facts)) or "nothing that is known"
            raise TooMany(
                f"{self.wish.name}: every command was accepted, yet something is still to be done: {left}",
                hint="run the same command again; if it says the same, look at the device with Winbox",
            )
        return facts

    # --- words -----------------------------------------------------------------------------------------------------

    def _cut(self, step: Step, lost: ConsoleLost) -> CutOff:
        hint = "run the same command again: first contact goes on where it was cut"
        if step.key == "management":
            hint = (
                f"is the laptop plugged into {self.wish.port}? That port leaves the factory's network now: plug into "
                "another one (not the first, which is for the internet), wait up to 9 minutes until the router has "
                "taken the change back, then run the same command again"
            )
        return CutOff(f"{self.wish.name}: the connection was lost at: {step.title} ({lost})", hint=hint)

    @contextmanager
    def _repeatable(self) -> Iterator[None]:
        try:
            yield
        except ConsoleLost as lost:
            raise CutOff(
                f"{self.wish.name}: {lost}",
                hint="run the same command again: first contact goes on where it was cut",
            ) from lost
        except HostKeyChanged as changed:
            raise HostKeyChanged(
                f"{self.wish.name}: the SSH host key is not the one that was pinned at first contact; "
                f"pinned is {changed.pinned}, it showed {changed.seen}",
                pinned=changed.pinned,
                seen=changed.seen,
                hint="another device, or somebody in between: no password was sent to it\n"
                "if it is another box than before, or was reset on purpose: the same command with --replaced",
            ) from changed
        except SafeModeHeld as held:
            raise DeviceFailed(
                f"{self.wish.name}: somebody else holds safe mode on the device",
                hint="a session that was cut lets go after about 9 minutes; then run the same command again",
            ) from held

    def _tell(self, stage: Stage, message: str) -> None:
        self.notify(Event(self.wish.name, stage, message))
