"""State of an emulated router: rows, history, sessions, files, clock; driven by `Device`, changed by commands.

Also the undo history and safe mode (Manual, Configuration Management: Safe Mode, Undo/Redo).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from ipaddress import IPv4Address, ip_address, ip_network
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.emulator.routeros.network.topology import Topology
from atlantis_netcfg.emulator.routeros.schema import Schema, features_of
from atlantis_netcfg.emulator.routeros.spec import Deviation, RouterSpec
from atlantis_netcfg.emulator.routeros.store import ActionHistory, RowStore

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros import answers
    from atlantis_netcfg.emulator.routeros.dataplane.live import LiveNetwork, PacketProbe
    from atlantis_netcfg.emulator.routeros.radio._settings import RadioState

_LOG_LINES = 1000
NETWATCH_GROUP = "*netwatch"
NETWATCH_POLICIES = frozenset({"read", "reboot", "test", "write"})
"""Permissions of netwatch scripts, whoever wrote them (Manual, Netwatch)."""
GREETINGS = ("licence", "default-configuration", "password")
"""Prompts at the first login, in order."""


@dataclass(frozen=True, slots=True)
class FlashFile:
    """A text file on the flash; folders exist only as parts of file names."""

    number: int
    contents: str
    modified_at: str
    folder: bool = False


@dataclass(frozen=True, slots=True)
class Record:
    """An entry of `/log`."""

    number: int
    time: str
    topics: str
    message: str


@dataclass(slots=True)
class Listener:
    """An active `/listen`: its menu, and the rows already shown."""

    caller: answers.Caller
    tag: str
    call: Call
    shown_rows: dict[str, dict[str, str]] = field(default_factory=dict)


@dataclass(slots=True)
class NetwatchState:
    """State of a `/tool/netwatch` row: the current test and the last results."""

    values: dict[str, str]
    """Properties of the row when its test started; a change restarts it."""
    at: float
    """Time of the next action: send a packet, or stop waiting."""
    start: float
    """Start time of the test."""
    sent_count: int = 0
    answer_count: int = 0
    waiting: bool = False
    """Whether all packets are sent and at least one has no response yet."""
    status: str = "unknown"
    since: float = 0.0
    test_count: int = 0
    failure_count: int = 0
    last: tuple[int, int] = (0, 0)
    """Packets sent and answered in the last complete test."""
    open_probes: list[PacketProbe] = field(default_factory=list)
    """Packets of the test without a response so far, with a live data plane."""


@dataclass(slots=True)
class NextHop:
    """A next hop that `check-gateway` watches."""

    at: float
    missed_count: int = 0
    waiting: bool = False
    probe: PacketProbe | None = None
    """The packet that is waited for, with a live data plane."""


@dataclass(slots=True)
class WatchedHost:
    """Hosts and gateways that the router probes."""

    rows: dict[int, NetwatchState] = field(default_factory=dict)
    gateways: dict[IPv4Address, NextHop] = field(default_factory=dict)
    revision: int | None = None
    """Configuration revision at the last synchronisation; None: the router has just started."""


class Core:
    """The whole state of one router."""

    live: LiveNetwork | None = None
    """Namespace that carries packets as the rows say; None: what becomes of a packet is computed from the rows."""

    def __init__(  # noqa: PLR0915 - one line for each thing
        self, spec: RouterSpec, now: Callable[[], float], dispatch: Handler
    ) -> None:
        self.spec = spec
        self.now = now
        self.dispatch = dispatch
        """Executes a command: scripts run commands, and commands run scripts."""
        self.started = now()
        self.schema = Schema(spec.version, spec.packages, features_of(spec.board, poe=bool(spec.poe_ports)))
        self.store = RowStore(self.schema, reuses_ids=Deviation.IDS in spec.deviations)
        self.octets: dict[str, tuple[int, int]] = {}
        """Factory name of a port to bytes received and sent since the start: only our sessions and its pings."""
        self.met: dict[tuple[str, int], tuple[int, int]] = {}
        """Menu and row of a rule to the packets and octets it matched: the router's own pings and forwarded traffic."""
        self.history = ActionHistory(spec.history_limit)
        self.first_names: dict[str, str] = {}
        """New interface names to earlier ones while routes still show the earlier ones (`Deviation.NAMES`)."""
        self.sessions: dict[int, answers.Caller] = {}
        self.listeners: list[Listener] = []
        self.outbox: list[tuple[int, str, answers.Answer]] = []
        """Responses to be sent later: session, tag, response."""
        self.files: dict[str, FlashFile] = {}
        self.log: list[Record] = []
        self.wants_reboot = False
        self.ended: set[int] = set()
        """Sessions to be ended; the owner of the sockets closes them."""
        self.certificates: dict[str, dict[str, str]] = {}
        """Properties of certificates set by their creator: fingerprint, validity."""
        self.keys: dict[int, str] = {}
        """Key and certificate of rows of `/certificate` as PEM text; a row without them is an unsigned template."""
        self.wraps: dict[int, str] = {}
        """Keys of tls-crypt by interface: set by an import, shown by no menu."""
        self.ran: dict[int, float] = {}
        """Time of the last run of each scheduler job."""
        self.run_counts: dict[int, int] = {}
        self.expires: dict[int, float] = {}
        """Expiry times of dynamic address-list entries."""
        self.scheduled_since: dict[int, float] = {}
        """Time when each job was first seen; runs due before that are skipped."""
        self.menus: dict[int, str] = {}
        """Current menu path of each console session that is not at the root."""
        self.numbered: dict[tuple[int, str], list[str]] = {}
        """Ids by row number, from the last print of a menu in a console session."""
        self.notices: list[tuple[int, str]] = []
        """Unsolicited console messages: session, text."""
        self.greetings: tuple[str, ...] = GREETINGS if spec.factory else ()
        """Prompts that the first user to log in has yet to answer."""
        self.radios: dict[str, RadioState] = {}
        """State of each radio by factory name, set by the emulated radio link."""
        self.linked: frozenset[int] = frozenset()
        """Radios connected to another radio, and a modem connected to its network."""
        self.sim = SimState(spec.modem.sim.tries if spec.modem is not None and spec.modem.sim is not None else 0)
        self.silent: frozenset[IPv4Address] = frozenset()
        """Addresses that do not respond by any route; set by the emulator of the surroundings."""
        self.dead: frozenset[IPv4Address] = frozenset()
        """Gateways that `check-gateway` found unreachable."""
        self.watched = WatchedHost()
        self.boot_clock = spec.clock
        self.script_cache: dict[str, list[Any]] = {}
        """Parsed statements of executed scripts (`console.run`): a watched host runs its script at each test."""
        self._topology: Topology | None = None
        self._numbers = 0

    def count(self, port: str, *, is_received: bool, size: int) -> None:
        """Increase a port's byte counter."""
        rx, tx = self.octets.get(port, (0, 0))
        self.octets[port] = (rx + size, tx) if is_received else (rx, tx + size)

    @property
    def topology(self) -> Topology:
        """Network topology of the current configuration."""
        if self._topology is None or self._topology.revision != self.store.revision:
            self._topology = Topology(self.store, self.linked | connected_clients(self), self.dead)
        return self._topology

    def deviates(self, deviation: Deviation) -> bool:
        """Return whether this router deviates from an assumption."""
        return deviation in self.spec.deviations

    def number(self) -> int:
        """Allocate a number for a session, file or log line."""
        self._numbers += 1
        return self._numbers

    def time(self) -> datetime:
        """Return the time of the router's clock."""
        return self.moment(self.now())

    def moment(self, when: float) -> datetime:
        """Convert a time of `now` to the router's clock."""
        return self.boot_clock + timedelta(seconds=when - self.started)

    def resume(self, before: Core) -> None:
        """Continue with the clock and session numbers from before a restart."""
        self.boot_clock = before.time()
        self.silent = before.silent
        if before.live is not None:
            self.live = before.live
            self.live.restart(self)
        self._numbers = before.number()
        self.sim = before.sim
        self.sim.restart()

    def set_clock(self, moment: datetime) -> None:
        """Set the router's clock."""
        self.boot_clock += moment - self.time()

    def stamp(self, moment: datetime | None = None) -> str:
        """Format a time as this version does: `2026-01-31 12:00:00`, before 7.10 `jan/31/2026 12:00:00`."""
        moment = moment or self.time()
        new = self.schema.at_least("7.10")
        return moment.strftime("%Y-%m-%d %H:%M:%S") if new else moment.strftime("%b/%d/%Y %H:%M:%S").lower()

    def free_space(self, *, besides: str = "") -> int:
        """Return the bytes free for a file that replaces `besides`."""
        used = sum(len(file.contents) for name, file in self.files.items() if name != besides)
        return max(0, self.spec.disk_bytes - used)

    def note(self, topics: str, message: str) -> None:
        """Write a log entry."""
        self.log.append(Record(self.number(), self.stamp(), topics, message))
        del self.log[:-_LOG_LINES]

    def policies(self, caller: answers.Caller) -> frozenset[str]:
        """Return the session's rights: the policies of its user's group."""
        if caller.group == NETWATCH_GROUP:
            return NETWATCH_POLICIES
        groups = self.store.table("/user/group")
        for item in groups.items:
            if self.store.text(groups, item, "name") == caller.group:
                policies = (self.store.text(groups, item, "policy") or "").split(",")
                return frozenset(policy for policy in policies if not policy.startswith("!"))
        return frozenset()


@dataclass(slots=True)
class SimState:
    """State of the SIM card; `tries_left` survives a power loss, everything else restarts with the modem."""

    tries_left: int
    pins_entered: int = 0
    """Number of PINs that reached the card since the emulator was created; counted for tests."""
    is_unlocked: bool = False
    is_refused: bool = False
    """Whether the latest PIN was wrong."""
    tried_pin: str | None = None
    """PIN entered by the modem since its start or since another PIN was set; None: none yet."""
    connected_since: float | None = None
    last_line: str = ""
    """Last log line about the card, so that each is written only once."""

    def enter(self, pin: str, right: str) -> None:
        """Enter a PIN: the card counts wrong ones, and a correct one resets the count."""
        self.tried_pin = pin
        if self.is_unlocked or self.tries_left == 0:
            return
        self.pins_entered += 1
        self.is_unlocked = pin == right
        self.is_refused = not self.is_unlocked
        self.tries_left = 3 if self.is_unlocked else self.tries_left - 1

    def swap(self, tries_left: int) -> None:
        """Insert another card, or the same card with another count."""
        self.tries_left = tries_left
        self.last_line = ""
        self.restart()

    def restart(self) -> None:
        """Restart the modem: a card with a PIN is locked again."""
        self.is_unlocked = self.is_refused = False
        self.tried_pin = None
        self.connected_since = None


CLIENTS = "/interface/ovpn-client"


def connected_clients(core: Core) -> frozenset[int]:
    """Return the OpenVPN clients that the server accepts."""
    open_tunnels = core.spec.around.tunnels
    if not open_tunnels or not core.schema.has_menu(CLIENTS):
        return frozenset()
    table = core.store.table(CLIENTS)
    return frozenset(item.id for item in table.items if core.store.text(table, item, "name") in open_tunnels)


@dataclass(slots=True)
class Call:
    """A command of a menu with its arguments."""

    caller: answers.Caller
    menu: str
    command: str
    arguments: dict[str, str] = field(default_factory=dict)
    unset: tuple[str, ...] = ()
    queries: tuple[str, ...] = ()
    console: bool = False
    """From a console or script, not an API sentence: rows may be addressed by number."""

    @property
    def path(self) -> str:
        """Menu and command as one path."""
        return f"{self.menu.rstrip('/')}/{self.command}"


@dataclass(slots=True)
class CallResult:
    """Result of a command: rows for `!re`, a value for `=ret=`, text for a console."""

    rows: list[dict[str, str]] = field(default_factory=list)
    ret: str | None = None
    text: str = ""
    listing: bool = False
    """Output of a print: without rows the API answers `!empty` from 7.18."""


Handler = Callable[["Core", Call], CallResult]


_TAKEOVER_MESSAGE = "[Safe mode released by another user]"


def notify_holder_lost(core: Core, caller: answers.Caller) -> None:
    """Notify a console whose safe mode another session ends."""
    holder = core.history.holder
    if holder is not None and holder.number != caller.number and holder.via in _CONSOLES:
        core.notices.append((holder.number, _TAKEOVER_MESSAGE))


_CONSOLES = ("ssh", "console")


@dataclass(frozen=True, slots=True)
class Service:
    """A row of `/ip/service` for the network side; `certificate` is None if none is set."""

    name: str
    port: int
    is_enabled: bool
    certificate: str | None
    max_sessions: int
    tls_version: str
    address: str = ""
    """Networks accepted as clients, as in `/ip/service`; empty: all."""

    def admits(self, caller: str) -> bool:
        """Return whether the service accepts this address; others get a closed connection (Manual, Services)."""
        networks = [ip_network(part) for part in self.address.split(",") if part]
        return not networks or any(ip_address(caller) in network for network in networks)


def services_of(core: Core) -> Mapping[str, Service]:
    """Return the currently configured services by name."""
    store = core.store
    table = store.table("/ip/service")
    result = {}
    for item in table.items:
        name = store.text(table, item, "name") or ""
        certificate = store.text(table, item, "certificate")
        result[name] = Service(
            name=name,
            port=int(store.text(table, item, "port") or 0),
            is_enabled=store.text(table, item, "disabled") != "yes",
            certificate=None if certificate in (None, "none") else certificate,
            max_sessions=int(store.text(table, item, "max-sessions") or 20),
            tls_version=store.text(table, item, "tls-version") or "any",
            address=store.text(table, item, "address") or "",
        )
    return result
