"""Input and result of the executor for one device."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Collection, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial
from secrets import token_hex
from typing import TYPE_CHECKING, Any, Protocol

from atlantis_netcfg import runs
from atlantis_netcfg.core.errors import DeviceError, ExitCode
from atlantis_netcfg.core.events import Subscriber, ignore
from atlantis_netcfg.routeros import api
from atlantis_netcfg.routeros.api._values import Channel

if TYPE_CHECKING:
    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.routeros import _types
    from atlantis_netcfg.routeros._items import DesiredState
    from atlantis_netcfg.routeros.console.types import Console
    from atlantis_netcfg.routeros.drift import Comparison
    from atlantis_netcfg.routeros.estimate import BearerProfile, Estimate


class JobMode(StrEnum):
    """Scope of a run."""

    PLAN = "plan"
    APPLY = "apply"
    RESUME = "resume"
    """Like `apply`, after a run that was killed: first waits until the device has undone what that run left open."""
    ROLLBACK = "rollback"
    """Like `apply`; the desired state is a saved one."""
    BACKUP = "backup"
    """Save the device's own text of its state, and change nothing."""
    DRIFT = "drift"
    """Say what differs from the desired state, since when and by whom, and change nothing."""


class Status(StrEnum):
    """Result of a run on one device; all but `unknown` were read from the device."""

    UNCHANGED = "unchanged"
    CHANGED = "changed"
    PLANNED = "planned"
    DRIFTED = "drifted"
    REFUSED = "refused"
    ROLLED_BACK = "rolled-back"
    LEFT_AS_FOUND = "left-as-found"
    UNKNOWN = "unknown"

    @property
    def exit(self) -> ExitCode:
        """The exit code of a run whose only device has this result."""
        return _EXITS[self]


_EXITS = {
    Status.UNCHANGED: ExitCode.DONE,
    Status.CHANGED: ExitCode.DONE,
    Status.PLANNED: ExitCode.CHANGES,
    Status.DRIFTED: ExitCode.CHECKS_FAILED,
    Status.REFUSED: ExitCode.FAILED,
    Status.ROLLED_BACK: ExitCode.FAILED,
    Status.LEFT_AS_FOUND: ExitCode.FAILED,
    Status.UNKNOWN: ExitCode.UNKNOWN,
}


class History(Protocol):
    """Earlier runs on the device, from the journal of this computer; implemented by `journal.DeviceHistory`."""

    def has_unfinished_run(self) -> bool:
        """Return True if a run of this computer died on the device, or its outcome is open."""

    def can_take_over(self, run: str, sign: str) -> bool:
        """Return True if a run marker on the device belongs to a dead run that may be taken over."""


class NoHistory:
    """A history without runs: for a caller that knows none, or must not tell dead runs from active ones."""

    def has_unfinished_run(self) -> bool:
        """Return False."""
        return False

    def can_take_over(self, run: str, sign: str) -> bool:  # noqa: ARG002 - as History has it
        """Return False."""
        return False


Connect = Callable[[api.Endpoint], Awaitable[Channel]]


@dataclass(frozen=True, slots=True)
class SshEndpoint:
    """Address of the device's text console, used for safe mode before RouterOS 7.18."""

    host: str
    port: int
    user: str
    password: Secret
    pin: str | None
    """The host key as OpenSSH prints it, `SHA256:...`; None if it was never met over SSH."""
    opening: Callable[[api.Traffic], object] = field(default=lambda _traffic: None, repr=False, compare=False)
    """As that of the API's endpoint."""


OpenConsole = Callable[[SshEndpoint], "Console"]


def open_console(endpoint: SshEndpoint) -> Console:
    """Log in over SSH; blocks. Raises what `console.open_ssh` raises."""
    from atlantis_netcfg.routeros.console.ssh import open_ssh  # noqa: PLC0415 - the SSH client is heavy, and seldom needed

    traffic = api.Traffic()
    endpoint.opening(traffic)
    host, port = endpoint.host, endpoint.port
    return open_ssh(host, port, endpoint.user, endpoint.password, pin=endpoint.pin, tally=traffic)


@dataclass(frozen=True, slots=True)
class Patience:
    """Timeouts in seconds. The defaults exceed gaps of 70 s and the device's own timeouts."""

    reach_s: float = 900.0
    """For a device that has gone away in the middle of a change: a reboot, or the gaps of a satellite link."""
    verify_s: float = 180.0
    """For the new session that proves that the device can still be reached; then the change is taken back."""
    undo_s: float = 720.0
    """For safe mode of a dead session: after a silent loss the device notices it after about nine minutes."""
    dead_man_s: float = 600.0
    """From arming a dead-man job until it takes back what was not confirmed; beside safe mode `undo_s` comes to it."""
    modem_s: float = 90.0
    """For a modem that starts anew with a PIN, until it says whether the SIM has taken it."""
    settle_s: float = 10.0
    """For routes that were just written, until the device uses them."""
    first_poll_s: float = 1.0
    last_poll_s: float = 15.0


@dataclass(frozen=True, slots=True)
class DeviceJob:
    """One device with everything that a run on it needs."""

    name: str
    endpoint: api.Endpoint
    desired_state: DesiredState
    """With `fitting`, what is taken for granted until the device has been asked."""
    fitting: StateVariants | None = None
    """What there is to choose from where the device decides; None: nothing."""
    site: str = ""
    address: str = ""
    """The device's own address on the way that we come; empty: the endpoint's, which a twin has not."""
    bearer: BearerProfile | None = None
    """What the session runs over, for the estimate; None: no estimate."""
    events: Subscriber = ignore
    journal: runs.Recorder = field(default_factory=runs.NoJournal)
    agreed_hash: str | None = None
    """Hash of the plan that a person has agreed to: another one is not applied."""
    confirmed_state: runs.SavedState | None = None
    """The state that a run has read back last, to say since when something differs."""
    patience: Patience = Patience()
    connect: Connect = api.Session.open
    ssh: SshEndpoint | None = None
    """The device's console; None: it has none that we may use."""
    console: OpenConsole = open_console
    run: str = ""
    """What the journal calls this run: a run that was killed is known by it when it is resumed."""
    nonce: str = field(default_factory=partial(token_hex, 3), compare=False)
    """Of this attempt alone: two laptops may begin in the same second, and have one address behind a NAT."""
    history: History = field(default_factory=NoHistory)
    allows_unprotected: bool = False
    """A person has said that a change may be made although nothing would take it back."""
    remove_foreign: bool = False
    """A person has said that rows of others may go by the hundred from menus that are ours entirely."""
    counted_ports: tuple[str, ...] = ()
    """Ports whose byte counters are read along, where that costs no round trip."""
    cost_policy: CostPolicy | None = None
    """Who says what the run may cost; None: it may cost anything."""
    shows: Callable[[_types.Observation], str] | None = None
    """Says why the device does not do what the change was for, or nothing; None: the rows alone are what it is for."""


@dataclass(frozen=True, slots=True)
class DeviceResult:
    """Result of a run on one device."""

    name: str
    status: Status
    exit: ExitCode
    message: str
    hint: str | None = None
    planned_count: int = 0
    """Actions of the plan."""
    rows: int = 0
    """Rows that they change: one action removes as many as go at once."""
    foreign_words: str = ""
    """What of the plan a person has to agree to apart; empty: nothing."""
    confirmed_count: int = 0
    """Actions that were read back and are permanent."""
    diff: str = ""
    drift: tuple[_types.Drift, ...] = ()
    comparison: Comparison | None = None
    """What differs, where the run was to say so."""
    notes: tuple[str, ...] = ()
    estimate: Estimate | None = None
    plan_hash: str = ""
    protection: str = "none"
    protection_words: str = ""
    """The same for a person, with the reason if it is not the best there is."""
    round_trips: int = 0
    sent_bytes: int = 0
    received_bytes: int = 0
    seconds: float = 0.0
    facts: _types.Facts | None = None
    sessions: int = 0
    """Connections to the device, also those that failed before the login was over."""
    counts: tuple[_types.PortCounts, ...] = field(default=(), compare=False)
    """The first and the last look at the byte counters of the job's ports, as far as it came."""
    busy: str = ""
    """Who is at work on the device besides this run, or what is left of them; empty: nobody was seen."""
    was_reached: bool = True
    """Whether a session with it came about, or nobody tried."""
    left_open: bool = False
    """The device may still hold safe mode or a job of this run, though nothing was changed."""
    is_stopped: bool = field(default=False, compare=False)
    """A person stopped the run before it was over: what would come after this device does not begin."""
    fault: BaseException | None = field(default=None, compare=False)
    """A fault of ours, for the log file."""

    def as_dict(self) -> Mapping[str, Any]:
        """Return the result as JSON-able data."""
        return {
            "status": self.status.value,
            "reached": self.was_reached,
            "exit": int(self.exit),
            "message": self.message,
            "hint": self.hint,
            "busy": self.busy,
            "planned": self.planned_count,
            "rows": self.rows,
            "foreign_words": self.foreign_words,
            "confirmed": self.confirmed_count,
            "diff": self.diff,
            "drift": [_drift(each) for each in self.drift],
            "comparison": None if self.comparison is None else self.comparison.as_dict(),
            "notes": list(self.notes),
            "estimate": None if self.estimate is None else _estimate(self.estimate),
            "plan_hash": self.plan_hash,
            "protection": self.protection,
            "protection_words": self.protection_words,
            "round_trips": self.round_trips,
            "bytes": {"sent": self.sent_bytes, "received": self.received_bytes},
            "seconds": round(self.seconds, 3),
            "version": None if self.facts is None else str(self.facts.version),
            "board": None if self.facts is None else self.facts.board,
        }


def _drift(drift: _types.Drift) -> dict[str, str]:
    return {"menu": drift.menu, "subject": drift.subject, "owner": drift.owner.value, "message": drift.message}


def _estimate(estimate: Estimate) -> dict[str, str | float]:
    return {
        "bearer": estimate.bearer,
        "round_trips": estimate.round_trips,
        "bytes": estimate.bytes,
        "seconds": round(estimate.seconds, 1),
    }


@dataclass(frozen=True, slots=True)
class Admission:
    """Decision whether a run may continue."""

    notes: tuple[str, ...] = ()
    """What its result shall say in any case."""
    refusal: str | None = None
    """Why it may not."""
    hint: str | None = None


class CostPolicy(Protocol):
    """The costs of the links, and the user's consent.

    The executor calls it once, after it has read the device and made its plan; the executor itself never decides.
    """

    def judge(
        self, observation: _types.Observation, estimate: Estimate | None, *, spends: bool, is_plan: bool
    ) -> Admission:
        """Decide whether a run may continue; `spends`: it would send more; `is_plan`: not before the user agrees.

        A run that sends nothing more is never refused.
        """


def stopped_before_turn(name: str) -> DeviceResult:
    """Return the result for a device that an interrupted run had not started."""
    status = Status.LEFT_AS_FOUND
    return DeviceResult(name, status, status.exit, "stopped by hand before its turn came: nothing was changed")


RADIO_MENUS = ("/interface/wireless", "/interface/wifi")


MISSING = ("no such command", "no such directory")


class Unfit(DeviceError):
    """No variant of the desired state fits this device."""


@dataclass(frozen=True, slots=True)
class StateVariants:
    """Variants of the desired state, chosen by the menu that contains the device's radio.

    The existence of a menu proves nothing: from 7.13 on `/interface/wifi` exists even without a radio in it. A radio of
    the board has a `default-name`, a virtual one has none.
    """

    states: Mapping[str, DesiredState]
    """Menu of the radio to what the device should then hold."""
    why: Callable[[Collection[str]], tuple[str, str]]
    """Given the menus in which the device has radios: why none of the states fits, and what to do about it."""
