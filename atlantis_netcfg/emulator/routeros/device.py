"""One emulated router without sockets: sentences in, reply sentences out, the caller's clock.

Also the parser of API sentences (Manual, API: API words), and `/menu/listen`, which reports changed rows (Manual, API:
Command examples).
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
from dataclasses import dataclass, field
from ipaddress import IPv4Address
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.emulator.routeros import access
from atlantis_netcfg.emulator.routeros.answers import DONE_REPLY, EMPTY, NOT_REHEARSED, Answer, Caller, Category, Trap
from atlantis_netcfg.emulator.routeros.boot import boot, next_run, run_due
from atlantis_netcfg.emulator.routeros.commands.dispatch import dispatch
from atlantis_netcfg.emulator.routeros.commands.read import _rows_by_id, emit
from atlantis_netcfg.emulator.routeros.console.export import Form, export_text
from atlantis_netcfg.emulator.routeros.console.side import ConsoleBackend, ConsoleReply
from atlantis_netcfg.emulator.routeros.core import Call, CallResult, Core, FlashFile, Listener, Service, services_of
from atlantis_netcfg.emulator.routeros.network.failover import next_watch, watch
from atlantis_netcfg.emulator.routeros.network.path import path_open
from atlantis_netcfg.emulator.routeros.software import boot_with
from atlantis_netcfg.emulator.routeros.spec import Deviation, RouterSpec
from atlantis_netcfg.emulator.routeros.storage import FileSide
from atlantis_netcfg.emulator.routeros.store import RowStore

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from atlantis_netcfg.emulator.routeros.storage import Flash
    from atlantis_netcfg.emulator.routeros.store import HistoryEntry

__all__ = ["NOT_REHEARSED", "ConsoleReply", "Device", "Service"]


@dataclass(slots=True)
class Sentence:
    """A command with its arguments; `unset` are names given as `!name` or `=!name=`."""

    menu: str
    command: str
    arguments: dict[str, str] = field(default_factory=dict)
    unset: list[str] = field(default_factory=list)
    queries: list[str] = field(default_factory=list)
    tag: str = ""

    @property
    def path(self) -> str:
        """Menu and command as one path."""
        return f"{self.menu.rstrip('/')}/{self.command}"

    @classmethod
    def read(cls, words: Sequence[str]) -> Sentence:
        """Parse the words of a sentence. Raises Trap on an invalid one; the last of repeated arguments counts."""
        path, *rest = words
        if not path.startswith("/") or path.endswith("/"):
            raise Trap("no such command", Category.MISSING)
        menu, _, command = path.rpartition("/")
        sentence = cls(menu or "/", command)
        for word in rest:
            sentence._take_word(word)
        return sentence

    def _take_word(self, word: str) -> None:
        if word.startswith("."):
            name, _, value = word.partition("=")
            if name != ".tag":
                raise Trap(f"unknown parameter {name}")
            self.tag = value
        elif word.startswith("?"):
            self.queries.append(word[1:])
        elif word.startswith("=!"):
            self.unset.append(word[2:].partition("=")[0])
        elif word.startswith("="):
            name, _, value = word[1:].partition("=")
            self.arguments[name] = value
        elif word.startswith("!"):
            self.unset.append(word[1:])
        else:
            raise Trap(f"unknown parameter {word}")


def listen(core: Core, call: Call, tag: str) -> list[Answer]:
    """Start listening; the first reply comes with the first change."""
    if not core.schema.has_menu(call.menu):
        raise Trap("no such command prefix", Category.MISSING)
    if not core.schema.has_command(call.menu, "listen"):
        raise Trap("no such command", Category.MISSING)
    core.listeners.append(Listener(call.caller, tag, call, _rows_by_id(core, call)))
    return []


class Device(ConsoleBackend, FileSide):
    """An emulated router without sockets; all methods except `path_open`, `services` and `export` may change its state.

    It emulates the router's configuration: menus, values, history, safe mode, export, and the management path.
    NOT_REHEARSED lists what it cannot emulate.
    """

    def __init__(self, spec: RouterSpec, now: Callable[[], float]) -> None:
        """Boot the router; `now` is a monotonic clock in seconds, also used by `due()`. Raises SeedError."""
        self.spec = spec
        self._now = now
        self._core = Core(spec, now, dispatch)
        boot(self._core)
        self._unroll_at: float | None = None
        self._lost: dict[int, float] = {}

    @property
    def core(self) -> Core:
        """The router's state, for code that couples routers: the air between two radios."""
        return self._core

    @property
    def revision(self) -> int:
        """Revision of the configuration, for caches of `path_open` and `services`."""
        return self._core.store.revision

    @property
    def wants_reboot(self) -> bool:
        """Whether a reboot was requested: the owner of the sockets must close them and call `reboot()`."""
        return self._core.wants_reboot

    @property
    def closed_sessions(self) -> frozenset[int]:
        """Sessions ended by another session: the owner of their sockets must close them."""
        return frozenset(self._core.ended)

    # --- sessions --------------------------------------------------------------------------------------------------

    def challenge(self) -> str:
        """Return a new challenge for the login before 6.43 (`/login` without a name)."""
        return secrets.token_hex(16)

    def login(self, user: str, password: str, *, via: str, address: str) -> Caller:
        """Open a session over service `via`. Raises Trap with the router's text."""
        return self._open(
            user, lambda stored_password: hmac.compare_digest(stored_password.encode(), password.encode()), via, address
        )

    def login_by_key(self, user: str, key: bytes, *, via: str, address: str) -> Caller:
        """Open a session for the holder of a private key. Raises Trap with the router's text."""
        return self._open(user, lambda _password: access.has_authorized_key(self._core, user, key), via, address)

    def login_response(self, user: str, challenge: str, response: str, *, via: str, address: str) -> Caller:
        """Complete the old login: `response` is `00` + md5(0x00 + password + challenge) in hex."""

        def right(stored_password: str) -> bool:
            digest = hashlib.md5(b"\0" + stored_password.encode() + bytes.fromhex(challenge))  # noqa: S324 - RouterOS' protocol
            return hmac.compare_digest(f"00{digest.hexdigest()}", response.lower())

        try:
            return self._open(user, right, via, address)
        except Trap as refused:
            raise Trap("cannot log in") from refused

    def has_key(self, user: str, key: bytes) -> bool:
        """Return whether SSH accepts this public key of the user."""
        return access.has_authorized_key(self._core, user, key)

    def takes_password(self, user: str) -> bool:
        """Return whether SSH asks this user for a password; by default not a user with a key."""
        return access.by_password(self._core, user)

    def _open(self, user: str, right: Callable[[str], bool], via: str, address: str) -> Caller:
        self.tick()
        caller = access.admit(self._core, user, right, via, address)
        self._core.sessions[caller.number] = caller
        return caller

    def logout(self, caller: Caller, *, clean: bool) -> None:
        """End a session: closed by its client (`clean`), or lost (detected by the router only later)."""
        if clean:
            self._forget(caller.number)
        elif caller.number in self._core.sessions:
            self._lost[caller.number] = self._now() + self.spec.silent_timeout_s

    def _forget(self, number: int) -> None:
        """Remove a session; if it holds safe mode, its changes are undone shortly after."""
        core = self._core
        core.sessions.pop(number, None)
        core.menus.pop(number, None)
        core.numbered = {key: ids for key, ids in core.numbered.items() if key[0] != number}
        core.ended.discard(number)
        core.listeners = [listener for listener in core.listeners if listener.caller.number != number]
        self._lost.pop(number, None)
        if core.history.holder is not None and core.history.holder.number == number:
            self._unroll_at = self._now() + self.spec.unroll_delay_s

    # --- sentences -------------------------------------------------------------------------------------------------

    def run(self, caller: Caller, words: Sequence[str]) -> list[Answer]:
        """Run one sentence and return its replies, without tags.

        If the last reply is not `last`, the sentence continues under its `.tag` (`/listen`), and `pending` returns the
        rest. `/quit` ends with `!fatal`: the connection is then closed.
        """
        self.tick()
        try:
            sentence = Sentence.read(words)
            answers = self._answer(caller, sentence)
        except Trap as refusal:
            answers = [refusal.answer(), DONE_REPLY]
        emit(self._core)
        next_watch(self._core)  # what is new begins now
        return answers

    def _answer(self, caller: Caller, sentence: Sentence) -> list[Answer]:
        if sentence.path == "/quit":
            return [Answer.fatal("session terminated on request")]
        if sentence.path == "/cancel":
            return self._cancel(caller, sentence)
        if sentence.path == "/login":
            arguments = sentence.arguments
            self.login(arguments.get("name", ""), arguments.get("password", ""), via=caller.via, address=caller.address)
            return [DONE_REPLY]
        call = Call(
            caller,
            sentence.menu,
            sentence.command,
            sentence.arguments,
            tuple(sentence.unset),
            tuple(sentence.queries),
        )
        if sentence.command == "listen":
            return listen(self._core, call, sentence.tag)
        return self._result_answers(dispatch(self._core, call), call)

    def _result_answers(self, result: CallResult, call: Call) -> list[Answer]:
        rows = [Answer.row(row) for row in result.rows]
        if call.path in ("/ping", "/tool/ping") and "count" not in call.arguments:
            return rows
        if result.listing and not rows and self._core.schema.at_least("7.18"):
            rows = [EMPTY]
        return [*rows, Answer.done_reply(result.ret)]

    def _cancel(self, caller: Caller, sentence: Sentence) -> list[Answer]:
        tag = sentence.arguments.get("tag")
        listeners = [
            listener
            for listener in self._core.listeners
            if listener.caller.number == caller.number and tag in (None, listener.tag)
        ]
        for item in listeners:
            self._core.listeners.remove(item)
            interruption = Trap("interrupted", Category.INTERRUPTION).answer()
            self._core.outbox += [(caller.number, item.tag, interruption), (caller.number, item.tag, DONE_REPLY)]
        return [DONE_REPLY]

    def pending(self, caller: Caller) -> list[tuple[str, Answer]]:
        """Return and remove later replies of continuing sentences, with their tags."""
        local = [(tag, answer) for number, tag, answer in self._core.outbox if number == caller.number]
        self._core.outbox = [item for item in self._core.outbox if item[0] != caller.number]
        return local

    # --- time ------------------------------------------------------------------------------------------------------

    def due(self) -> float | None:
        """Return when `tick` is next needed, on the `now` clock; None if nothing is scheduled."""
        local = (self._unroll_at, next_run(self._core), next_watch(self._core))
        moments = [*self._lost.values(), *self._core.expires.values(), *local]
        return min((moment for moment in moments if moment is not None), default=None)

    def tick(self) -> None:
        """Process everything that is due: lost sessions, their safe mode, schedulers."""
        now = self._now()
        for number in [number for number, when in self._lost.items() if when <= now]:
            self._forget(number)
        if self._unroll_at is not None and self._unroll_at <= now:
            self._unroll_at = None
            holder = self._core.history.holder
            if holder is not None and holder.number not in self._core.sessions:
                self._core.history.unroll(self._core.store)
                self._core.note("system,info", f"safe mode of {holder.user} undone")
        self._expire(now)
        run_due(self._core)
        watch(self._core)
        emit(self._core)

    def silence(self, addresses: Iterable[str]) -> None:
        """Make these addresses stop responding, and all others respond again."""
        self.tick()
        self._core.silent = frozenset(IPv4Address(address) for address in addresses)

    def _expire(self, now: float) -> None:
        """Remove expired entries of address lists, without a history entry."""
        core, path = self._core, "/ip/firewall/address-list"
        for number in [number for number, when in core.expires.items() if when <= now]:
            del core.expires[number]
            if (item := core.store.table(path).find(number)) is not None:
                core.store.remove(path, item)
                core.store.changes.clear()

    def reboot(self, *, clean: bool = True) -> None:
        """Restart: sessions, safe mode (with undo) and history end; the rest is kept on flash.

        Without `clean` the power was cut: nothing is undone explicitly, and the flash decides.

        Assumption: safe-mode-power-loss
        """
        if clean and self._core.history.holder is not None:
            self._core.history.unroll(self._core.store)
        flash = self.snapshot()
        self.restore(flash)

    # --- what others look at ---------------------------------------------------------------------------------------

    def path_open(
        self, caller: str, local: str, service: str, *, is_established: bool = False, plug: str | None = None
    ) -> bool:
        """Return whether a packet from address `caller` reaches `service` at `local`, and the response returns.

        `is_established`: for an existing session (its connection is tracked). `plug`: factory name of the technician's
        port; by default the management port.
        """
        return path_open(self._core, caller, local, service, is_established=is_established, plug=plug)

    def certificate(self, name: str) -> str | None:
        """Return key and certificate of a `/certificate` row as PEM; None for an unsigned template."""
        number = self._core.store.id_of("certificate", name)
        return None if number is None else self._core.keys.get(number)

    def is_wrapped(self, interface: str) -> bool:
        """Return whether an OpenVPN interface uses tls-crypt for its control channel, which no menu shows."""
        return self._core.store.id_of("interface", interface) in self._core.wraps

    def give_certificate(self, name: str, pem: str) -> None:
        """Store a row's key and certificate on the flash, as if made earlier. Raises LookupError without a row."""
        number = self._core.store.id_of("certificate", name)
        if number is None:
            raise LookupError(name)
        self._core.keys[number] = pem

    def services(self) -> Mapping[str, Service]:
        """Return the currently configured services by name."""
        return services_of(self._core)

    def export(
        self,
        *,
        verbose: bool = False,
        terse: bool = False,
        show_sensitive: bool = False,
        menu: str = "/",
        header: bool = True,
    ) -> str:
        """Return the output of `/export`; `header=False` omits the lines with the clock, for comparisons."""
        form = Form(verbose=verbose, terse=terse, show_sensitive=show_sensitive, header=header)
        return export_text(self._core, menu, form)

    # --- flash -----------------------------------------------------------------------------------------------------

    def snapshot(self) -> dict[str, Any]:
        """Return the flash as JSON-able data: the configuration without changes of an open safe mode.

        With `Deviation.POWER_LOSS` those changes are included.
        """
        store = self._core.store
        if floating := self._floating():
            store = RowStore(store.schema)
            store.load(self._core.store.dump())
            for entry in reversed(floating):
                for change in reversed(entry.changes):
                    store.put_back(change)
        return {**self._non_row_state(), "configuration": store.dump()}

    def save_to(self, flash: Flash) -> None:
        """Save changes to the flash: one line for changed rows, else a complete `snapshot`."""
        store = self._core.store
        changes = store.dump_unsaved()
        if (
            store.unsaved is None
            or self._floating()
            or not flash.extend(self._non_row_state(), changes, store.counters)
        ):
            flash.save(self.snapshot(), self._non_row_state())
        store.unsaved = None if self._floating() else []

    def _floating(self) -> list[HistoryEntry]:
        """Return the history entries that a power cut would undo."""
        if Deviation.POWER_LOSS in self.spec.deviations:
            return []
        return [entry for entry in self._core.history.entries if entry.floating and not entry.undone]

    def _non_row_state(self) -> dict[str, Any]:
        core = self._core
        files = {name: [file.number, file.contents, file.modified_at, file.folder] for name, file in core.files.items()}
        software = {"version": core.spec.version, "packages": list(core.spec.packages)}
        keys = {str(number): pem for number, pem in core.keys.items()}
        wraps = {str(number): key for number, key in core.wraps.items()}
        flash = {"files": files, "software": software, "keys": keys, "wraps": wraps}
        sim = {} if self.spec.modem is None else {"tries_left": core.sim.tries_left}
        return flash | sim | {"greetings": list(core.greetings)}

    def restore(self, flash: Mapping[str, Any]) -> None:
        """Boot from a `snapshot`: sessions, safe mode and history are lost, packages get installed."""
        revision = self._core.store.revision
        files = {name: FlashFile(*parts) for name, parts in flash["files"].items()}
        software_boot = boot_with(self.spec.model_copy(update=_software(flash)), files)
        is_upgrade = software_boot.spec.version != flash.get("software", {}).get("version", self.spec.version)
        before, self._core = self._core, Core(software_boot.spec, self._now, dispatch)
        self._core.resume(before)
        if is_upgrade:
            boot(self._core)
        self._core.store.load(flash["configuration"], is_upgrade=is_upgrade)
        self._core.store.revision = revision + 1
        self._core.files = dict(software_boot.files)
        self._core.keys = {int(number): pem for number, pem in flash.get("keys", {}).items()}
        self._core.wraps = {int(number): key for number, key in flash.get("wraps", {}).items()}
        self._core.greetings = tuple(flash.get("greetings", self._core.greetings))
        self._core.sim.tries_left = flash.get("tries_left", self._core.sim.tries_left)
        self.spec = software_boot.spec
        for topics, message in software_boot.log:
            self._core.note(topics, message)
        self._unroll_at = None
        self._lost.clear()


def _software(flash: Mapping[str, Any]) -> dict[str, Any]:
    """Return version and packages installed when the flash was written."""
    software = flash.get("software")
    return {} if software is None else {"version": software["version"], "packages": tuple(software["packages"])}
