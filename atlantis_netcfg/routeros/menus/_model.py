"""The planner's model of a menu: how to recognise rows, the meaning of properties, when rows may be sent.

Also here: the short functions used to write the table, one for each kind of value.

Defaults are those of verbose exports of RouterOS 7.17 to 7.19 and of the manual; if neither gives one, the field is
`keep`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum, auto
from functools import cached_property
from string import Formatter
from typing import TYPE_CHECKING

from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros.menus._values import PropertyKind, canonical

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from atlantis_netcfg.routeros._types import Layer, Row


MARK = "atlantis"
"""A row whose comment starts with this mark is ours."""


class Shape(Enum):
    """Kind of a menu, by its commands: `add`, `set` with `numbers`, or `set` alone."""

    LIST = auto()
    FIXED = auto()
    """Rows provided by the hardware or the system: they can be set, not added or removed."""
    SINGLETON = auto()


@dataclass(frozen=True)
class Field:
    """One argument of `add` or `set` that is also a property of the printed row."""

    name: str
    kind: PropertyKind = PropertyKind.TEXT
    default: str | None = None
    """Value that the device assumes without the argument, as printed; None: the row then lacks the property."""
    keep: bool = False
    """Unchanged unless the text sets it: the device computes it, or others may have set it with good reason.

        With a default, only a saved export that omits it means that default.
    """
    like: str | None = None
    """Property of the same row whose value is the default."""
    secret: bool = False
    unread: bool = False
    """Can be written but never read, so that it is sent only with a new row."""
    is_prompted: bool = False
    """Sent only while the device requests it: every entry of a wrong value has a cost."""
    cosmetic: bool = False
    """Neither matches nor decides: may be changed in place on a first-match row."""
    board: bool = False
    """Depends on the hardware: a row that does not print the property cannot take it."""
    since: Version | None = None
    """First version whose command tree contains it; None: all supported versions."""
    until: Version | None = None
    """First version whose command tree no longer contains it; None: none."""

    @cached_property
    def absent(self) -> str:
        """The canonical form of an omitted property."""
        if self.kind is PropertyKind.FLAG:
            return "no"
        return canonical(self.kind, self.default or "")

    def form(self, text: str | None) -> str:
        """Return the canonical form of a value of this property; None is the property left out."""
        return self.absent if text is None else canonical(self.kind, text)

    def exists(self, version: Version) -> bool:
        """Return True if that version has the argument."""
        return (self.since is None or version >= self.since) and (self.until is None or version < self.until)


@dataclass(frozen=True, repr=False)
class Menu:
    """One menu of the device: a row of the table."""

    path: str
    """API path: `/ip/firewall/filter`."""
    shape: Shape
    layer: Layer
    fields: tuple[Field, ...]
    keys: tuple[str, ...] = ()
    """Properties that identify a row; empty for settings and for first-match menus, where all content does."""
    chain: str | None = None
    """The property that splits a first-match menu into lists whose order matters only within each."""
    is_ordered: bool = False
    """The first matching row decides, so that rows are identified by content and position."""
    unique: tuple[str, ...] = ()
    """Further properties of which the device allows each value only once."""
    subject: str = ""
    """Readable name of a row, with properties in braces; settings are named by their menu."""
    flags: tuple[str, ...] = ()
    """Properties that are read but never written."""
    stock: tuple[tuple[str, ...], ...] = ()
    """Built-in rows (their keys), in system order: can be set, not removed, and never count as drift."""
    row_defaults: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    """Defaults of single rows, by their first key, where they differ from the menu's defaults."""
    late: tuple[tuple[str, str], ...] = ()
    """Rows with all of these values move traffic at once: they are sent in the last layer."""
    inert: bool = False
    """A new row of this menu cannot by itself change traffic, access or the management path."""
    named_by: tuple[str, ...] = ()
    """With `inert`: properties of other rows that may already refer to the new row; then it is not inert."""
    readonly: bool = False
    """The menu is read and never written."""
    is_exported: bool = True
    """False: `export` omits the menu, so that a saved export does not contain it."""
    since: Version | None = None
    has_config_view: bool = False
    """Rows inherit from others: `print config` shows a row's own values, plain `print` the effective ones."""

    def __repr__(self) -> str:
        return f"<Menu {self.path}>"

    @cached_property
    def by_name(self) -> Mapping[str, Field]:
        """The fields by their names."""
        return {each.name: each for each in self.fields}

    @cached_property
    def alphabetical(self) -> tuple[Field, ...]:
        """The fields in the order of exports."""
        return tuple(sorted(self.fields, key=lambda each: each.name))

    @property
    def secrets(self) -> frozenset[str]:
        """Names of the secret properties."""
        return frozenset(each.name for each in self.fields if each.secret)

    @property
    def defaults(self) -> Mapping[str, str]:
        """The device's defaults for omitted arguments."""
        return {each.name: each.default for each in self.fields if each.default is not None}

    @property
    def title(self) -> str:
        """The path as the console and exports write it: `/ip firewall filter`."""
        return "/" + self.path.strip("/").replace("/", " ")

    def identity(self, values: Mapping[str, str]) -> tuple[str, ...]:
        """Return the values of the key properties, in canonical form."""
        return tuple(self.by_name[key].form(values.get(key)) for key in self.keys)

    def name_of(self, values: Mapping[str, str]) -> str:
        """Return the name of the row with these values, for the user."""
        if self.shape is Shape.SINGLETON:
            return f"{self.title.removesuffix(' settings')} settings"
        names = {name for _, name, _, _ in Formatter().parse(self.subject) if name}
        display_values = {name: values.get(name) or self.by_name[name].default or "" for name in names}
        if "comment" in display_values:
            display_values["comment"] = display_values["comment"].removeprefix(MARK).lstrip(": ")
        return " ".join(self.subject.format_map(display_values).split()) or self.title

    def default_of(self, name: str, values: Mapping[str, str]) -> str | None:
        """Return the default of a property in the row with these values."""
        field_ = self.by_name[name]
        local = self.row_defaults.get(values.get(self.keys[0], ""), {}) if self.keys else {}
        return local.get(name, values.get(field_.like) if field_.like else field_.default)

    def form(self, name: str, values: Mapping[str, str]) -> str:
        """Return the canonical form of a property of the row with these values, its default included."""
        text = values.get(name)
        return self.by_name[name].form(self.default_of(name, values) if text is None else text)

    def is_ours(self, row: Row) -> bool:
        """Tell whether the row carries our mark."""
        return "comment" in self.by_name and row.get("comment", "").startswith(MARK)

    def is_stock(self, row: Row) -> bool:
        """Return True if the row is a system row that cannot be removed."""
        return canonical(PropertyKind.BOOLEAN, row.get("default", "no")) == "yes" or self.identity(row) in self.stock

    def is_touchable(self, row: Row) -> bool:
        """Return True if the device allows changes to the row: not to dynamic and builtin ones."""
        return not any(row.get(flag) in ("true", "yes") for flag in ("dynamic", "builtin"))


def text(name: str, default: str | None = "") -> Field:
    return Field(name, PropertyKind.TEXT, default)


def texts(names: str, default: str | None = None) -> tuple[Field, ...]:
    return tuple(text(name, default) for name in names.split())


def boolean(name: str, default: str | None = "no") -> Field:
    return Field(name, PropertyKind.BOOLEAN, default)


def flag(name: str) -> Field:
    return Field(name, PropertyKind.FLAG)


def number(name: str, default: str | None = None) -> Field:
    return Field(name, PropertyKind.NUMBER, default)


def time(name: str, default: str | None = None) -> Field:
    return Field(name, PropertyKind.TIME, default)


def size(name: str, default: str | None = None) -> Field:
    return Field(name, PropertyKind.SIZE, default)


def rate(name: str, default: str | None = None) -> Field:
    return Field(name, PropertyKind.RATE, default)


def mac(name: str, default: str | None = None) -> Field:
    return Field(name, PropertyKind.MAC, default)


def prefix(name: str, default: str | None = None) -> Field:
    return Field(name, PropertyKind.PREFIX, default)


def network(name: str, default: str | None = None) -> Field:
    return Field(name, PropertyKind.NETWORK, default)


def prefixes(name: str, default: str | None = "") -> Field:
    return Field(name, PropertyKind.PREFIXES, default)


def words(name: str, default: str | None = "") -> Field:
    return Field(name, PropertyKind.SET, default)


def sequence(name: str, default: str | None = "") -> Field:
    return Field(name, PropertyKind.SEQUENCE, default)


def policy(name: str) -> Field:
    return Field(name, PropertyKind.POLICY, "")


def interface(name: str, default: str | None = None) -> Field:
    return Field(name, PropertyKind.INTERFACE, default)


def gateway(name: str) -> Field:
    return Field(name, PropertyKind.GATEWAY, "")


def keep(*fields: Field) -> tuple[Field, ...]:
    """Mark fields without a known default: if not set, they stay as they are."""
    return tuple(replace(field, keep=True, default=None) for field in fields)


def usual(*fields: Field) -> tuple[Field, ...]:
    """Mark fields left unchanged when the inventory does not set them; omitted in a saved export means the default."""
    return tuple(replace(field, keep=True) for field in fields)


def like(other: str, field: Field) -> Field:
    return replace(field, like=other)


def secret(field: Field) -> Field:
    return replace(field, secret=True)


def unread(field: Field) -> Field:
    return replace(field, unread=True, keep=True)


def on_prompt(field: Field) -> Field:
    """Mark a field that is only sent while the device asks for it (routeros/pin.py)."""
    return replace(field, is_prompted=True)


def cosmetic(field: Field) -> Field:
    return replace(field, cosmetic=True)


def on_board(fields: Iterable[Field]) -> tuple[Field, ...]:
    return tuple(replace(field, board=True) for field in fields)


def since(version: str, *fields: Field) -> tuple[Field, ...]:
    """Mark fields that exist from that version on."""
    return tuple(replace(field, since=Version.parse(version)) for field in fields)


def until(version: str, *fields: Field) -> tuple[Field, ...]:
    """Mark fields that no longer exist in that version."""
    return tuple(replace(field, until=Version.parse(version)) for field in fields)


COMMENT = cosmetic(text("comment"))
DISABLED = boolean("disabled")
