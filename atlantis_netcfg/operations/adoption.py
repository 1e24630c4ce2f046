"""First contact with one declared router, from the declaration to the journal; the steps are `firstcontact`'s."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from atlantis_netcfg import __version__
from atlantis_netcfg.bootstrap import FACTORY_ADDRESS, Adopted, FirstContact, Status, Wish, features_of
from atlantis_netcfg.core.errors import ExitCode, NetcfgError, NothingMatched, complete
from atlantis_netcfg.journal import (
    NOT_RECORDED,
    ContactStep,
    NoJournal,
    Outcome,
    Purpose,
    RunEnded,
    RunStarted,
    Store,
    conclude,
    unrecorded,
)
from atlantis_netcfg.operations.console_access import HostKey, SerialWay, SshWay, Ways
from atlantis_netcfg.operations.examples import refuse_examples
from atlantis_netcfg.operations.kinds import handled, managed
from atlantis_netcfg.rsc import parse

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from atlantis_netcfg.bootstrap import Way
    from atlantis_netcfg.core.events import Subscriber
    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.declaration.model import Access
    from atlantis_netcfg.journal import Journal, JournalFailed, Recorder
    from atlantis_netcfg.journal.records import Record

__all__ = ["SERIAL", "SSH", "Adoption", "AdoptionResult", "wish_of"]

SSH = "ssh"
SERIAL = "serial:"
_WIRELESS = ("/interface/wireless", "/interface/wifi")
_HALF = "half-adopted"


@dataclass(frozen=True, slots=True)
class AdoptionResult:
    """How it ended; what is told as done was read back."""

    device: str
    status: str
    exit: ExitCode
    message: str
    standing: str = ""
    steps: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    run: str = ""

    def as_json(self) -> dict[str, Any]:
        """The object that `--json` prints."""
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
    """One device that is to be adopted, and how it is reached."""

    declaration: Declaration
    host: Host
    state: Path
    command: str
    notify: Subscriber
    factory_passwords: Callable[[], Iterator[Secret]]
    via: str = SSH
    address: str = FACTORY_ADDRESS
    rehearsed: bool = False
    locate: Callable[[str, int], tuple[str, int]] = lambda address, port: (address, port)
    """Rehearsal: where a service port of an address really is."""
    take_over: bool = False
    replaced: bool = False
    wait_s: float = 600.0
    wish: Wish = field(init=False)

    def __post_init__(self) -> None:
        refuse_examples(self.declaration, rehearsed=self.rehearsed)
        self.wish = wish_of(self.declaration, self.host)

    def plan(self) -> AdoptionResult:
        """Look at the device and tell what would be done; nothing is changed or recorded. Raises NetcfgError."""
        found = self._contact(NoJournal()).plan()
        if found.status is Status.ALREADY:
            return self._unchanged(found, "")
        message = f"planned: {len(found.steps)} steps; the device is {found.standing}"
        return self._result(found, ExitCode.CHANGES, message, "")

    def carry_out(self, agree: Callable[[Adopted], None]) -> AdoptionResult:
        """Adopt the device under the site's lock, with a journal. Raises NetcfgError, which the journal holds too."""
        store = Store(self.state, rehearsed=self.rehearsed)
        with store.lock(self.host.site, self.command), store.start(self._started()) as journal:
            if self.replaced:
                store.pins.change(self.host.name, None)
                store.pins.change_host_key(self.host.name, None)
            return self._journalled(journal, agree)

    def _journalled(self, journal: Journal, agree: Callable[[Adopted], None]) -> AdoptionResult:
        watched = _Watched(journal)
        try:
            found = self._contact(watched).adopt(agree)
        except NetcfgError as error:
            failure = self._end(journal, _status(error, touched=watched.touched), error.exit, str(error))
            if failure is not None:
                error.args = (f"{error}; {NOT_RECORDED}: {failure}",)
            raise
        if found.status is Status.ALREADY:
            result = self._unchanged(found, journal.run)
        else:
            message = f"adopted: {len(found.steps)} steps, read back; {self.wish.host} is on {self.wish.port}"
            result = self._result(found, ExitCode.DONE, message, journal.run)
        return unrecorded(result, self._end(journal, result.status, result.exit, result.message))

    def _contact(self, journal: Recorder) -> FirstContact:
        pins = Store(self.state, rehearsed=self.rehearsed).pins
        return FirstContact(
            wish=self.wish,
            doorway=self._ways(None if self.replaced else self._access.host_key or pins.host_key(self.host.name)),
            pins=pins,
            journal=journal,
            notify=self.notify,
            factory_passwords=self.factory_passwords,
            take_over=self.take_over,
            wait_s=self.wait_s,
        )

    @property
    def _access(self) -> Access:
        return managed(self.declaration, self.host).access

    def _ways(self, pinned: str | None) -> Ways:
        key = HostKey(pinned)
        final = self._ssh(self.wish.host, key)
        first: Way = final
        if self.via.startswith(SERIAL):
            first = SerialWay(self.via.removeprefix(SERIAL))
        elif self.address != self.wish.host:
            first = self._ssh(self.address, key)
        return Ways(first, final, key)

    def _ssh(self, address: str, key: HostKey) -> SshWay:
        return SshWay(address, self.wish, key, lambda port: self.locate(address, port))

    def _result(self, found: Adopted, code: ExitCode, message: str, run: str) -> AdoptionResult:
        notes = (*(complete(one, site=self.host.site) for one in found.notes), *self._missing(found), *self._stale())
        standing = found.standing.value
        return AdoptionResult(self.host.name, found.status.value, code, message, standing, found.steps, notes, run)

    def _unchanged(self, found: Adopted, run: str) -> AdoptionResult:
        return self._result(found, ExitCode.DONE, "already adopted: nothing was changed", run)

    def _missing(self, found: Adopted) -> Iterator[str]:
        """What `provision site=...` will ask for, and what no first contact can make."""
        there = {row.get("name") for row in found.facts.certificates} if found.facts else set()
        for one in managed(self.declaration, self.host).prerequisites():
            if one.menu == "/certificate" and one.name not in there and found.status is not Status.PLANNED:
                yield f"certificate {one.name} is not on the device yet ({one.reason}): import it before you provision"

    def _stale(self) -> Iterator[str]:
        """What the inventory still says of another certificate, or of another SSH server."""
        pins, name = Store(self.state, rehearsed=self.rehearsed).pins, self.host.name
        for key, declared, pinned in (
            ("fingerprint", self._access.fingerprint, pins.get(name)),
            ("host_key", self._access.host_key, pins.host_key(name)),
        ):
            if declared and pinned and declared != pinned:
                yield f"the inventory declares `{key}: {declared}`: until it says {pinned}, the device is refused"

    def _started(self) -> RunStarted:
        return RunStarted(
            site=self.host.site,
            revision=self.declaration.revision,
            tool=__version__,
            hosts=(self.host.name,),
            rehearsed=self.rehearsed,
            command=self.command,
            purpose=Purpose.ADOPT,
        )

    def _end(self, journal: Journal, status: str, code: ExitCode, message: str) -> JournalFailed | None:
        """Record the end; a disk that is full by now is told in the result, which must not be lost over it."""
        outcome = Outcome(device=self.host.name, status=status, exit=int(code), message=message)
        return conclude(journal, outcome, RunEnded(exit=int(code)))


class _Watched:
    """A journal that knows whether anything was typed that changes the device."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self.touched = False

    def write(self, record: Record) -> None:
        """Put a record on disk."""
        self.touched = self.touched or isinstance(record, ContactStep)
        self._journal.write(record)

    def save(self, device: str, text: str) -> None:
        """Put the state of before on disk."""
        self._journal.save(device, text)

    def confirm(self, device: str, text: Callable[[], str]) -> None:
        """Put the state that was read back on disk."""
        self._journal.confirm(device, text)


def _status(error: NetcfgError, *, touched: bool) -> str:
    if error.exit is ExitCode.UNKNOWN:
        return "unknown"
    return _HALF if touched else "refused"


def wish_of(declaration: Declaration, host: Host) -> Wish:
    """What a declared device is to become at first contact. Raises NothingMatched for kinds that the engine lacks."""
    if not handled(host):
        raise NothingMatched(
            f"{host.name} is a {host.device.kind.replace('_', ' ')}: only RouterOS devices are adopted",
            hint="its own pages say how it is set up",
        )
    known = managed(declaration, host)
    access, place = known.access, known.place
    desired = parse(known.texts()[0].text, source=f"the desired text of {host.name}")
    return Wish(
        name=host.name,
        user=access.user,
        password=access.password,
        address=place.address,
        technician=place.technician,
        port=place.port,
        ports=known.hardware.ports,
        model=host.device.model,
        api_port=access.port,
        features=features_of(desired),
        certificates=known.certificates,
        radio=any(one.menu.startswith(_WIRELESS) for one in desired.statements),
    )
