"""`print` for people: lists of values, tables, `detail`, `terse` (Manual, Console: General commands).

Layouts follow public transcripts (networktocode/ntc-templates, ytti/oxidized): version 7 shows only used flags and
columns, with comments above their row; version 6 shows all flags, with comments behind the number. Columns are those of
the transcripts if there is one; a menu without an entry here shows its first arguments.

Assumption: console-columns
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.menus import Shape

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.emulator.routeros.core import Core

COLUMNS: dict[str, tuple[str, ...]] = {
    "/certificate": ("name", "common-name", "subject-alt-name", "fingerprint"),
    "/file": ("name", "type", "size", "creation-time", "last-modified"),
    "/interface": ("name", "type", "actual-mtu", "l2mtu", "max-l2mtu", "mac-address"),
    "/interface/bridge/port": ("interface", "bridge", "hw", "pvid", "priority", "path-cost", "horizon"),
    "/interface/ethernet": ("name", "mtu", "mac-address", "arp", "switch"),
    "/interface/ethernet/poe": (
        "name",
        "poe-out",
        "poe-priority",
        "power-cycle-ping-enabled",
        "power-cycle-interval",
    ),
    "/interface/list": ("name",),
    "/interface/list/member": ("list", "interface"),
    "/interface/vlan": ("name", "mtu", "arp", "vlan-id", "interface"),
    "/ip/address": ("address", "network", "interface"),
    "/ip/dhcp-client": ("interface", "use-peer-dns", "add-default-route", "status", "address"),
    "/ip/dhcp-server": ("name", "interface", "address-pool", "lease-time"),
    "/ip/dhcp-server/network": ("address", "gateway", "dns-server"),
    "/ip/dns/static": ("name", "type", "address", "ttl"),
    "/ip/firewall/address-list": ("list", "address", "creation-time", "timeout"),
    "/ip/pool": ("name", "ranges"),
    "/ip/route": ("dst-address", "gateway", "routing-table", "distance"),
    "/ip/service": ("name", "port", "address", "certificate", "vrf", "max-sessions"),
    "/ipv6/address": ("address", "from-pool", "interface", "advertise"),
    "/log": ("time", "topics", "message"),
    "/routing/table": ("name",),
    "/system/history": ("action", "by", "policy", "time"),
    "/system/logging": ("topics", "action"),
    "/system/package": ("name", "version", "build-time", "size"),
    "/system/scheduler": ("name", "start-date", "start-time", "interval", "on-event", "run-count"),
    "/tool/netwatch": ("type", "host", "timeout", "interval", "status", "since"),
    "/user": ("name", "group", "address", "last-logged-in"),
    "/user/active": ("when", "name", "address", "via"),
}

DETAILED_MENUS = frozenset(
    {
        "/interface/bridge",
        "/interface/lte",
        "/interface/wireless",
        "/interface/wireless/security-profiles",
        "/ip/firewall/filter",
        "/ip/firewall/mangle",
        "/ip/firewall/nat",
        "/ip/firewall/raw",
        "/ipv6/firewall/filter",
        "/queue/simple",
        "/routing/rule",
        "/system/script",
        "/user/group",
    }
)

FLAGS: dict[str, str] = {
    "dynamic": "D",
    "disabled": "X",
    "invalid": "I",
    "inactive": "I",
    "builtin": "*",
    "default": "*",
    "radius": "R",
    "running": "R",
    "active": "A",
    "undoable": "U",
    "redoable": "R",
    "floating-undo": "F",
    "expired": "E",
    "authority": "A",
    "private-key": "K",
    "trusted": "T",
    "slave": "S",
    "static": "s",
    "connect": "c",
    "connection": "c",
    "ecmp": "+",
    "hw-offload": "H",
}
"""Property to its letter; letters of true properties are printed before the row in this order."""

QUOTED_NAMES = frozenset(
    {
        "by",
        "comment",
        "contents",
        "default-name",
        "group",
        "identity",
        "log-prefix",
        "message",
        "name",
        "note",
        "on-event",
        "owner",
        "platform",
        "redo",
        "source",
        "supplicant-identity",
        "type",
        "undo",
        "version",
    }
)
"""Text properties that `print detail` always quotes; other properties only if the value contains a space."""


def flag_letters(row: dict[str, str], flags: tuple[str, ...]) -> str:
    """Return the flag letters of a row."""
    return "".join(FLAGS[name] for name in flags if row.get(name) in ("true", "yes"))


Row = dict[str, str]

_WIDEST = 4
_KILO = 4096
_SIZES = frozenset({"free-hdd-space", "free-memory", "size", "total-hdd-space", "total-memory"})
_UNITS = {"cpu-frequency": "MHz", "cpu-load": "%"}
_WIDE = 10_000


@dataclass(frozen=True, slots=True)
class PrintView:
    """Options of a `print`: menu, words after `print`, and properties of `proplist`."""

    menu: str
    words: frozenset[str]
    columns: tuple[str, ...] = ()
    width: int | None = None


def render_print(core: Core, view: PrintView, rows: Sequence[Row]) -> list[str]:
    """Render the output of a `print`."""
    v7 = core.schema.at_least("7.0")
    if _is_single_row(core, view.menu):
        return _values(rows[0] if rows else {}, view, is_padded=core.schema.at_least("7.18"))
    if view.menu == "/log" and not view.words & {"detail", "terse"}:
        return [f" {row['time'].rpartition(' ')[2]} {row['topics']} {row['message']} " for row in rows]
    flags = tuple(name for name in FLAGS if any(row.get(name) in ("true", "false") for row in rows))
    if "terse" in view.words:
        return [_terse(number, row, flags, view) for number, row in enumerate(rows)]
    if "detail" in view.words or (view.menu in DETAILED_MENUS and "brief" not in view.words):
        return [*_legend(rows, flags, upper=False, all_flags=True), *_details(rows, flags, view)]
    table = _table7 if v7 else _table6
    return table(rows, flags, view, columns_of(core, view.menu) if not view.columns else view.columns)


def as_value_rows(core: Core, view: PrintView, rows: Sequence[Row]) -> list[Row]:
    """Return the properties for `as-value`: those named, with `detail` all, else those of the table."""
    if view.columns:
        return [{name: value for name, value in row.items() if name in (".id", *view.columns)} for row in rows]
    if view.words & {"detail", "stats"} or _is_single_row(core, view.menu):
        return list(rows)
    names = (".id", *columns_of(core, view.menu), "comment")
    return [{name: row[name] for name in names if name in row} for row in rows]


def render_report(command: str, rows: Sequence[Row]) -> list[str]:
    """Render the rows of other commands: one line per ping reply, else a list of values."""
    if command == "ping" and rows:
        return _echoes(rows)
    view = PrintView("", frozenset())
    return [line for row in rows for line in _values(row, view, is_padded=False)]


def _echoes(rows: Sequence[Row]) -> list[str]:
    lines = ["  SEQ HOST                                     SIZE TTL TIME       STATUS"]
    for row in rows:
        start = f"{row['seq']:>5} {row['host']:<40} {row.get('size', ''):>4} {row.get('ttl', ''):>3}"
        lines.append(f"{start} {row.get('time', ''):<10} {row.get('status', '')}".rstrip())
    last = rows[-1]
    rtt = "".join(f" {name}={last[name]}" for name in ("min-rtt", "avg-rtt", "max-rtt") if name in last)
    total = f"    sent={last['sent']} received={last['received']} packet-loss={last['packet-loss']}%{rtt}"
    return [*lines, total]


def columns_of(core: Core, menu: str) -> tuple[str, ...]:
    """Return the default columns of a table."""
    if menu in COLUMNS:
        return COLUMNS[menu]
    names = list(core.store.table(menu).args) if menu in core.store.tables else []
    visible_names = [name for name in names if name not in ("comment", "disabled")]
    return tuple(dict.fromkeys([*(("name",) if "name" in visible_names else ()), *visible_names]))[:_WIDEST]


def _is_single_row(core: Core, menu: str) -> bool:
    from atlantis_netcfg.emulator.routeros.commands._computed import COMPUTED_MENUS  # noqa: PLC0415 - that module reads the console's files

    if menu in COMPUTED_MENUS:
        return menu not in COLUMNS
    return core.store.table(menu).menu.shape is Shape.SETTINGS


# --- values --------------------------------------------------------------------------------------------------------


def _render_value(name: str, value: str) -> str:
    """Format a value for people."""
    if value in ("true", "false"):
        return "yes" if value == "true" else "no"
    if name in _SIZES and value.isdecimal():
        return _size(int(value))
    return value + _UNITS.get(name, "") if value.isdecimal() else value


def _size(number: float) -> str:
    for unit in ("", "KiB", "MiB"):
        if number <= _KILO or unit == "MiB":
            return f"{number:.1f}{unit}" if unit else f"{int(number)}"
        number /= 1024
    return ""


def _values(row: Row, view: PrintView, *, is_padded: bool) -> list[str]:
    """Render settings: names right-aligned; from 7.18 values are padded, with an empty line below."""
    pairs = [
        (name, _render_value(name, value)) for name, value in row.items() if not view.columns or name in view.columns
    ]
    width = max((len(name) for name, _ in pairs), default=0) + 2
    longest = max((len(value) for _, value in pairs), default=0) if is_padded else 0
    lines = [f"{name:>{width}}: {value:<{longest}}" for name, value in pairs]
    return [*lines, ""] if is_padded else lines


# --- rows ----------------------------------------------------------------------------------------------------------


def _legend(rows: Sequence[Row], flags: tuple[str, ...], *, upper: bool, all_flags: bool) -> list[str]:
    flag_names = [name for name in flags if all_flags or any(row.get(name) == "true" for row in rows)]
    if not flag_names:
        return []
    return ["Flags: " + ", ".join(f"{FLAGS[name]} - {name.upper() if upper else name}" for name in flag_names)]


def _properties(row: Row, flags: tuple[str, ...], view: PrintView) -> Iterator[tuple[str, str]]:
    for name, value in row.items():
        if name in flags or name in (".id", "comment", ".about") or (view.columns and name not in view.columns):
            continue
        yield name, _render_value(name, value)


def _terse(number: int, row: Row, flags: tuple[str, ...], view: PrintView) -> str:
    marks = f"{flag_letters(row, flags):<3}"
    comment = [f"comment={row['comment']}"] if row.get("comment") else []
    pairs = [*comment, *(f"{name}={value}" for name, value in _properties(row, flags, view))]
    return f"{number:>2} {marks} {' '.join(pairs)} "


def _details(rows: Sequence[Row], flags: tuple[str, ...], view: PrintView) -> list[str]:
    """Render one paragraph for each row; the flags column is as wide as the menu's kinds of flags."""
    most = 0 if not flags else 2 if set(flags) <= {"disabled", "dynamic", "invalid"} else 3
    lines: list[str] = []
    for number, row in enumerate(rows):
        head = f"{number:>2} {flag_letters(row, flags):<{most}} " if most else f"{number:>2} "
        text = " ".join(f"{name}={_quote(name, value)}" for name, value in _properties(row, flags, view))
        if row.get("comment"):
            lines.append(f"{head};;; {row['comment']}")
            head = " " * len(head)
        lines += _wrap(head, text, view.width or _WIDE)
        lines.append("")
    return lines


def _quote(name: str, value: str) -> str:
    return f'"{value}"' if name in QUOTED_NAMES or " " in value else value


def _wrap(head: str, text: str, width: int) -> list[str]:
    lines = textwrap.wrap(
        text,
        max(width - 1, len(head) + 8),
        initial_indent=head,
        subsequent_indent=" " * len(head),
        break_long_words=False,
        break_on_hyphens=False,
    )
    return lines or [head]


def _cells(rows: Sequence[Row], names: Sequence[str]) -> list[list[str]]:
    return [[_render_value(name, row.get(name, "")) for name in names] for row in rows]


def _table7(rows: Sequence[Row], flags: tuple[str, ...], view: PrintView, columns: Sequence[str]) -> list[str]:
    """Render a table of version 7: only flags and columns that occur."""
    del view
    names = [name for name in columns if any(row.get(name) for row in rows) and name not in flags]
    marks = [flag_letters(row, flags) for row in rows]
    most = max((len(mark) for mark in marks), default=0)
    lines = _legend(rows, flags, upper=True, all_flags=False)
    if not rows:
        return lines
    lines.append("Columns: " + ", ".join(name.upper() for name in names))
    digits = len(str(len(rows) - 1))
    cells = _cells(rows, names)
    widths = [max(len(name), *(len(line[at]) for line in cells)) for at, name in enumerate(names)]
    head = "#".ljust(digits) + " " + (" " * (most + 1) if most else "")
    lines.append(head + "  ".join(name.upper().ljust(width) for name, width in zip(names, widths, strict=True)))
    for number, (row, mark, line) in enumerate(zip(rows, marks, cells, strict=True)):
        if row.get("comment"):
            lines.append(f";;; {row['comment']}")
        start = f"{number:<{digits}} " + (f"{mark:<{most}} " if most else "")
        lines.append(start + "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)))
    return lines


def _table6(rows: Sequence[Row], flags: tuple[str, ...], view: PrintView, columns: Sequence[str]) -> list[str]:
    """Render a table of version 6: all flags and columns, comments after the number."""
    del view
    names = [name for name in columns if name not in flags]
    lines = [f"{line} " for line in _legend(rows, flags, upper=False, all_flags=True)]
    cells = _cells(rows, names)
    widths = [max(len(name), *(len(line[at]) for line in cells), 1) for at, name in enumerate(names)]
    most = max(1, *(len(flag_letters(row, flags)) for row in rows)) if rows else 1
    space = " " * (most + 1) if flags else ""
    lines.append(" # " + space + " ".join(name.upper().ljust(width) for name, width in zip(names, widths, strict=True)))
    for number, (row, line) in enumerate(zip(rows, cells, strict=True)):
        start = f"{number:>2} " + (f"{flag_letters(row, flags):<{most}} " if flags else "")
        if row.get("comment"):
            lines.append(f"{start}{';;; ' + row['comment']}")
            start = " " * len(start)
        lines.append(start + " ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)))
    return lines
