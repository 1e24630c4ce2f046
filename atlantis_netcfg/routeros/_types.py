"""Value objects of the RouterOS engine: observation, plan and result of a change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.secret import MASK

if TYPE_CHECKING:
    from datetime import datetime

    from atlantis_netcfg.core.versions import Version

FEW_FOREIGN: Final = 100
"""So many rows of others may go from menus that are ours entirely without being asked for apart."""

Row = Mapping[str, str]
"""One item of a menu as the device's API returned it: property name to the device's own string, `.id` included."""


def is_bare(row: Row) -> bool:
    """Return True if only the `.id` of the row was read."""
    return row.keys() == {".id"}


@dataclass(frozen=True, slots=True)
class Facts:
    """Properties of the device and of our own session, read in the preflight."""

    identity: str
    version: Version
    board: str
    architecture: str
    device_mode: Mapping[str, str]
    packages: tuple[str, ...]
    policies: frozenset[str] | None
    """What our user may do; None: not asked yet, empty: the device does not tell."""
    has_safe_mode: bool
    safe_mode_owner: str | None
    """Who holds safe mode now, or None when nobody does (or the device has no safe mode)."""
    session_address: str
    """The address from which the device sees our session (`/user/active`)."""
    history: int
    """Entries in `/system/history` before the run."""

    def upgrade(self, to: Version) -> str:
        """Return the hint for a device whose version is below `to`."""
        return (
            f"put RouterOS {to} or later on it: `provision upgrade site=… device=… packages=FILE.npk`, where FILE.npk "
            f"is MikroTik's package for {self.architecture}"
        )


@dataclass(frozen=True, slots=True)
class PortCounts:
    """Byte counters of the ports, counted since the device started, for all traffic and not only ours."""

    at: datetime
    """When the answer was here, by this computer's clock, in UTC."""
    uptime_s: float | None
    """Since the device was started; None: it did not say."""
    ports: Mapping[str, tuple[int, int]]
    """Name of a port to the bytes that it has received and sent."""


@dataclass(frozen=True, slots=True)
class Observation:
    """Facts and rows of all requested menus, read together; rows are in device order."""

    facts: Facts
    rows: Mapping[str, tuple[Row, ...]]
    counts: tuple[PortCounts, ...] = field(default=(), compare=False)
    """What its ports had carried before and after the reading, where that was asked and cost no round trip."""
    modem: Row | None = field(default=None, compare=False)
    """What the modem says of its SIM, where a text declares one."""
    jobs: tuple[Row, ...] = field(default=(), compare=False)
    """Jobs of ours that its scheduler had armed."""
    uptime_s: float | None = field(default=None, compare=False)
    """Since the device was started; None: it did not say."""


class Verb(StrEnum):
    """Type of change to a menu."""

    ADD = "add"
    SET = "set"
    MOVE = "move"
    REMOVE = "remove"


class Layer(IntEnum):
    """Order of dependence: a row may only refer to rows of lower layers; rows are removed last."""

    NAMES = -1
    """Names of ports, before anything speaks of them."""
    FOUNDATION = 0
    """Names that others refer to: bridges, interface lists, routing tables, pools, address lists, settings."""
    ATTACHMENT = 1
    """What hangs on them: bridge ports, addresses, list members, DHCP servers, VPN clients."""
    POLICY = 2
    """What uses those: firewall, NAT, queues, leases, routes, routing rules."""
    CLEANUP = 3
    """What closes doors or takes things away: removals, services, default routes that move traffic."""


class RowOwner(StrEnum):
    """Owner of a row, according to its mark on the device."""

    OURS = "ours"
    OTHER = "other"


@dataclass(frozen=True, slots=True)
class Action:
    """One change of one menu, complete enough to be sent, shown, journalled and counted without further look-ups."""

    number: int
    layer: Layer
    menu: str
    """API path, e.g. `/ip/firewall/filter`."""
    verb: Verb
    subject: str
    """What a person calls the row, e.g. `10.64.1.1/24 on bridge-lan`."""
    ids: tuple[str, ...] = ()
    """`.id`s of existing rows for set, move and remove; empty for add and for a set of a settings menu."""
    values: tuple[tuple[str, str], ...] = ()
    """Properties to write; a name that starts with `!` is unset."""
    before: str | None = None
    """add, move: the `.id` of the existing row to stand before; None is the end of the menu."""
    secrets: frozenset[str] = frozenset()
    """Names in `values` that are never shown."""
    inert: bool = False
    """Cannot by itself change traffic, access or the management path (a pool, an address-list entry of a new list)."""
    line: int = 0
    """Where the text declares the row; 0: nowhere."""

    @property
    def weight(self) -> int:
        """Number of entries that this action takes in the device's history; counted per row (upper bound)."""
        return max(1, len(self.ids))

    def get_masked_values(self) -> tuple[tuple[str, str], ...]:
        """Return `values` with secrets masked, the only form allowed in plans, journals and logs."""
        return tuple((name, MASK if name in self.secrets else value) for name, value in self.values)


@dataclass(frozen=True, slots=True)
class Drift:
    """A difference that we must not change, or a change made outside of this tool."""

    menu: str
    subject: str
    owner: RowOwner
    message: str
    id: str = ""
    """The row's `.id`."""


@dataclass(frozen=True, slots=True)
class HiddenSecret:
    """A secret in the inventory that the device does not show, so that it cannot be compared."""

    menu: str
    subject: str
    name: str


@dataclass(frozen=True, slots=True)
class Plan:
    """All changes to one device, in the order in which they are sent."""

    device: str
    actions: tuple[Action, ...]
    diff: str
    """The same in the device's own export language with margins `+`, `-`; secrets masked; empty: nothing changes."""
    drift: tuple[Drift, ...] = ()
    hidden_secrets: tuple[HiddenSecret, ...] = ()
    notes: Sequence[str] = field(default_factory=tuple)
    foreign: tuple[tuple[str, int], ...] = ()
    """Menus (as a person writes them) that are ours entirely, and how many rows without our mark go from each."""

    @property
    def foreign_rows(self) -> int:
        """Number of rows without our mark that the plan removes."""
        return sum(number for _, number in self.foreign)

    @property
    def foreign_words(self) -> str:
        """Text that needs separate consent; empty if only a few foreign rows are removed."""
        if self.foreign_rows <= FEW_FOREIGN:
            return ""
        parts = ", ".join(f"{number} from {title}" for title, number in self.foreign)
        return f"removes {self.foreign_rows} rows that carry no mark of ours: {parts}"

    @property
    def weight(self) -> int:
        """Number of entries that the whole plan takes in the device's history."""
        return sum(action.weight for action in self.actions)
