"""Adoption of one router of the inventory over its console, with a record (steps: `routeros.first_contact`)."""

from __future__ import annotations

import asyncio
import socket
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from atlantis_netcfg import __version__, runs
from atlantis_netcfg.core import errors
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.operations.common.kinds import get_managed_device, is_supported
from atlantis_netcfg.operations.common.request import refuse_examples
from atlantis_netcfg.routeros import api
from atlantis_netcfg.routeros.console.ssh import host_key_of, open_ssh
from atlantis_netcfg.routeros.console.terminal import open_serial
from atlantis_netcfg.routeros.console.types import Console, ConsoleUnreachable
from atlantis_netcfg.routeros.first_contact.run import FirstContact, features_of
from atlantis_netcfg.routeros.first_contact.steps import (
    FACTORY_ADDRESS,
    AdoptionOutcome,
    AdoptionStatus,
    AdoptionTarget,
    ConsoleRoute,
)
from atlantis_netcfg.routeros.rsc import parse

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from atlantis_netcfg.core.events import Subscriber
    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.inventory.model import Access
    from atlantis_netcfg.runs.records import Record

SSH_PORT = 22
"""Port of service `ssh`; neither the factory settings nor the site's template change it."""
_KNOCK_S = 5.0
"""Connection timeout in seconds: a device on a cable responds at once."""
_CABLE_S = 60.0


@dataclass(slots=True)
class HostKey:
    """The host key that the device must present; if none is known, the first one that it presents."""

    pin: str | None


@dataclass(slots=True)
class SshRoute:
    """A console route over SSH; `locate` maps a service port to its real address (loopback for an emulated device)."""

    label: str
    target: AdoptionTarget
    key: HostKey
    locate: Callable[[int], tuple[str, int]]
    serial: bool = False

    def open(self, user: str, password: Secret) -> Console:
        """Log in by SSH; an unknown host key is taken from a first session, which sends no password."""
        self.meet()
        address, port = self.locate(SSH_PORT)
        return open_ssh(address, port, user, password, pin=self.key.pin, timeout_s=_CABLE_S)

    def meet(self) -> None:
        """Check that the device responds, and record its host key if none is known; no login."""
        address, port = self._knock()
        if self.key.pin is not None:
            return
        self.key.pin = host_key_of(address, port, _CABLE_S)

    def prove(self, pin: str) -> None:
        """Log in by api-ssl as the toolkit's user, requiring this certificate."""
        try:
            asyncio.run(self._log_in(pin))
        except api.Unreachable as nobody:
            raise ConsoleUnreachable(str(nobody), hint=nobody.hint) from nobody

    async def _log_in(self, pin: str) -> None:
        host, port = self.locate(self.target.api_port)
        endpoint = api.Endpoint(host, port, self.target.user, self.target.password, pin, connect_timeout_s=_KNOCK_S)
        session = await api.Session.open(endpoint)
        await session.close()

    def _knock(self) -> tuple[str, int]:
        """Check quickly whether the device responds: an SSH server sends its banner at once."""
        address, port = self.locate(SSH_PORT)
        try:
            with socket.create_connection((address, port), timeout=_KNOCK_S) as knock:
                if not knock.recv(1):
                    raise ConnectionResetError("closed immediately")
        except OSError as error:
            raise ConsoleUnreachable(
                f"{arg(self.label)}: no response on the SSH port ({arg(error.strerror or error)})",
                hint="is the laptop plugged into the right port of the device, with an address of that network "
                f"(for {arg(self.label)}: another address that begins with {arg(self.label.rpartition('.')[0])}.)?",
            ) from error
        return address, port


@dataclass(slots=True)
class SerialRoute:
    """A console route over a serial line; it cannot test api-ssl."""

    label: str
    serial: bool = True

    def open(self, user: str, password: Secret) -> Console:
        """Log in on the serial line."""
        return open_serial(self.label, user, password, timeout_s=_CABLE_S)

    def prove(self, pin: str) -> None:
        """Raise ConsoleUnreachable: there is no TLS on a serial line."""
        raise ConsoleUnreachable(f"cannot test certificate {arg(pin[:16])}… over {arg(self.label)}")

    def meet(self) -> None:
        """Do nothing: a serial line has no host key, and RouterOS does not print its own."""


@dataclass(slots=True)
class ConsoleAccess:
    """The route over the technician's connection, and the one over the management address."""

    first: ConsoleRoute
    final: ConsoleRoute
    key: HostKey

    @property
    def host_key(self) -> str | None:
        """The host key of the device; None until it is known."""
        return self.key.pin


SSH = "ssh"
SERIAL = "serial:"
_WIRELESS = ("/interface/wireless", "/interface/wifi")
_HALF = "half-adopted"


@dataclass(frozen=True, slots=True)
class AdoptionResult:
    """The result of an adoption; everything reported as done was read back."""

    device: str
    status: str
    exit: errors.ExitCode
    message: str
    standing: str = ""
    steps: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    run: str = ""

    def as_json(self) -> dict[str, Any]:
        """Return the object that `--json` prints."""
        return {
            "device": self.device,
            "status": self.status,
            "exit": int(self.exit),
            "message": self.message,
            "standing": self.standing,
            "steps": list(self.steps),
            "notes": list(self.notes),
            "run": self.run,
        }


@dataclass(slots=True)
class Adoption:
    """The adoption of one device, with the routes to it."""

    inventory: Inventory
    host: Host
    state: Path
    command: str
    notify: Subscriber
    factory_passwords: Callable[[], Iterator[Secret]]
    via: str = SSH
    address: str = FACTORY_ADDRESS
    is_rehearsal: bool = False
    locate: Callable[[str, int], tuple[str, int]] = lambda address, port: (address, port)
    """Rehearsal: maps the address and port of a service to the emulated device's real ones."""
    take_over: bool = False
    is_replacement: bool = False
    wait_s: float = 600.0
    target: AdoptionTarget = field(init=False)

    def __post_init__(self) -> None:
        refuse_examples(self.inventory, is_rehearsal=self.is_rehearsal)
        self.target = target_of(self.inventory, self.host)

    def plan(self) -> AdoptionResult:
        """Read the device and return the planned steps; nothing is changed or recorded. Raise NetcfgError."""
        outcome = self._contact(runs.NoJournal()).plan()
        if outcome.status is AdoptionStatus.ALREADY:
            return self._unchanged_result(outcome, "")
        message = msg(f"planned: {arg(len(outcome.steps))} steps; the device is {arg(outcome.standing)}")
        return self._result(outcome, errors.ExitCode.CHANGES, message, "")

    def carry_out(self, agree: Callable[[AdoptionOutcome], None]) -> AdoptionResult:
        """Adopt the device under the site's lock, with a journal; raise NetcfgError, which the journal records too."""
        store = runs.Store(self.state, is_rehearsal=self.is_rehearsal)
        with store.lock(self.host.site, self.command), store.start(self._start_record()) as journal:
            if self.is_replacement:
                store.pins.change(self.host.name, None)
                store.pins.change_host_key(self.host.name, None)
            return self._adopt_with_journal(journal, agree)

    def _adopt_with_journal(self, journal: runs.Journal, agree: Callable[[AdoptionOutcome], None]) -> AdoptionResult:
        change_journal = _ChangeJournal(journal)
        try:
            outcome = self._contact(change_journal).adopt(agree)
        except errors.NetcfgError as error:
            failure = self._end(
                journal, _failure_status(error, has_changes=change_journal.touched), error.exit, str(error)
            )
            if failure is not None:
                error.args = (msg(f"{arg(error)}; {arg(runs.NOT_RECORDED)}: {arg(failure)}"),)
            raise
        if outcome.status is AdoptionStatus.ALREADY:
            result = self._unchanged_result(outcome, journal.run)
        else:
            message = msg(
                f"adopted: {arg(len(outcome.steps))} steps, verified; {arg(self.target.host)} is on "
                f"{arg(self.target.port)}"
            )
            result = self._result(outcome, errors.ExitCode.DONE, message, journal.run)
        return runs.mark_unrecorded(result, self._end(journal, result.status, result.exit, result.message))

    def _contact(self, journal: runs.Recorder) -> FirstContact:
        pins = runs.Store(self.state, is_rehearsal=self.is_rehearsal).pins
        return FirstContact(
            target=self.target,
            routes=self._console_access(
                None if self.is_replacement else self._access.host_key or pins.host_key(self.host.name)
            ),
            pins=pins,
            journal=journal,
            notify=self.notify,
            factory_passwords=self.factory_passwords,
            take_over=self.take_over,
            wait_s=self.wait_s,
        )

    @property
    def _access(self) -> Access:
        return get_managed_device(self.inventory, self.host).access

    def _console_access(self, pin: str | None) -> ConsoleAccess:
        key = HostKey(pin)
        final = self._ssh(self.target.host, key)
        first: ConsoleRoute = final
        if self.via.startswith(SERIAL):
            first = SerialRoute(self.via.removeprefix(SERIAL))
        elif self.address != self.target.host:
            first = self._ssh(self.address, key)
        return ConsoleAccess(first, final, key)

    def _ssh(self, address: str, key: HostKey) -> SshRoute:
        return SshRoute(address, self.target, key, lambda port: self.locate(address, port))

    def _result(self, outcome: AdoptionOutcome, code: errors.ExitCode, message: str, run: str) -> AdoptionResult:
        notes = (
            *(errors.fill_hint(note, site=self.host.site) for note in outcome.notes),
            *self._missing(outcome),
            *self._stale(),
        )
        state = outcome.standing.value
        return AdoptionResult(self.host.name, outcome.status.value, code, message, state, outcome.steps, notes, run)

    def _unchanged_result(self, outcome: AdoptionOutcome, run: str) -> AdoptionResult:
        return self._result(outcome, errors.ExitCode.DONE, "already adopted: nothing was changed", run)

    def _missing(self, outcome: AdoptionOutcome) -> Iterator[str]:
        """Yield what `provision site=...` will require and adoption cannot create."""
        there = {row.get("name") for row in outcome.facts.certificates} if outcome.facts else set()
        for prerequisite in get_managed_device(self.inventory, self.host).prerequisites():
            if (
                prerequisite.menu == "/certificate"
                and prerequisite.name not in there
                and outcome.status is not AdoptionStatus.PLANNED
            ):
                yield msg(
                    f"certificate {arg(prerequisite.name)} is not on the device yet ({arg(prerequisite.reason)}): "
                    "import it before you run provision"
                )

    def _stale(self) -> Iterator[str]:
        """Yield inventory entries that name another certificate or SSH host key than the device's."""
        pins, name = runs.Store(self.state, is_rehearsal=self.is_rehearsal).pins, self.host.name
        for key, declared_pin, saved_pin in (
            ("fingerprint", self._access.fingerprint, pins.get(name)),
            ("host_key", self._access.host_key, pins.host_key(name)),
        ):
            if declared_pin and saved_pin and declared_pin != saved_pin:
                yield msg(
                    f"the inventory has `{arg(key)}: {arg(declared_pin)}`: change it to {arg(saved_pin)}, or the "
                    "device is refused"
                )

    def _start_record(self) -> runs.RunStart:
        return runs.RunStart(
            site=self.host.site,
            revision=self.inventory.revision,
            tool=__version__,
            hosts=(self.host.name,),
            rehearsed=self.is_rehearsal,
            command=self.command,
            purpose=runs.Purpose.ADOPT,
            by=msg(f"{arg(runs.LockHolder.me(self.command).user)} on {arg(socket.gethostname())}"),
        )

    def _end(self, journal: runs.Journal, status: str, code: errors.ExitCode, message: str) -> runs.JournalError | None:
        """Record the end; return an error such as a full disk instead of raising it, so that the result is not lost."""
        outcome = runs.Outcome(device=self.host.name, status=status, exit=int(code), message=message)
        return runs.conclude(journal, outcome, runs.RunEnd(exit=int(code)))


class _ChangeJournal:
    """A journal that records whether a command that changes the device was sent."""

    def __init__(self, journal: runs.Journal) -> None:
        self._journal = journal
        self.touched = False

    def write(self, record: Record) -> None:
        """Write a record to disk."""
        self.touched = self.touched or isinstance(record, runs.ContactStep)
        self._journal.write(record)

    def save(self, device: str, text: str) -> None:
        """Save the state before the change."""
        self._journal.save(device, text)

    def confirm(self, device: str, text: Callable[[], str]) -> None:
        """Save the state that was read back."""
        self._journal.confirm(device, text)


def _failure_status(error: errors.NetcfgError, *, has_changes: bool) -> str:
    if error.exit is errors.ExitCode.UNKNOWN:
        return "unknown"
    return _HALF if has_changes else "refused"


def target_of(inventory: Inventory, host: Host) -> AdoptionTarget:
    """Return the target state of a device at adoption; raise NoMatchError for kinds that the engine lacks."""
    if not is_supported(host):
        raise errors.NoMatchError(
            f"{arg(host.name)} is a {arg(host.device.kind.replace('_', ' '))}: only RouterOS devices can be adopted",
            hint="see the device's documentation for its setup",
        )
    managed_device = get_managed_device(inventory, host)
    access, place = managed_device.access, managed_device.place
    desired_state = parse(managed_device.texts()[0].text, source=msg(f"the desired text of {arg(host.name)}"))
    return AdoptionTarget(
        name=host.name,
        user=access.user,
        password=access.password,
        address=place.address,
        technician=place.technician,
        port=place.port,
        ports=managed_device.hardware.ports,
        model=host.device.model,
        api_port=access.port,
        features=features_of(desired_state),
        certificates=managed_device.certificates,
        radio=any(statement.menu.startswith(_WIRELESS) for statement in desired_state.statements),
    )
