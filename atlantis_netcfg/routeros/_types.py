"""Value objects of the RouterOS engine: observation, plan and result of a change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.secret import MASK

if TYPE_CHECKING:
    from datetime import datetime

    from atlantis_netcfg.core.versions import Version

FEW_FOREIGN: Final = 100
"""Maximum foreign rows removed from exclusively managed menus without separate consent."""

Row = Mapping[str, str]
"""One item of a menu as returned by the device's API: property name to the device's own string, with `.id`."""


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
    """Policies of our user; None: not requested yet, empty: not reported by the device."""
    has_safe_mode: bool
    safe_mode_owner: str | None
    """Session that holds safe mode now; None: nobody, or the device has no safe mode."""
    session_address: str
    """The address from which the device sees our session (`/user/active`)."""
    history: int
    """Number of entries in `/system/history` before the run."""

    def upgrade(self, to: Version) -> str:
        """Return the hint for a device whose version is below `to`."""
        return msg(
            f"install RouterOS {arg(to)} or later on it: `provision device upgrade site=… device=… packages=FILE.npk`, "
            f"where FILE.npk is MikroTik's package for {arg(self.architecture)}"
        )


@dataclass(frozen=True, slots=True)
class PortCounts:
    """Byte counters of the ports, counted since the device started, for all traffic and not only ours."""

    at: datetime
    """When the reply arrived, by this computer's clock, in UTC."""
    uptime_s: float | None
    """Seconds since the device started; None: not reported."""
    ports: Mapping[str, tuple[int, int]]
    """Maps a port name to its received and sent bytes."""


@dataclass(frozen=True, slots=True)
class Observation:
    """Facts and rows of all requested menus, read together; rows are in device order."""

    facts: Facts
    rows: Mapping[str, tuple[Row, ...]]
    counts: tuple[PortCounts, ...] = field(default=(), compare=False)
    """Port counters before and after reading, if requested and possible without a round trip."""
    modem: Row | None = field(default=None, compare=False)
    """Status of the SIM reported by the modem, if a text declares a modem."""
    jobs: tuple[Row, ...] = field(default=(), compare=False)
    """Our jobs that were armed in the device's scheduler."""
    uptime_s: float | None = field(default=None, compare=False)
    """Seconds since the device started; None: not reported."""


class Verb(StrEnum):
    """Type of change to a menu."""

    ADD = "add"
    SET = "set"
    MOVE = "move"
    REMOVE = "remove"


class Layer(IntEnum):
    """Order of dependence: a row may only refer to rows of lower layers; rows are removed last."""

    NAMES = -1
    """Names of ports, before any row refers to them."""
    FOUNDATION = 0
    """Names that other rows refer to: bridges, interface lists, routing tables, pools, address lists, settings."""
    ATTACHMENT = 1
    """Rows that refer to the foundation: bridge ports, addresses, list members, DHCP servers, VPN clients."""
    POLICY = 2
    """Rows that use the attachments: firewall, NAT, queues, leases, routes, routing rules."""
    CLEANUP = 3
    """Steps that remove access or rows: removals, services, default routes that move traffic."""


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
    """Readable name of the row, e.g. `10.64.1.1/24 on bridge-lan`."""
    ids: tuple[str, ...] = ()
    """`.id`s of existing rows for set, move and remove; empty for add and for a set of a settings menu."""
    values: tuple[tuple[str, str], ...] = ()
    """Properties to write; a leading `!` unsets the property."""
    before: str | None = None
    """For add and move: `.id` of the row before which the new position is; None is the end of the menu."""
    secrets: frozenset[str] = frozenset()
    """Names of properties in `values` that are never shown."""
    inert: bool = False
    """Cannot by itself change traffic, access or the management path (a pool, an address-list entry of a new list)."""
    line: int = 0
    """Line of the text that declares the row; 0: none."""

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
    """`.id` of the row."""


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
    """The changes in the device's export language with margins `+`, `-`; secrets masked; empty: no changes."""
    drift: tuple[Drift, ...] = ()
    hidden_secrets: tuple[HiddenSecret, ...] = ()
    notes: Sequence[str] = field(default_factory=tuple)
    foreign: tuple[tuple[str, int], ...] = ()
    """Exclusively managed menus (display names), with the number of unmarked rows removed from each."""

    @property
    def foreign_rows(self) -> int:
        """Number of rows without our mark that the plan removes."""
        return sum(number for _, number in self.foreign)

    @property
    def foreign_words(self) -> str:
        """Text that needs separate consent; empty if only a few foreign rows are removed."""
        if self.foreign_rows <= FEW_FOREIGN:
            return ""
        parts = join(", ", (msg(f"{arg(number)} from {arg(title)}") for title, number in self.foreign))
        return msg(f"removes {arg(self.foreign_rows)} rows that do not carry our mark: {arg(parts)}")

    @property
    def weight(self) -> int:
        """Number of entries that the whole plan takes in the device's history."""
        return sum(action.weight for action in self.actions)
