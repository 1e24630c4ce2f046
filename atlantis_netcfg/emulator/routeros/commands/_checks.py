"""Validation and defaults of rows in RouterOS: rules across several values, and values that it fills in.

If no source has the original text, ours imitates it; the tests mark those.
Assumption: refusal-words
"""

from __future__ import annotations

import hashlib
import re
from datetime import UTC, datetime
from ipaddress import IPv4Interface
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros import access, menus
from atlantis_netcfg.emulator.routeros.answers import Category, Trap
from atlantis_netcfg.emulator.routeros.values import NOT_OFFERED, id_text, spell
from atlantis_netcfg.emulator.routeros.views import HIDDEN_TEXT
from atlantis_netcfg.routeros.rsc import Statement, print_statement

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from atlantis_netcfg.emulator.routeros.core import Call, Core
    from atlantis_netcfg.emulator.routeros.store import StoredItem, Table


class MissingArgument(Trap):
    """A mandatory argument is missing; API and console have different texts for it."""

    def __init__(self, name: str, *others: str) -> None:
        super().__init__(f"missing ={name}=", Category.MISSING)
        self.console = f"missing value(s) of argument(s) {' '.join((name, *others))}"


def no_such_item() -> Trap:
    """Build the error for an unknown id or name."""
    return Trap("no such item", Category.MISSING)


def check_known(core: Core, menu: str) -> None:
    """Raise Trap for rows that come with the board and that the emulator does not know."""
    table = core.store.table(menu)
    if table.menu.of_the_board and not table.items:
        raise Trap(f"not rehearsed by the twin: rows of {menu}")


def unknown(name: str) -> Trap:
    """Build the error for an unknown argument."""
    return Trap(f"unknown parameter {name}")


BAD_KEY = "failure: unable to load key file (wrong format or bad passphrase)!"
_WITH_PORTS = ("tcp", "udp", "udp-lite", "dccp", "sctp", "6", "17")
_PORTS = ("dst-port", "src-port", "port", "to-ports")
_NO_IN = ("output", "postrouting", "srcnat")
_NO_OUT = ("input", "prerouting", "dstnat")
_SRCNAT_IN = {"in-interface-list": "7.18", "in-interface": "7.21"}
"""Versions from which, at the latest, srcnat matches the incoming interface: the oldest exports with such rules."""


def check(core: Core, menu: str, values: Mapping[str, str], item: StoredItem | None) -> None:
    """Validate the new content of a row; `item` is None for a new one. Raises Trap."""
    table = core.store.table(menu)
    for unique in table.menu.unique:
        _check_unique(core, table, unique, values, item)
    _check_words(core, menu, values)
    _check_mode(core, table, values, item)
    more = _MORE.get(menu)
    if more is not None:
        more(core, values, item)


def _check_unique(
    core: Core, table: Table, unique: menus.Unique, values: Mapping[str, str], item: StoredItem | None
) -> None:
    first, key = unique.arguments[0], _key(table, unique, values)
    if key[0] is None or (unique.enabled_only and values.get("disabled") == "yes"):
        return
    tables = list(core.store.space_tables("interface")) if table.menu.space == "interface" else [table]
    for other_table in tables:
        # Among very many rows the first argument tells nearly all of them apart.
        for other in other_table.find_by_value(first, key[0]):
            counts = not unique.enabled_only or other.values.get("disabled") != "yes"
            if other is not item and counts and _key(table, unique, other.values) == key:
                raise Trap(unique.words)


def _key(table: Table, unique: menus.Unique, values: Mapping[str, str]) -> list[str | None]:
    return [values.get(name, table.menu.by_name[name].default) for name in unique.arguments]


def _check_words(core: Core, menu: str, values: Mapping[str, str]) -> None:
    """Refuse a keyword that this version has removed or not yet added."""
    for name, words in menus.OLD_WORDS.get(menu, {}).items():
        given_words = set(values.get(name, "").split(",")) - {""}
        is_renamed = core.schema.at_least(words.until)
        if (is_renamed and given_words & set(words.old)) or (
            words.is_complete and not is_renamed and not given_words <= set(words.old)
        ):
            raise Trap(NOT_OFFERED.format(name), Category.ARGUMENT)


def _check_mode(core: Core, table: Table, values: Mapping[str, str], item: StoredItem | None) -> None:
    feature = table.menu.feature
    if feature and _is_switching_on(table, values, item):
        if not access.is_allowed(core.spec, feature):
            raise Trap(access.NOT_ALLOWED)
        if core.spec.device_mode.is_flagged and feature in access.SUSPICIOUS:
            raise Trap(access.FLAGGED_MESSAGE)
    is_flagged = core.spec.device_mode.is_flagged and values.get("disabled") != "yes"
    if table.menu.path == "/system/scheduler" and is_flagged:
        raise Trap(access.FLAGGED_MESSAGE)


def _is_switching_on(table: Table, values: Mapping[str, str], item: StoredItem | None) -> bool:
    arg = table.args.get("enabled")
    if arg is None:
        return True
    before = item.values.get("enabled", arg.default) if item is not None else arg.default
    return values.get("enabled", arg.default) == "yes" and before != "yes"


def _check_address(_core: Core, values: Mapping[str, str], _item: StoredItem | None) -> None:
    ip = IPv4Interface(values["address"]).ip
    if ip.is_unspecified or ip.is_multicast or ip == _LIMITED_BROADCAST:
        raise Trap("invalid value for argument address", Category.ARGUMENT)


_LIMITED_BROADCAST = IPv4Interface("255.255.255.255").ip


def _check_bridge_port(core: Core, values: Mapping[str, str], _item: StoredItem | None) -> None:
    name = spell(values["interface"], core.store)
    bridge = core.store.table("/interface/bridge")
    if core.store.id_of("interface", name) is not None and any(
        core.store.text(bridge, other, "name") == name for other in bridge.items
    ):
        raise Trap("failure: can not add bridge as bridge port")


def _rule(core: Core, values: Mapping[str, str], _item: StoredItem | None) -> None:
    """Refuse matchers invalid for a chain or protocol, and actions without their target."""
    chain, action = values["chain"], values.get("action", "accept")
    if any(name in values for name in _PORTS) and values.get("protocol", "") not in _WITH_PORTS:
        raise Trap("failure: ports can be specified if proto is tcp,udp,udp-lite,dccp,sctp")
    if chain in _NO_OUT and any(name.startswith("out-") for name in values):
        raise Trap("failure: outgoing interface matching not possible in input and prerouting chains")
    since = {name: core.schema.at_least(version) for name, version in _SRCNAT_IN.items()} if chain == "srcnat" else {}
    if chain in _NO_IN and any(name.startswith("in-") and not since.get(name) for name in values):
        raise Trap("failure: incoming interface matching not possible in output and postrouting chains")
    if "tcp-flags" in values and values.get("protocol") not in ("tcp", "6"):
        raise Trap("failure: tcp-flags can be specified only if proto is tcp")
    for requirement in _NEEDS.get(action, ()):
        if not set(requirement.split("|")) & values.keys():
            raise MissingArgument(requirement.partition("|")[0])


_NEEDS = {
    "add-dst-to-address-list": ("address-list",),
    "add-src-to-address-list": ("address-list",),
    "change-mss": ("new-mss",),
    "jump": ("jump-target",),
    "mark-connection": ("new-connection-mark",),
    "mark-packet": ("new-packet-mark",),
    "mark-routing": ("new-routing-mark",),
    "src-nat": ("to-addresses|to-ports",),  # exports of RB5009 with 7.1.5 and 7.2.3 give the ports alone
}


def _check_nat(core: Core, values: Mapping[str, str], item: StoredItem | None) -> None:
    chain, action = values["chain"], values.get("action", "accept")
    if action in ("masquerade", "src-nat") and chain in ("dstnat", "output"):
        raise Trap(f"failure: {action} action must be in srcnat/input chains")
    if action in ("dst-nat", "redirect") and chain in ("srcnat", "input"):
        raise Trap(f"failure: {action} action must be in dstnat/output chains")
    _rule(core, values, item)


def _check_static_dns(_core: Core, values: Mapping[str, str], _item: StoredItem | None) -> None:
    if "name" not in values and "regexp" not in values:
        raise MissingArgument("name")
    requirement = _RECORD_NEEDS.get(values.get("type", "A"))
    if requirement is not None and not set(requirement.split("|")) & values.keys():
        raise MissingArgument(requirement.partition("|")[0])


_RECORD_NEEDS = {
    "A": "address",
    "AAAA": "address",
    "CNAME": "cname",
    "FWD": "forward-to|address-list",  # an export of 7.21 has only the list
    "MX": "mx-exchange",
    "NS": "ns",
    "SRV": "srv-target",
    "TXT": "text",
}


def _check_ethernet(core: Core, values: Mapping[str, str], item: StoredItem | None) -> None:
    poe_names = [name for name in values if name.startswith(("poe-", "power-cycle"))]
    if poe_names and item is not None and (item.factory or {})["name"] not in core.spec.poe_ports:
        raise Trap(f"unknown parameter {poe_names[0]}")


def _modem(core: Core, values: Mapping[str, str], _item: StoredItem | None) -> None:
    """Refuse LTE bands that the modem does not have. Assumption: lte-pin-once."""
    modem = core.spec.modem
    bands = [int(word) for word in values.get("band", "").split(",") if word]
    if modem is not None and not set(bands) <= set(modem.bands):
        raise Trap("invalid value for argument band", Category.ARGUMENT)


def _route(_core: Core, values: Mapping[str, str], _item: StoredItem | None) -> None:
    """Refuse an empty gateway except for a black hole: an export of 7.19.1 has `blackhole ... gateway=""`."""
    if values.get("gateway") == "" and "blackhole" not in values:
        raise Trap("input does not match any value of gateway")


def _virtual(_core: Core, values: Mapping[str, str], item: StoredItem | None) -> None:
    """Refuse a new radio row without `master-interface` (virtual radio) or `radio-mac` (access point's radio)."""
    if item is None and not {"master-interface", "radio-mac"} & values.keys():
        raise Trap("failure: master interface not specified")


def _check_service(core: Core, values: Mapping[str, str], item: StoredItem | None) -> None:
    for name in ("certificate", "tls-version"):
        if name in values and item is not None and name not in (item.factory or {}):
            raise Trap(f"unknown parameter {name}")
    others = (other for other in core.store.table("/ip/service").items if other is not item)
    if any(other.values.get("port") == values.get("port") for other in others):
        raise Trap("failure: port already in use")


def _check_user(core: Core, values: Mapping[str, str], item: StoredItem | None) -> None:
    if item is not None and not _has_full_user_left(core, item, values):
        raise Trap("failure: there should be at least one user with full access")


def _check_ssh_key(core: Core, values: Mapping[str, str], _item: StoredItem | None) -> None:
    if access.public_key(core, values.get("key", "")) is None:
        raise Trap(BAD_KEY)


def _check_action(_core: Core, values: Mapping[str, str], _item: StoredItem | None) -> None:
    if re.fullmatch(r"[A-Za-z0-9]*", values.get("name", "")) is None:
        raise Trap("action name can contain only letters and numbers")


def _has_full_user_left(core: Core, changed_item: StoredItem, values: Mapping[str, str] | None) -> bool:
    table = core.store.table("/user")
    for other in table.items:
        now = values if other is changed_item else other.values
        if now is not None and now.get("disabled") != "yes" and spell(now.get("group", ""), core.store) == "full":
            return True
    return False


_MORE: dict[str, Callable[[Core, Mapping[str, str], StoredItem | None], None]] = {
    "/interface/bridge/port": _check_bridge_port,
    "/interface/ethernet": _check_ethernet,
    "/interface/lte": _modem,
    "/interface/wifi": _virtual,
    "/interface/wireless": _virtual,
    "/ip/address": _check_address,
    "/ip/dns/static": _check_static_dns,
    "/ip/firewall/filter": _rule,
    "/ip/firewall/mangle": _rule,
    "/ip/firewall/nat": _check_nat,
    "/ip/firewall/raw": _rule,
    "/ip/route": _route,
    "/ip/service": _check_service,
    "/system/logging/action": _check_action,
    "/user": _check_user,
    "/user/ssh-keys": _check_ssh_key,
}


def check_removal(core: Core, menu: str, item: StoredItem) -> None:
    """Refuse to remove a row that the router needs. Raises Trap."""
    if menu == "/user" and not _has_full_user_left(core, item, None):
        raise Trap("failure: there should be at least one user with full access")


Values = tuple[tuple[str, str | None], ...]


def record_addition(core: Core, call: Call, item: StoredItem) -> None:
    """Record that a row was added."""
    _record(
        core, call, "added", Statement(call.menu, "remove", target=id_text(item.id)), _add_statement(core, call, item)
    )


def record_change(core: Core, call: Call, item: StoredItem, before: Mapping[str, str]) -> None:
    """Record that a row was changed."""
    table = core.store.table(call.menu)
    names = sorted(name for name in {*before, *item.values} if before.get(name) != item.values.get(name))
    target = None if table.menu.shape is menus.Shape.SETTINGS else id_text(item.id)
    undo, redo = (
        Statement(call.menu, "set", _values(core, table, names, values), target=target)
        for values in (before, item.values)
    )
    _record(core, call, "changed", undo, redo)


def remove_row(core: Core, call: Call, item: StoredItem) -> None:
    """Remove a row and record it."""
    undo = _add_statement(core, call, item)
    core.store.remove(call.menu, item)
    _record(core, call, "removed", undo, Statement(call.menu, "remove", target=id_text(item.id)))


def move_row(core: Core, call: Call, item: StoredItem, index: int) -> None:
    """Move a row and record it."""
    undo = _move(core, call, item)
    core.store.move(call.menu, item, index)
    _record(core, call, "moved", undo, _move(core, call, item))


def _record(core: Core, call: Call, verb: str, undo: Statement, redo: Statement) -> None:
    commands = print_statement(undo, path=True), print_statement(redo, path=True)
    caller, noun = call.caller, core.store.table(call.menu).menu.noun
    core.history.record(core.store, f"{noun} {verb}", by=caller.user, time=core.stamp(), commands=commands)
    core.note("system,info", f"{noun} {verb} by {caller.via}:{caller.user}@{caller.address}")


def _add_statement(core: Core, call: Call, item: StoredItem) -> Statement:
    table = core.store.table(call.menu)
    names = sorted(name for name in item.values if name in table.args)
    return Statement(call.menu, "add", _values(core, table, names, item.values))


def _move(core: Core, call: Call, item: StoredItem) -> Statement:
    """Return the command that moves a row to its current position."""
    items = core.store.table(call.menu).items
    after = items[items.index(item) + 1 :]
    destination: Values = (("destination", id_text(after[0].id)),) if after else ()
    return Statement(call.menu, "move", destination, target=id_text(item.id))


def _values(core: Core, table: Table, names: Iterable[str], values: Mapping[str, str]) -> Values:
    return tuple((name, _value(core, table, name, values)) for name in names)


def _value(core: Core, table: Table, name: str, values: Mapping[str, str]) -> str | None:
    """Format a value; None is "unset". Secrets are hidden in the history."""
    arg = table.args.get(name)
    value = spell(values[name], core.store) if name in values else arg.default if arg is not None else None
    return HIDDEN_TEXT if value and arg is not None and (arg.secret or arg.never) else value


_NAMES = {
    "/interface/bridge": ("bridge", "interface"),
    "/interface/ovpn-client": ("ovpn-out", "interface"),
    "/interface/wifi": ("wifi", "interface"),
    "/interface/wireless": ("wlan", "interface"),
    "/ip/dhcp-server": ("dhcp", ""),
    "/ip/pool": ("pool", ""),
    "/routing/table": ("table", ""),
    "/system/scheduler": ("schedule", ""),
    "/user/group": ("group", ""),
}


def complete(core: Core, menu: str, values: dict[str, str], changed_names: frozenset[str] | None = None) -> None:
    """Fill in defaults; `changed_names`: arguments of a set, None for a new row."""
    if changed_names is None and menu in _NAMES and "name" not in values:
        values["name"] = _free_name(core, menu)
    extra = _COMPLETE.get(menu)
    if extra is not None:
        extra(core, values, changed_names)


def _free_name(core: Core, menu: str) -> str:
    stem, space = _NAMES[menu]
    tables = list(core.store.space_tables(space)) if space else [core.store.table(menu)]
    used_names = {core.store.text(table, item, "name") for table in tables for item in table.items}
    return next(
        name for name in (f"{stem}{number}" for number in range(1, len(used_names) + 2)) if name not in used_names
    )


def mac_of(name: str, number: int) -> str:
    """Return a MikroTik MAC address for a router's interface, the same in every run."""
    digest = hashlib.sha256(name.encode()).digest()
    return ":".join(f"{byte:02X}" for byte in (0x48, 0xA9, 0x8A, digest[0], digest[1], number & 0xFF))


def _fill_address(_core: Core, values: dict[str, str], changed_names: frozenset[str] | None) -> None:
    """Derive the network from the address unless given; `netmask` may replace the prefix length."""
    if mask := values.pop("netmask", None):
        host = values["address"].partition("/")[0]
        try:
            values["address"] = str(IPv4Interface(f"{host}/{mask}"))
        except ValueError as error:
            raise Trap("invalid value for argument netmask", Category.ARGUMENT) from error
    values.pop("broadcast", None)
    follows = (
        "network" not in values
        if changed_names is None
        else "address" in changed_names and "network" not in changed_names
    )
    if follows:
        values["network"] = str(IPv4Interface(values["address"]).network.network_address)


def _complete_tunnel(core: Core, values: dict[str, str], _changed_names: frozenset[str] | None) -> None:
    values.setdefault("mac-address", mac_of(core.spec.name + values.get("name", ""), 0xFE))


def _clock(core: Core, values: dict[str, str], _changed_names: frozenset[str] | None) -> None:
    """Set the router's clock from date and time, which are not stored as configuration."""
    if not {"date", "time"} & values.keys():
        return
    now = core.time()
    form = "%Y-%m-%d" if core.schema.at_least("7.10") else "%b/%d/%Y"
    date = values.pop("date", now.strftime(form).lower())
    time = values.pop("time", now.strftime("%H:%M:%S"))
    try:
        core.set_clock(datetime.strptime(f"{date} {time}", f"{form} %H:%M:%S").replace(tzinfo=UTC))
    except ValueError as error:
        wrong = "time" if _is_in_format(date, form) else "date"
        raise Trap(f"invalid value for argument {wrong}", Category.ARGUMENT) from error


def _is_in_format(text: str, form: str) -> bool:
    try:
        return bool(datetime.strptime(text, form).replace(tzinfo=UTC))
    except ValueError:
        return False


def _schedule(core: Core, values: dict[str, str], _changed_names: frozenset[str] | None) -> None:
    """Start a job without start time now."""
    values.setdefault("start-time", core.time().strftime("%H:%M:%S"))
    if values["start-time"] != "startup":
        values.setdefault("start-date", core.stamp().split()[0])


_COMPLETE: dict[str, Callable[[Core, dict[str, str], frozenset[str] | None], None]] = {
    "/ip/address": _fill_address,
    "/interface/ovpn-client": _complete_tunnel,
    "/system/clock": _clock,
    "/system/scheduler": _schedule,
}
