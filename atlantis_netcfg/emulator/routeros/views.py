"""Rows as `print` shows them: what was configured, what the defaults add, what the router computes."""

from __future__ import annotations

from dataclasses import replace
from ipaddress import IPv4Address
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.access import public_key
from atlantis_netcfg.emulator.routeros.certificates import expires_after, known
from atlantis_netcfg.emulator.routeros.derived import dynamic_rows, properties
from atlantis_netcfg.emulator.routeros.devicemode import INACTIVE, allowed
from atlantis_netcfg.emulator.routeros.environment._spec import alert, lease, ntp, tunnel_addresses
from atlantis_netcfg.emulator.routeros.firewall import Packet, Verdict, walk
from atlantis_netcfg.emulator.routeros.lte._modem import made
from atlantis_netcfg.emulator.routeros.menus import Shape
from atlantis_netcfg.emulator.routeros.path import route_to
from atlantis_netcfg.emulator.routeros.values import id_text, interval, spell

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from atlantis_netcfg.emulator.routeros.answers import Caller
    from atlantis_netcfg.emulator.routeros.core import Core
    from atlantis_netcfg.emulator.routeros.menus import Arg
    from atlantis_netcfg.emulator.routeros.store import Item, Store, Table

ECHO_BYTES = 84
"""An echo request or its answer as an IP packet, with 56 bytes of data."""
_FILTER = "/ip/firewall/filter"


def count_echoes(core: Core, target: IPv4Address, source: str | None, number: int, *, answered: bool) -> None:
    """Count echo requests on their way out, and their answers on their way in; one that is dropped is not sent."""
    topology = core.topology
    src = IPv4Address(source) if source else None
    way = route_to(topology, target, src)
    if way is None:
        return
    address = src or target
    port = topology.interfaces[way].name
    if _met(core, "output", Packet(address, target, "new", "icmp", out_interface=way), number) is Verdict.DROP:
        return
    core.count(port, received=False, size=number * ECHO_BYTES)
    if answered:
        core.count(port, received=True, size=number * ECHO_BYTES)
        _met(core, "input", Packet(target, address, "established", "icmp", in_interface=way), number)


def _met(core: Core, chain: str, packet: Packet, number: int) -> Verdict:
    rules: list[int] = []
    verdict = walk(core.topology, _FILTER, chain, packet, met=rules)
    for rule in rules:
        core.met[rule] = core.met.get(rule, 0) + number
    return verdict


HIDDEN = "*****"
"""What a group without policy `sensitive` sees of a secret."""
TRAFFIC = tuple(f"{way}-{what}" for what in ("byte", "packet", "drop", "error") for way in ("rx", "tx"))
"""Counters of an interface (Manual, CLI reference, `/interface`): our own sessions are counted, as bytes of the port
that they come in by; nothing else passes through a twin."""
_COUNTERS = ("bytes", "packets", *TRAFFIC)


def applies(store: Store, table: Table, item: Item, arg: Arg) -> bool:
    """Tell whether an argument is part of a row now (`pvid` of a bridge without VLAN filtering is not)."""
    if arg.shown_if is None:
        return True
    name, desired = arg.shown_if
    return store.text(table, item, name) in desired.split("|")


def factory_value(item: Item, arg: Arg) -> str | None:
    """Return what a row held when the router left the factory, or what a new row holds."""
    return (item.factory or {}).get(arg.name, arg.default)


def configured(store: Store, table: Table, item: Item) -> Iterator[tuple[Arg, str]]:
    """Yield every argument that a row has, with its value as exports spell it."""
    for arg in table.args.values():
        if arg.never or not applies(store, table, item, arg):
            continue
        stored = item.values.get(arg.name)
        value = spell(stored, store) if stored is not None else arg.default
        if value is not None:
            yield arg, value


def item_row(core: Core, path: str, table: Table, item: Item, *, sensitive: bool) -> dict[str, str]:
    """Return one row as the API prints it, counters included."""
    row = {} if table.menu.shape is Shape.SETTINGS else {".id": id_text(item.id)}
    for arg, value in configured(core.store, table, item):
        hidden = arg.secret and value and not sensitive
        row[arg.name] = HIDDEN if hidden else arg.kind.show(value)
    row.update(dict.fromkeys(table.menu.flags, "false"))
    if table.menu.builtin_flag:
        row[table.menu.builtin_flag] = "true" if item.factory is not None else "false"
    if item.dynamic:
        row["dynamic"] = "true"
    row.update(properties(core.topology, path, item))
    extra = _OF_CORE.get(path)
    if extra is not None:
        row.update(extra(core, item))
    return row


def _schedule(core: Core, item: Item) -> dict[str, str]:
    """A job that device-mode blocks says so, and nothing else tells it from one that runs."""
    row = {"owner": "*sys", "run-count": str(core.run_counts.get(item.id, 0))}
    return row if allowed(core.spec, "scheduler") else {**row, ".about": INACTIVE}


def _clock(core: Core, _item: Item) -> dict[str, str]:
    now = core.time()
    return {
        "time": now.strftime("%H:%M:%S"),
        "date": core.stamp().partition(" ")[0],
        "gmt-offset": "+00:00",
        "dst-active": "false",
    }


def _service(core: Core, _item: Item) -> dict[str, str]:
    return {"dynamic": "false"} if core.schema.at_least("7.19") else {}


def _certificate(core: Core, item: Item) -> dict[str, str]:
    """A template says nothing of these before it is signed."""
    pem = core.keys.get(item.id)
    if pem is None:
        return {}
    found, now = known(pem), core.time()
    name = core.store.text(core.store.table("/certificate"), item, "name") or ""
    if (validity := core.spec.around.validity.get(name)) is not None:
        found = replace(found, not_before=validity.since, not_after=validity.until)
    return {
        "serial-number": found.serial,
        "fingerprint": found.fingerprint,
        "invalid-before": core.stamp(found.not_before),
        "invalid-after": core.stamp(found.not_after),
        "expires-after": expires_after(found.not_after, now),
        "private-key": "true" if found.private_key else "false",
        "authority": "true" if found.authority else "false",
        "expired": "true" if found.not_after < now else "false",
    }


def _ssh_key(core: Core, item: Item) -> dict[str, str]:
    """Fields of a key, as they came and went (tikoci/quickchr, test/lab/ssh-keys: 7.12, 7.15, 7.20.8, 7.23.1)."""
    key, since = public_key(core, item.values.get("key", "")), core.schema.at_least
    if key is None:
        return {}
    row = {"key-type": key.algorithm, **({"bits": str(key.bits)} if since("7.15") else {"RSA": "false"})}
    row |= {"fingerprint": key.fingerprint} if since("7.20.8") else {}
    return row | {"info" if since("7.21") else "key-owner": key.comment}


def _expiring(core: Core, item: Item) -> dict[str, str]:
    when = core.expires.get(item.id)
    return {} if when is None else {"timeout": interval(max(0, round(when - core.now())))}


def _netwatch(core: Core, item: Item) -> dict[str, str]:
    """A row that is disabled, or has not begun, knows nothing (Manual, Netwatch: status)."""
    row = core.watched.rows.get(item.id)
    if row is None:
        return {"status": "unknown"}
    sent, answered = row.last
    counts = {"sent-count": sent, "response-count": answered, "loss-count": sent - answered} if row.done else {}
    tests = {"done-tests": row.done, "failed-tests": row.failed}
    shown = {"status": row.status, "since": core.stamp(core.moment(row.since))}
    return shown | {name: str(count) for name, count in (tests | counts).items()}


def _filter(core: Core, item: Item) -> dict[str, str]:
    packets = core.met.get(item.id, 0)
    return {"packets": str(packets), "bytes": str(packets * ECHO_BYTES)}


_OF_CORE: dict[str, Callable[[Core, Item], dict[str, str]]] = {
    "/certificate": _certificate,
    "/ip/firewall/address-list": _expiring,
    "/ip/dhcp-server/alert": alert,
    "/ip/dhcp-server/lease": lease,
    "/ip/firewall/filter": _filter,
    "/ip/service": _service,
    "/system/clock": _clock,
    "/system/ntp/client": ntp,
    "/system/scheduler": _schedule,
    "/tool/netwatch": _netwatch,
    "/user/ssh-keys": _ssh_key,
}


def made_rows(core: Core, path: str) -> list[dict[str, str]]:
    """Return the rows that the router made by itself; they refuse every command but print."""
    if path == "/ip/service" and core.schema.at_least("7.19"):
        return [_connection(core, caller) for caller in core.sessions.values()]
    lacking = _lacking(core, path)
    return [
        {name: value for name, value in row.items() if name not in lacking}
        for row in (*dynamic_rows(core.topology, path), *made(core, path), *tunnel_addresses(core, path))
    ]


def _lacking(core: Core, path: str) -> set[str]:
    """Return what this version's rows do not have of what the table knows: RouterOS 6 has no `routing-table`."""
    table = core.store.table(path)
    return set(table.menu.by_name) - set(table.args)


def _connection(core: Core, caller: Caller) -> dict[str, str]:
    """From 7.19 `/ip/service` also lists the connections that services serve (Manual, Services)."""
    return {
        ".id": id_text(core.store.dynamic_id("/ip/service", "session", caller.number)),
        "name": caller.via,
        "proto": "tcp",
        "local": core.spec.management.local,
        "remote": caller.address,
        "connection": "true",
        "dynamic": "true",
        "disabled": "false",
        "invalid": "false",
    }


def rows(core: Core, path: str, *, sensitive: bool = True) -> list[dict[str, str]]:
    """Return every row of a menu, those that the router made by itself first where RouterOS puts them first."""
    table = core.store.table(path)
    local = [item_row(core, path, table, item, sensitive=sensitive) for item in table.items]
    made = made_rows(core, path)
    return [*made, *local] if path.startswith("/ip/firewall/") else [*local, *made]


def without_counters(row: dict[str, str]) -> dict[str, str]:
    """Leave out what `print` shows only with `stats`."""
    return {name: value for name, value in row.items() if name not in _COUNTERS}
