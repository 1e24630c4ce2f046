"""Menus, commands and arguments of a RouterOS version, from its published command trees.

From 7.16 to 7.24 every published tree is included. A version between two trees uses the older one, so that the emulator
is at worst stricter than the device; a version beyond the newest uses the newest (`versions.NEWEST_KNOWN`).
Versions below 7.16 have the tree of 7.16 without what is known to be newer (`BOUNDARIES`); what else RouterOS 6 lacks,
or had and lost, is in no published tree.

Knowledge of versions below 7.16 (`BOUNDARIES`), and its limits:

* 7.9 to 7.16: the first published tree that shows a name (`tikoci/restraml`, one or more for every minor version), for
  the menus that the emulator models, for whole menus, and for what our engine sends; below 7.15 one tree for each minor
  version was published, so that the patch is uncertain.
* 6.49 and 7.0 to 7.8: no tree was published. Rows marked `MANUAL` and `EXPORT` list what is known to be newer than
  RouterOS 6; everything else is assumed to be as in 7.16, which is certainly inexact. A menu that is not in that tree
  is not emulated, and of RouterOS 6 only the errors that adoption may cause (`console/run.py`).

Not in any tree (`ADDITIONS`, `BOARD_FEATURES`, `PACKAGE_MENUS`): hardware that a Cloud Hosted Router lacks, and
packages. Sources: Manual, CLI reference (`/interface/ethernet`, `poe`, `/system/routerboard`); Manual, Packages.
"""

from __future__ import annotations

import gzip
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache
from importlib import resources
from typing import Any


class Source(StrEnum):
    """Source of a row."""

    TREE = "command trees of tikoci/restraml"
    MANUAL = "Manual: Moving from ROSv6 to ROSv7, OpenVPN, VRF, NTP, Device-mode, WireGuard, Container, Netwatch"
    EXPORT = "verbose exports of RouterOS 6.43.8 do not show it"
    ASSUMPTION = "first seen in the tree of 7.9, not known to any description of RouterOS 6"
    """Assumption: first-versions"""


@dataclass(frozen=True, slots=True)
class Boundary:
    """A menu (with submenus), a command, or arguments that exist from version `since` on."""

    menu: str
    commands: tuple[str, ...] = ()
    """Empty: the whole menu."""
    arguments: tuple[str, ...] = ()
    """Empty: the whole command."""
    since: str = field(kw_only=True)
    source: Source = Source.TREE


_SET = ("set",)
_ADD = ("add", "set")


def _row(since: str, menu: str, commands: tuple[str, ...], words: str, source: Source = Source.TREE) -> Boundary:
    return Boundary(menu, commands, tuple(words.split()), since=since, source=source)


def _menus(since: str, source: Source, words: str) -> tuple[Boundary, ...]:
    return tuple(Boundary(menu, since=since, source=source) for menu in words.split())


_BELOW_7_16 = (
    _row("7.10", "/ip/dns", _SET, "address-list-extra-time"),
    _row("7.10", "/ip/firewall/nat", _ADD, "randomise-ports"),
    _row("7.10", "/snmp", _SET, "engine-id-suffix"),
    *_menus("7.10", Source.TREE, "/mpls/settings /routing/bfd"),
    _row("7.11", "/tool/netwatch", _ADD, "src-address"),
    *_menus("7.11", Source.TREE, "/iot/bluetooth/peripheral-devices /iot/lora /iot/mqtt/subscriptions"),
    *_menus("7.11", Source.TREE, "/lora/joineui /lora/netid"),
    *_menus("7.12", Source.TREE, "/interface/macvlan /iot/bluetooth/connections /iot/modbus/security-rules"),
    *_menus("7.12", Source.TREE, "/routing/settings"),
    _row("7.13", "/", ("export",), "where"),
    Boundary("/file", ("read",), since="7.13"),
    _row("7.13", "/file", _SET, "name"),
    _row("7.13", "/interface/bridge", _ADD, "port-cost-mode"),
    Boundary("/interface/bridge/port", ("unset",), since="7.13"),
    _row("7.13", "/interface/lte", _SET, "sms-read"),
    _row("7.13", "/interface/lte/settings", _SET, "info-polling-interval"),
    *_menus("7.13", Source.TREE, "/interface/wifi /ip/nat-pmp /routing/isis /system/rtrace"),
    *_menus("7.14", Source.TREE, "/disk/settings"),
    _row("7.14", "/interface/wifi", _ADD, "configuration.distance"),
    _row("7.14", "/interface/wifi/configuration", _ADD, "distance"),
    _row("7.14", "/system/note", _SET, "show-at-cli-login"),
    *_menus("7.15", Source.TREE, "/console/settings /interface/bridge/vlan/mvrp /ip/dns/adlist /ip/media"),
    _row("7.15", "/interface/bridge", _ADD, "mvrp"),
    _row("7.15", "/interface/bridge/port", _ADD, "mvrp-applicant-state mvrp-registrar-state"),
    _row("7.15", "/interface/ethernet", _SET, "sfp-ignore-rx-los"),
    _row("7.15", "/certificate", ("import",), "trusted"),
    _row("7.15", "/ip/dns", _SET, "vrf"),
    _row("7.15", "/ip/neighbor/discovery-settings", _SET, "lldp-mac-phy-config lldp-max-frame-size"),
    *_menus("7.16", Source.TREE, "/file/rsync-daemon"),
    _row("7.16", "/", ("import",), "dry-run"),
    _row("7.16", "/certificate", ("import",), "no-key-export"),
    _row("7.16", "/interface/bridge", _ADD, "forward-reserved-addresses max-learned-entries"),
    _row("7.16", "/interface/lte", _SET, "sms-protocol"),
    _row("7.16", "/ip/dns", _SET, "mdns-repeat-ifaces"),
    _row("7.16", "/ip/settings", _SET, "ipv4-multipath-hash-policy"),
    _row("7.16", "/ip/neighbor/discovery-settings", _SET, "discover-interval lldp-vlan-info"),
    _row("7.16", "/ip/service", _SET, "max-sessions"),
    _row("7.16", "/ipv6/settings", _SET, "multipath-hash-policy"),
    _row("7.16", "/tool/netwatch", _ADD, "accept-icmp-time-exceeded dns-server record-type ttl"),
    _row("7.16", "/user", _ADD, "inactivity-policy inactivity-timeout"),
)

_NEWER_THAN_6 = (
    *_menus("7.0", Source.MANUAL, "/routing/table /routing/rule /routing/route /routing/settings /routing/id"),
    *_menus("7.0", Source.MANUAL, "/ip/vrf /interface/wireguard /container /interface/veth /zerotier"),
    *_menus("7.0", Source.MANUAL, "/interface/wifi /interface/macvlan /interface/vxlan/vteps /system/device-mode"),
    *_menus("7.0", Source.MANUAL, "/routing/bgp/connection /routing/bgp/template /routing/ospf/interface-template"),
    *_menus("7.0", Source.MANUAL, "/routing/filter/rule /system/ntp/client/servers"),
    _row("7.0", "/ip/route", _ADD, "routing-table blackhole suppress-hw-offload", Source.MANUAL),
    _row("7.0", "/interface/ovpn-client", _ADD, "protocol", Source.MANUAL),
    _row("7.0", "/interface/ovpn-client", _ADD, "disconnect-notify use-peer-dns", Source.ASSUMPTION),
    _row("7.9", "/interface/ovpn-client", _ADD, "route-nopull tls-version", Source.TREE),
    Boundary("/interface/ovpn-client", ("import-ovpn-configuration",), since="7.9"),
    _row("7.0", "/ip/service", _SET, "vrf", Source.EXPORT),
    _row("7.0", "/ip/socks", _SET, "vrf", Source.EXPORT),
    _row("7.0", "/system/ntp/client", _SET, "mode servers vrf", Source.EXPORT),
    Boundary("/file", ("add",), since="7.9", source=Source.ASSUMPTION),
    _row("7.9", "/", ("execute",), "as-string", Source.ASSUMPTION),
    _row("7.0", "/", ("export",), "show-sensitive", Source.MANUAL),
    Boundary("/console", ("inspect",), since="7.9", source=Source.ASSUMPTION),
    _row("7.9", "/tool/netwatch", _ADD, "name type", Source.ASSUMPTION),
)

BOUNDARIES: tuple[Boundary, ...] = (*_NEWER_THAN_6, *_BELOW_7_16)

BOARD_FEATURES = frozenset({"poe", "routerboard"})
UNSEEN = (
    "/interface/ethernet/switch",
    "/system/routerboard/mode-button",
    "/system/routerboard/reset-button",
    "/system/routerboard/wps-button",
    "/system/swos",
    "/zerotier",
)
"""Menus in exports (7.1 to 7.23) that no published tree shows; each board has some of them."""
UNSEEN_UNTIL = {"/interface/wifiwave2": "7.13"}
"""Menus in exports that were removed later, with the first version that lacks them."""
OLDEST_TREE = "7.9"
"""Oldest version with a published command tree; additional menus or arguments of older versions are unknown."""


@dataclass(frozen=True, slots=True)
class Addition:
    """A command with arguments that a device has but the tree lacks; `feature` is one of BOARD_FEATURES."""

    menu: str
    command: str
    arguments: tuple[str, ...] = ()
    since: str = "6.0"
    feature: str | None = None


_CHANGE = ("add", "set")
_POE = (
    "poe-out",
    "poe-priority",
    "poe-voltage",
    "power-cycle-interval",
    "power-cycle-ping-address",
    "power-cycle-ping-enabled",
    "power-cycle-ping-timeout",
)
_PRINT = ("as-value", "brief", "count-only", "detail", "interval", "proplist", "terse", "where", "without-paging")
_GET = ("as-string", "number", "value-name")
_ROUTERBOARD = (
    "auto-upgrade",
    "boot-delay",
    "boot-device",
    "boot-protocol",
    "cpu-frequency",
    "enable-jumper-reset",
    "enter-setup-on",
    "force-backup-booter",
    "preboot-etherboot",
    "preboot-etherboot-server",
    "silent-boot",
)

ADDITIONS = (
    Addition("/interface/ethernet", "set", _POE, feature="poe"),
    Addition("/interface/ethernet/poe", "print", _PRINT, feature="poe"),
    Addition("/interface/ethernet/poe", "get", _GET, feature="poe"),
    Addition("/interface/ethernet/poe", "find", ("where",), feature="poe"),
    Addition("/interface/ethernet/poe", "set", (*_POE, "numbers"), feature="poe"),
    Addition("/interface/ethernet/poe", "monitor", ("as-value", "numbers", "once"), feature="poe"),
    Addition("/interface/ethernet/poe", "power-cycle", ("duration", "numbers"), feature="poe"),
    Addition("/ip/neighbor/discovery-settings", "set", ("lldp-poe-power",), feature="poe"),
    Addition("/system/routerboard", "print", ("as-value", "without-paging"), feature="routerboard"),
    Addition("/system/routerboard", "get", ("value-name",), feature="routerboard"),
    Addition("/system/routerboard/settings", "print", ("as-value", "without-paging"), feature="routerboard"),
    Addition("/system/routerboard/settings", "get", ("value-name",), feature="routerboard"),
    Addition("/system/routerboard/settings", "set", _ROUTERBOARD, feature="routerboard"),
    *(Addition("/ip/firewall/filter", each, ("hw-offload",), since="7.21", feature="routerboard") for each in _CHANGE),
    *(Addition("/ip/route", each, ("suppress-hw-offload",), since="7.21", feature="routerboard") for each in _CHANGE),
)
"""At 7.21 the two arguments of hardware offloading left the tree of the Cloud Hosted Router, which has no switch chip;
the manual (L3 Hardware Offloading) still describes them. Assumption: board-hw-offload"""

WITHIN_ROUTEROS = {"wireless": "7.13"}
"""Packages that were part of RouterOS itself before that version (Manual, Packages)."""

PACKAGE_MENUS = (
    ("calea", "/interface/bridge/calea"),
    ("calea", "/ip/firewall/calea"),
    ("calea", "/tool/calea"),
    ("container", "/app"),
    ("container", "/container"),
    ("dude", "/dude"),
    ("gps", "/system/gps"),
    ("iot", "/iot"),
    ("iot", "/lora"),
    ("rose-storage", "/file/rsync-daemon"),
    ("rose-storage", "/file/sync"),
    ("tr069-client", "/tr069-client"),
    ("ups", "/system/ups"),
    ("user-manager", "/user-manager"),
    ("wireless", "/caps-man"),
    ("wireless", "/interface/wireless"),
)


_FIRST = {"7.18.2": "7.18"}
"""First version with the same tree as a later one: 7.18 and 7.18.1 are identical to 7.18.2."""
_WHOLE = ("7.16", "7.18.2", "7.21.5")
"""Trees stored as complete files; the others are stored as changes (`data/README.md`)."""
_MENU_TYPES = ("dir", "path")
_PRINT_FORMS = ("getall", "listen")
_REQUIRED_FILE, _OLDEST_NEEDED = "required.json", "7.20.8"


@cache
def version_key(version: str) -> tuple[int, ...]:
    """Return a sort key for a version such as `7.18.2`; `7.19beta2` and `7.19rc1` are below 7.19."""
    match = re.match(r"(\d+)\.(\d+)(?:\.(\d+))?(?:(beta|rc)(\d+))?", version)
    if match is None:
        raise ValueError(f"not a RouterOS version: {version}")
    major, minor, patch, stage, build = match.groups()
    return int(major), int(minor), int(patch or 0), {"beta": 0, "rc": 1}.get(stage, 2), int(build or 0)


@cache
def _load(name: str) -> dict[str, Any]:
    content = resources.files("atlantis_netcfg.emulator.routeros").joinpath("data", name).read_bytes()
    data: dict[str, Any] = json.loads(gzip.decompress(content))
    return data


@cache
def _tree(version: str) -> dict[str, Any]:
    if version in _WHOLE:
        return _load(f"{version}.json.gz")
    step = _load("changes.json.gz")[version]
    return _merge_patch(_tree(step["after"]), step["change"])


def _merge_patch(node: Mapping[str, Any], patch: Mapping[str, Any]) -> dict[str, Any]:
    """Apply a JSON merge patch (RFC 7396); unchanged parts are shared with the older tree."""
    result = dict(node)
    for name, child in patch.items():
        if child is None:
            result.pop(name, None)
        elif isinstance(child, dict):
            old = result.get(name)
            result[name] = _merge_patch(old if isinstance(old, dict) else {}, child)
        else:
            result[name] = child
    return result


TREES = tuple(sorted((*_WHOLE, *_load("changes.json.gz")), key=version_key))
"""Versions with a tree, oldest first."""


@cache
def offered_values(menu: str, argument: str) -> tuple[str, ...]:
    """Return the values that the console of 7.21.5 offers for an argument, without free values."""
    values = _load("7.21.5.values.json.gz")
    offers = values.get(f"{menu}/add {argument}") or values.get(f"{menu}/set {argument}") or []
    return tuple(value for value in offers if value not in ("!", ",", "!,"))


_NAMING = (("get", "number"), ("print", "from"), ("set", "numbers"))
"""Commands and arguments whose offered values in the console show the rows of a menu."""
_NO_ROW = frozenset({"", "all", "any", "global", "no-queue", "none"})
"""Words offered besides the names of rows."""


@cache
def recorded_rows() -> Mapping[str, frozenset[str]]:
    """Return the row names of the recorded router, by menu."""
    rows: dict[str, frozenset[str]] = {}
    for place, words in _load("7.21.5.values.json.gz").items():
        path, _, argument = place.rpartition(" ")
        menu, _, command = path.rpartition("/")
        if (command, argument) in _NAMING:
            rows[menu] = rows.get(menu, frozenset()) | frozenset(words)
    return rows


def description(menu: str, argument: str) -> str:
    """Return the tree's description (7.21.5) of an argument's values: `A.B.C.D    (IP address)`; often empty."""
    node: Any = _tree("7.21.5")
    for part in menu.strip("/").split("/"):
        node = node.get(part, {})
    nodes = (node[command][argument] for command in _CHANGE if argument in node.get(command, {}))
    return str(next((each.get("desc", "") for each in nodes), ""))


def menus_named(menu: str, argument: str) -> tuple[str, ...]:
    """Return the menus that an argument may reference: their row names were exactly the offered values."""
    names = frozenset(offered_values(menu, argument)) - _NO_ROW
    return tuple(path for path, rows in recorded_rows().items() if names and rows - _NO_ROW == names)


@cache
def required_arguments(version: str, menu: str) -> tuple[str, ...] | str:
    """Return the arguments that `add` requires, or the error text of an `add` without arguments.

    Recorded on devices of three versions; an older device uses the oldest.
    Assumption: offered-values
    """
    arguments: list[str] | str = []
    data = json.loads(
        resources.files("atlantis_netcfg.emulator.routeros").joinpath("data", _REQUIRED_FILE).read_bytes()
    )
    for recorded_version, rows in data.items():
        if recorded_version == _OLDEST_NEEDED or version_key(version) >= version_key(recorded_version):
            arguments = rows.get(menu, arguments)
    return arguments if isinstance(arguments, str) else tuple(arguments)


@dataclass(frozen=True, slots=True)
class Schema:
    """Vocabulary of one router: its version's tree, its packages, and additions of its board."""

    version: str
    packages: tuple[str, ...] = ("routeros",)
    features: frozenset[str] = frozenset()
    """Features from `BOARD_FEATURES`: present on this board, missing in a Cloud Hosted Router."""

    def at_least(self, version: str) -> bool:
        """Return whether the router runs `version` or a newer one."""
        return version_key(self.version) >= version_key(version)

    @property
    def tree(self) -> str:
        """The newest included tree that is not newer than the router; the oldest for older routers."""
        return _newest(self)

    def has_menu(self, menu: str) -> bool:
        """Return whether `menu` is a menu of this router."""
        return menu == "/" or _has_menu(self, menu)

    def has_command(self, menu: str, command: str) -> bool:
        """Return whether `menu` has `command`; `getall` and `listen` are the API's forms of `print`."""
        command = "print" if command in _PRINT_FORMS else command
        return self.has_menu(menu) and command in _commands(self, menu)

    def arguments(self, menu: str, command: str) -> frozenset[str]:
        """Return the argument names of `command`."""
        return _arguments(self, menu, "print" if command in _PRINT_FORMS else command)

    def commands(self, menu: str) -> frozenset[str]:
        """Return every command word of `menu`."""
        return _commands(self, menu) if self.has_menu(menu) else frozenset()

    def submenus(self, menu: str) -> frozenset[str]:
        """Return the names of the menus directly below `menu`."""
        return _submenus(self, menu)

    def words(self, menu: str) -> frozenset[str]:
        """Return every menu and command word of `menu`."""
        return _menu_words(self, menu)

    def _children(self, menu: str) -> Iterator[tuple[str, Mapping[str, Any]]]:
        for name, child in (self._node(menu) or {}).items():
            if isinstance(child, Mapping):
                yield name, child

    def _node(self, menu: str) -> Mapping[str, Any] | None:
        node: Any = _tree(self.tree)
        for part in menu.strip("/").split("/") if menu != "/" else ():
            node = node.get(part) if isinstance(node, Mapping) else None
        return node if isinstance(node, Mapping) else None

    def _is_installed(self, menu: str) -> bool:
        for package, prefix in PACKAGE_MENUS:
            if (menu == prefix or menu.startswith(prefix + "/")) and package not in self.packages:
                return package in WITHIN_ROUTEROS and not self.at_least(WITHIN_ROUTEROS[package])
        return True


@dataclass(frozen=True, slots=True)
class _Words:
    """Differences between a router's vocabulary and its command tree."""

    additions: Mapping[str, Mapping[str, frozenset[str]]]
    """Arguments by menu and command."""
    lacking: frozenset[tuple[str, str, str]]
    """Menu, command, argument. Empty argument: the whole command is missing; empty command: the whole menu."""


@cache
def _version_differences(schema: Schema) -> _Words:
    additions: dict[str, dict[str, frozenset[str]]] = {}
    lacking: set[tuple[str, str, str]] = set()
    for row in ADDITIONS:
        if schema.at_least(row.since) and (row.feature is None or row.feature in schema.features):
            _add(additions, row.menu, row.command, row.arguments)
    for boundary in BOUNDARIES:
        if not schema.at_least(boundary.since):
            lacking.update(_cells(boundary))
    return _Words(additions, frozenset(lacking))


def _cells(row: Boundary) -> Iterator[tuple[str, str, str]]:
    for command in row.commands or ("",):
        for name in row.arguments or ("",):
            yield row.menu, command, name


def _add(additions: dict[str, dict[str, frozenset[str]]], menu: str, command: str, names: Iterable[str]) -> None:
    commands = additions.setdefault(menu, {})
    commands[command] = commands.get(command, frozenset()) | frozenset(names)


def _is_lacking(words: _Words, menu: str) -> bool:
    parts = menu.split("/")
    return any(("/".join(parts[:end]), "", "") in words.lacking for end in range(2, len(parts) + 1))


@cache
def _newest(schema: Schema) -> str:
    fitting = (tree for tree in TREES if schema.at_least(_FIRST.get(tree, tree)))
    return max(fitting, key=version_key, default=TREES[0])


@cache
def _has_menu(schema: Schema, menu: str) -> bool:
    words = _version_differences(schema)
    if not schema._is_installed(menu) or _is_lacking(words, menu):  # noqa: SLF001
        return False
    node = schema._node(menu)  # noqa: SLF001
    return (node is not None and node["_type"] in _MENU_TYPES) or menu in words.additions


@cache
def _submenus(schema: Schema, menu: str) -> frozenset[str]:
    prefix = menu.rstrip("/") + "/"
    names = {name for name, child in schema._children(menu) if child["_type"] in _MENU_TYPES}  # noqa: SLF001
    names.update(
        path.removeprefix(prefix).split("/")[0]
        for path in _version_differences(schema).additions
        if path.startswith(prefix)
    )
    return frozenset(name for name in names if schema.has_menu(prefix + name))


@cache
def _menu_words(schema: Schema, menu: str) -> frozenset[str]:
    return schema.submenus(menu) | schema.commands(menu)


@cache
def _commands(schema: Schema, menu: str) -> frozenset[str]:
    words = _version_differences(schema)
    names = {name for name, child in schema._children(menu) if child["_type"] == "cmd"}  # noqa: SLF001
    names.update(words.additions.get(menu, ()))
    return frozenset(name for name in names if (menu, name, "") not in words.lacking)


@cache
def _arguments(schema: Schema, menu: str, command: str) -> frozenset[str]:
    if not schema.has_menu(menu) or command not in _commands(schema, menu):
        return frozenset()
    words = _version_differences(schema)
    node = (schema._node(menu) or {}).get(command, {})  # noqa: SLF001
    names = {name for name, child in node.items() if isinstance(child, Mapping) and child["_type"] == "arg"}
    names |= words.additions.get(menu, {}).get(command, frozenset())
    return frozenset(name for name in names if (menu, command, name) not in words.lacking)


def features_of(board: str, *, poe: bool) -> frozenset[str]:
    """Return the board features of a router: all but a CHR are RouterBOARDs; PoE is from the spec."""
    features = {"routerboard"} if not board.startswith("CHR") else set()
    return frozenset(features | ({"poe"} if poe else set())) & BOARD_FEATURES
