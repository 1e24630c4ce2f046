"""The executor: opens consoles, types the planned steps, proves the new way before the old one goes."""

from __future__ import annotations

import time
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from atlantis_netcfg.bootstrap._adopted import Adopted, Status
from atlantis_netcfg.bootstrap._errors import PreflightRefused, Unfinished
from atlantis_netcfg.bootstrap._preflight import objections
from atlantis_netcfg.bootstrap._read import fingerprint, look
from atlantis_netcfg.bootstrap._steps import clear, close_door, prepare
from atlantis_netcfg.bootstrap.classify import recognise
from atlantis_netcfg.bootstrap.executor import GUARDED_LINES, Typist, safe
from atlantis_netcfg.bootstrap.messages import not_fresh, repeatable, still_to_move
from atlantis_netcfg.bootstrap.target import CERTIFICATE, FACTORY_USER, Facts, Standing, Wish
from atlantis_netcfg.console.types import ConsoleUnreachable, LoginFailed
from atlantis_netcfg.core.errors import TRUST, NetcfgError
from atlantis_netcfg.core.events import Event, Stage, Subscriber
from atlantis_netcfg.journal import DeviceObserved, Pinned

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from atlantis_netcfg.bootstrap._ways import Doorway, Way
    from atlantis_netcfg.console.types import Console
    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.journal import Pins, Recorder

__all__ = ["FirstContact"]

_PAUSE_S = 0.5
_STICKER = (
    f"the password of {FACTORY_USER} is on the device's sticker, and empty on older devices; "
    "type it when asked, or name a file with it: password-file=FILE\n"
    "if nobody knows it: hold the reset button while the power comes on, until the light blinks, "
    "then let go"
)


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
    _agreed: bool = False
    """Whether the SSH host key that the device has to show was known before this run."""

    @property
    def _typist(self) -> Typist:
        return Typist(self.wish, self.journal, self.notify)

    def plan(self) -> Adopted:
        """Look, judge, and tell the steps; nothing is changed or pinned."""
        with repeatable(self.wish), self._console(None) as (console, _):
            facts, standing = self._judge(console)
        if standing is Standing.ADOPTED:
            return Adopted(Status.ALREADY, standing, facts=facts)
        return Adopted(Status.PLANNED, standing, self._titles(facts), facts=facts)

    def adopt(self, agree: Callable[[Adopted], None]) -> Adopted:
        """Bring the device to the adopted state; `agree` raises if a person does not want the steps.

        Raises DeviceFailed with the device as it was, or as far as a repeated run goes on from; CutOff.
        """
        with repeatable(self.wish):
            return self._adopt(agree)

    def _adopt(self, agree: Callable[[Adopted], None]) -> Adopted:
        with self._console(None) as (console, way):
            facts, standing = self._judge(console)
            self._tell(Stage.OBSERVED, f"{facts.board}, RouterOS {facts.version}, {standing}")
            if standing is Standing.ADOPTED:
                return self._already(console, facts)
            if not way.serial and not self._agreed:
                self._tell(Stage.OBSERVED, f"it shows the SSH host key {self.doorway.host_key}")
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
            self._typist.do(close_door(look(console), self.wish), console)
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
                raise not_fresh(self.wish, facts)
        return facts, standing

    def _observed(self, facts: Facts) -> None:
        identity = next((dict(one.values) for one in facts.export.statements if one.menu == "/system/identity"), {})
        self.journal.write(
            DeviceObserved(
                device=self.wish.name, version=str(facts.version), identity=identity.get("name") or "", state=""
            )
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
        self._agreed = self.doorway.host_key is not None
        met = self.pins.get(self.wish.name) is not None
        if met and not first.serial:
            with suppress(ConsoleUnreachable, LoginFailed):
                return self._at_home(final), final
        self._tell(Stage.CONNECTING, f"to {first.shown}")
        try:
            return self._tried(first, ours_first=met), first
        except ConsoleUnreachable:
            if met or first.serial or first is final:
                raise
            with suppress(ConsoleUnreachable):
                return self._tried(final, ours_first=True), final
            raise

    def _at_home(self, final: Way) -> Console:
        """The management address; a host key that is not known yet is believed where TLS has proved the device."""
        pin = self.pins.get(self.wish.name)
        if self.doorway.host_key is None and pin is not None:
            final.prove(pin)
        return final.open(self.wish.user, self.wish.password)

    def _tried(self, way: Way, *, ours_first: bool) -> Console:
        """Whoever shows a host key that nobody has agreed to is told the factory's password, and never ours."""
        agreed = way.serial or self._agreed
        if ours_first and agreed:
            with suppress(LoginFailed):
                return way.open(self.wish.user, self.wish.password)
        for password in self.factory_passwords():
            with suppress(LoginFailed):
                return way.open(FACTORY_USER, password)
        if not agreed:
            raise LoginFailed(
                f"{way.shown}: the device does not let {FACTORY_USER} in; its SSH host key is not known here, so the "
                f"password of {self.wish.user} was not tried",
                hint=f"if it was adopted on another computer: {TRUST}, then type the same again\n{_STICKER}",
            )
        try:
            return way.open(self.wish.user, self.wish.password)
        except LoginFailed as failed:
            raise LoginFailed(
                f"{way.shown}: the device let in neither {FACTORY_USER} nor {self.wish.user}",
                hint=_STICKER,
            ) from failed

    def _let_in(self, way: Way) -> None:
        """Our user has to be seen to log in before the factory's is disabled."""
        self._tell(Stage.VERIFYING, f"user {self.wish.user} logs in")
        with self._console(way):
            return

    # --- typing ----------------------------------------------------------------------------------------------------

    def _prepare(self, console: Console) -> None:
        """Wait until no cut session holds safe mode any more, look again, then add what is missing."""
        with safe(console):
            pass
        self._typist.do(prepare(look(console), self.wish, self.now()), console)

    def _clear(self, console: Console, way: Way, pin: str) -> None:
        """Remove the default configuration; a new session proves the way before safe mode lets it go for good."""
        with safe(console):
            steps = clear(look(console))
            small = sum(len(step.lines) for step in steps) <= GUARDED_LINES
            if small:
                self._typist.do(steps, console, held=True)
                self._still_there(way, pin)
        if not small:
            self._typist.do(steps, console)
            self._still_there(way, pin)

    def _still_there(self, way: Way, pin: str) -> None:
        if not way.serial:
            self._tell(Stage.VERIFYING, f"api-ssl at {way.shown}, in a new session")
            way.prove(pin)

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
            raise Unfinished(
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
                    raise still_to_move(self.wish, error) from error
                time.sleep(_PAUSE_S)
            else:
                return final

    def _prove_here(self, way: Way, pin: str, notes: list[str]) -> None:
        try:
            way.prove(pin)
        except NetcfgError as error:
            notes.append(f"api-ssl could not be tried at {way.shown}: {error}")

    def _from_afar(self, pin: str, notes: list[str]) -> None:
        """After a serial line: the network may be within reach all the same."""
        final = self.doorway.final
        try:
            final.prove(pin)
            final.meet()
        except NetcfgError:
            notes.append(
                f"not verified, because the laptop is on the serial line: that {self.wish.host} answers on "
                f"{self.wish.port}; plug into {self.wish.port} with address {self.wish.laptop}, and "
                "`provision site=…` verifies it"
            )
        self._known()

    def _settled(self, facts: Facts) -> Facts:
        if recognise(facts, self.wish, self.now()) is not Standing.ADOPTED:
            left = ", ".join(self._titles(facts)) or "nothing that is known"
            raise Unfinished(
                f"{self.wish.name}: every command was accepted, yet something is still to be done: {left}",
                hint="run the same command again; if it says the same, look at the device with Winbox",
            )
        return facts

    # --- words -----------------------------------------------------------------------------------------------------

    def _tell(self, stage: Stage, message: str) -> None:
        self.notify(Event(self.wish.name, stage, message))
