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
    from atlantis_netcfg.routeros.estimate import Estimate, LinkMetrics


class JobMode(StrEnum):
    """Scope of a run."""

    PLAN = "plan"
    APPLY = "apply"
    RESUME = "resume"
    """Like `apply`, after a run that was killed: first waits until the device has undone that run's open changes."""
    ROLLBACK = "rollback"
    """Like `apply`, with a saved state as desired state."""
    BACKUP = "backup"
    """Save the device's export; change nothing."""
    DRIFT = "drift"
    """Report differences from the desired state, since when and by whom; change nothing."""


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
    """SSH host key as printed by OpenSSH, `SHA256:...`; None: no key pinned yet."""
    opening: Callable[[api.Traffic], object] = field(default=lambda _traffic: None, repr=False, compare=False)
    """See `opening` of the API's endpoint."""


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
    """Timeout for a device that disappears during a change: a reboot, or the gaps of a satellite link."""
    verify_s: float = 180.0
    """Timeout for the new session that verifies the device's reachability; after it the change is rolled back."""
    undo_s: float = 720.0
    """Wait for safe mode of a dead session: after a silent loss the device notices it after about nine minutes."""
    dead_man_s: float = 600.0
    """Time from arming a dead-man job until it rolls back unconfirmed changes; with safe mode, `undo_s` is added."""
    modem_s: float = 90.0
    """Time for a modem that restarts with a PIN, until it reports whether the SIM accepted it."""
    settle_s: float = 10.0
    """Time until the device uses routes that were just written."""
    first_poll_s: float = 1.0
    last_poll_s: float = 15.0


@dataclass(frozen=True, slots=True)
class DeviceJob:
    """One device with everything that a run on it needs."""

    name: str
    endpoint: api.Endpoint
    desired_state: DesiredState
    """With `fitting`: the assumed state until the device has been read."""
    fitting: StateVariants | None = None
    """Variants to choose from by the hardware of the device; None: no choice."""
    site: str = ""
    address: str = ""
    """The device's own address on our route; empty: the endpoint's address, which an emulated device does not have."""
    link: LinkMetrics | None = None
    """Link of the session, for the estimate; None: no estimate."""
    events: Subscriber = ignore
    journal: runs.Recorder = field(default_factory=runs.NoJournal)
    agreed_hash: str | None = None
    """Hash of the plan to which the user consented: a different plan is not applied."""
    confirmed_state: runs.SavedState | None = None
    """The state that a run last read back, to date differences."""
    patience: Patience = Patience()
    connect: Connect = api.Session.open
    ssh: SshEndpoint | None = None
    """SSH console of the device; None: no console that we may use."""
    console: OpenConsole = open_console
    run: str = ""
    """Run id in the journal; `resume` uses it to recognise a run that was killed."""
    nonce: str = field(default_factory=partial(token_hex, 3), compare=False)
    """Unique to this attempt: two laptops may start in the same second, with one address behind a NAT."""
    history: History = field(default_factory=NoHistory)
    allows_unprotected: bool = False
    """The user accepts a change that nothing would roll back."""
    remove_foreign: bool = False
    """The user accepts that hundreds of foreign rows are removed from exclusively managed menus."""
    counted_ports: tuple[str, ...] = ()
    """Ports whose byte counters are also read, where that needs no extra round trip."""
    cost_policy: CostPolicy | None = None
    """Policy that decides what the run may cost; None: no limit."""
    shows: Callable[[_types.Observation], str] | None = None
    """Returns why the change had no effect on the device, else an empty text; None: only the rows are checked."""


@dataclass(frozen=True, slots=True)
class DeviceResult:
    """Result of a run on one device."""

    name: str
    status: Status
    exit: ExitCode
    message: str
    hint: str | None = None
    planned_count: int = 0
    rows: int = 0
    """Rows that the actions change: one action removes as many rows as can be removed at once."""
    foreign_words: str = ""
    """Part of the plan that needs separate consent; empty: none."""
    confirmed_count: int = 0
    """Actions that were read back and are permanent."""
    diff: str = ""
    drift: tuple[_types.Drift, ...] = ()
    comparison: Comparison | None = None
    """Differences, if the run had to report them."""
    notes: tuple[str, ...] = ()
    estimate: Estimate | None = None
    plan_hash: str = ""
    protection: str = "none"
    protection_words: str = ""
    """Description of `protection` for the user, with the reason if it is not the best one."""
    round_trips: int = 0
    sent_bytes: int = 0
    received_bytes: int = 0
    seconds: float = 0.0
    facts: _types.Facts | None = None
    sessions: int = 0
    """Connections to the device, including those that failed before login was complete."""
    counts: tuple[_types.PortCounts, ...] = field(default=(), compare=False)
    """First and last reading of the byte counters of the job's ports, if they were read."""
    busy: str = ""
    """Other users or runs active on the device, or their leftovers; empty: none detected."""
    was_reached: bool = True
    """Whether a session was established; also True if none was tried."""
    left_open: bool = False
    """The device may still hold safe mode or a job of this run, although nothing was changed."""
    is_stopped: bool = field(default=False, compare=False)
    """The user stopped the run before its end: devices that depend on this one are not started."""
    fault: BaseException | None = field(default=None, compare=False)
    """An internal error, for the log file."""

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
        "bearer": estimate.link,
        "round_trips": estimate.round_trips,
        "bytes": estimate.bytes,
        "seconds": round(estimate.seconds, 1),
    }


@dataclass(frozen=True, slots=True)
class Admission:
    """Decision whether a run may continue."""

    notes: tuple[str, ...] = ()
    """Notes for the result in any case."""
    refusal: str | None = None
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
    return DeviceResult(name, status, status.exit, "stopped by the user before its turn: nothing was changed")


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
    """Maps the menu of the radio to the desired state of the device."""
    why: Callable[[Collection[str]], tuple[str, str]]
    """Returns why no state fits the menus in which the device has radios, and how to correct it."""
