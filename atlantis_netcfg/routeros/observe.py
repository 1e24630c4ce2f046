"""Read-only observation of a device in one pass: facts, our session, and the rows of all relevant menus.

All commands are sent in batches of `Endpoint.window`, each in one round trip. A menu that the device lacks replies
`no such command`; what needs it is then refused with a message.

Assumption: api-tagged-order
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.messages import arg, join
from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros import _types, api, pin
from atlantis_netcfg.routeros.menus import MARK, MENUS, Menu, Shape
from atlantis_netcfg.routeros.safe_mode import READ, Holder
from atlantis_netcfg.routeros.scheduler_jobs import READ_JOBS

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from atlantis_netcfg.routeros.api._values import Channel


_UPTIME = re.compile(r"(?:(\d+)w)?(?:(\d+)d)?(?:(\d+)h)?(?:(\d+)m)?(?:(\d+)s)?")
_UPTIME_ONLY: Final = api.Command("/system/resource/print", ((".proplist", "uptime"),))
_UNITS: Final = (604_800, 86_400, 3_600, 60, 1)


def counting(ports: Sequence[str]) -> api.Command:
    """Return the command that reads the counters of these ports (at least one), by default name."""
    first, *others = ports
    either = [word for port in others for word in (f"?default-name={port}", "?#|")]
    properties = (".proplist", "default-name,rx-byte,tx-byte")
    return api.Command("/interface/print", (properties,), (f"?default-name={first}", *either))


def counter_reads(ports: Sequence[str], beside: int, window: int) -> tuple[list[api.Command], list[api.Command]]:
    """Return counter reads to send before and after `beside` other commands, only as far as round trips have room.

    `window`: sentences in flight at once. With room for one read it is the later one, which counts for the month.
    """
    room = -beside % window
    if not ports or not room:
        return [], []
    look = counting(ports)
    return ([look] if room > 1 else []), [look]


def final_reads(ports: Sequence[str]) -> list[api.Command]:
    """Return the final read of counters and uptime, sent with a run's last commands; for `read_counts`."""
    return [counting(ports), _UPTIME_ONLY] if ports else []


def read_counts(reply: api.Reply, resource: api.Reply) -> _types.PortCounts | None:
    """Parse port counters; None if the device refused the request or knows none of the ports.

    Manual, CLI reference, `/interface`: `rx-byte`, `tx-byte`.
    """
    ports = {
        row["default-name"]: (int(row["rx-byte"]), int(row["tx-byte"]))
        for row in reply.rows
        if "default-name" in row and row.get("rx-byte", "").isdecimal() and row.get("tx-byte", "").isdecimal()
    }
    if reply.trap is not None or not ports:
        return None
    uptime = resource.rows[0].get("uptime", "") if resource.rows else ""
    return _types.PortCounts(datetime.now(UTC), seconds(uptime), ports)


def seconds(interval: str) -> float | None:
    """Parse a RouterOS duration (`1w2d3h4m5s`) to seconds; None if it is not one."""
    match = _UPTIME.fullmatch(interval)
    if not interval or match is None:
        return None
    return float(sum(int(digits) * unit for digits, unit in zip(match.groups(), _UNITS, strict=True) if digits))


_RESOURCE = api.Command("/system/resource/print", ((".proplist", "version,board-name,architecture-name,uptime"),))
_DEVICE_MODE = api.Command("/system/device-mode/print")
_ACTIVE = api.Command("/user/active/print", ((".proplist", "name,address,via"),))
_HISTORY = api.Command("/system/history/print", (("count-only", ""),))
_IDENTITY, _USER, _GROUP = "/system/identity", "/user", "/user/group"
CERTIFICATES: Final = "/certificate"
LATER = (CERTIFICATES, _USER, _GROUP)
"""Menus needed only for a change: is it permitted, and for our user? No other menu changes them."""
LEAVES: Final = frozenset(
    {
        "/ip/dhcp-server/lease",
        "/ip/dns/static",
        "/ip/firewall/address-list",
        "/ip/firewall/filter",
        "/ip/firewall/mangle",
        "/ip/firewall/nat",
        "/ip/firewall/raw",
        "/ip/route",
        "/routing/rule",
        "/system/logging",
        "/system/scheduler",
        "/tool/netwatch",
    }
)
"""Menus whose rows can be added, removed or changed without effect on rows of another menu."""
BRIEF: Final = ("/ip/dns/static", "/ip/firewall/address-list")
"""Menus whose foreign rows may be read in short form: no row's meaning depends on other rows."""
WHOLE: Final = frozenset({"/interface/bridge", "/ip/dhcp-server", "/ip/firewall/mangle", "/ip/firewall/nat"})
"""Menus with few rows, in which a list of all property names is longer than the rest of a row."""
HISTORY: Final = 100
"""Entries that a device's history keeps: beyond them their number does not reveal changes by others."""
_MISSING = ("no such command", "no such directory")
_FORBIDDEN = "not enough permissions"
_OURS = (f"?<comment={MARK}", "?#!", f"?<comment={MARK[:-1]}{chr(ord(MARK[-1]) + 1)}", "?#&", "?dynamic=true", "?#|")
"""Rows whose comment starts with our mark, and dynamic rows of the device. Assumption: api-query-order."""
_FOLLOWING: Final = {"/ip/route": ("?connect=true", "?#!")}
"""Rows derived from an address, which is read anyway, are not requested; receiving them does no harm."""
_SAMPLES: Final = 3


class MenuMissing(DeviceError):
    """The device lacks a menu that the desired state needs: its version is too old, or a package is missing."""


@dataclass(frozen=True, slots=True)
class _Preflight:
    """Replies about the device itself."""

    resource: api.Reply
    safe_mode: api.Reply
    active: api.Reply
    history: api.Reply
    jobs: api.Reply
    device_mode: api.Reply = field(default_factory=api.Reply)


# Last, so that who holds safe mode is the latest that is known.
_PREFLIGHT = (_RESOURCE, READ, _ACTIVE, _HISTORY, READ_JOBS, _DEVICE_MODE)
_AGAIN = 2
"""Number of those requests to an already known device: its version, and the holder of safe mode."""


def _complete_facts(facts: _types.Facts, known_facts: _types.Facts, *, with_policies: bool) -> _types.Facts:
    """Add what was read earlier in this run and is not read again."""
    return replace(
        facts,
        device_mode=known_facts.device_mode,
        session_address=known_facts.session_address,
        history=known_facts.history,
        policies=known_facts.policies if with_policies else facts.policies,
    )


async def observe(  # noqa: PLR0913, PLR0917 - what to read, and what is known already
    session: Channel,
    endpoint: api.Endpoint,
    required_menus: Sequence[str],
    looked_at: Sequence[str] = (),
    counted_ports: Sequence[str] = (),
    known_facts: _types.Facts | None = None,
    brief: Collection[str] = (),
) -> _types.Observation:
    """Read facts and menus. `required_menus` must exist, `looked_at` are read if the device has them.

    The user's policies and the limits of device-mode are included if users and groups are among the menus.

    The byte counters of `counted_ports` are read first and last if a round trip has room; they never cost an extra one.
    `known_facts`: facts read earlier in this run; then only version, name and the holder of safe mode are read again.
    `brief`: menus in which others may have thousands of rows. There our rows are read and all are counted. If there are
    more than a hundred others, these are read as bare ids, else the menu is read in full; both cost one more round
    trip.

    Raises MenuMissing naming what the device lacks, CommandError if it may not be read, SessionLost.
    """
    menus = list(dict.fromkeys((*required_menus, *looked_at, _IDENTITY)))
    is_requested = _GROUP in menus
    about = _PREFLIGHT[:_AGAIN] if known_facts is not None else _PREFLIGHT if is_requested else _PREFLIGHT[:-1]
    counted_menus = [path for path in menus if path in brief]
    reading = [replace(printing(path), queries=_OURS) if path in brief else printing(path) for path in menus]
    commands = [*reading, *map(counting_rows, counted_menus), *about]
    modem = [pin.MONITOR] if pin.LTE in required_menus else []
    commands = [*modem, *commands]
    first, last = counter_reads(counted_ports, len(commands), api.WINDOW if modem else endpoint.window)
    replies = await session.flight([*first, *commands, *last])
    counters = [*replies[: len(first)], *replies[len(replies) - len(last) :]]
    replies = replies[len(first) : len(first) + len(commands)]
    result, replies = replies[: len(modem)], replies[len(modem) :]
    answers = dict(zip(menus, replies, strict=False))
    numbers = dict(zip(counted_menus, replies[len(menus) :], strict=False))
    replies = [*replies[: len(menus)], *replies[len(menus) + len(counted_menus) :]]
    silent = [api.Reply()] * (len(_PREFLIGHT) + len(menus) - len(replies))
    preflight = _Preflight(*replies[len(menus) :], *silent)
    rows = {path: _rows(path, reply, is_required=path in required_menus) for path, reply in answers.items()}
    version = _version(preflight.resource.check())
    missing = [path for path in required_menus if rows[path] is None]
    if missing:
        names = join(", ", (MENUS[path].title for path in missing))
        raise MenuMissing(
            f"this device (RouterOS {arg(version)}) does not have {arg(names)}",
            hint="upgrade RouterOS, install the package that provides it, or remove these rows from the template",
        )
    present_rows = {path: there for path, there in rows.items() if there is not None}
    present_rows |= await _others(
        session, {path: present_rows[path] for path in counted_menus if path in present_rows}, numbers
    )
    counts = (read_counts(reply, preflight.resource) for reply in counters)
    facts = _facts(preflight, endpoint, version, present_rows, is_requested=is_requested)
    if known_facts is not None:
        facts = _complete_facts(facts, known_facts, with_policies=not is_requested)
    found_counts = tuple(each for each in counts if each is not None)
    monitor = pin.monitor_of(present_rows.get(pin.LTE, ()))
    modem_now = modem_row(result[0] if monitor == pin.MONITOR else await session.command(monitor)) if result else None
    uptime_s = seconds(_first(preflight.resource).get("uptime", ""))
    return _types.Observation(facts, present_rows, found_counts, modem_now, preflight.jobs.check().rows, uptime_s)


async def read_back(
    session: Channel,
    endpoint: api.Endpoint,
    observation: _types.Observation,
    touched_menus: Collection[str],
    counted_ports: Sequence[str] = (),
) -> _types.Observation:
    """Read the device after a change of `LEAVES` menus, which affect no others: these in full, the rest as counts.

    A menu whose number of rows differs from `observation` is read, too. A value that somebody has set meanwhile in
    another menu, without adding or removing a row, is found by the next run. Settings have no rows to count, and are
    taken from `observation`. Raises CommandError, SessionLost.
    """
    others = [
        path for path in observation.rows if path not in touched_menus and MENUS[path].shape is not Shape.SINGLETON
    ]
    commands = [*map(printing, touched_menus), *map(counting_rows, others), _RESOURCE, READ]
    first, last = counter_reads(counted_ports, len(commands), endpoint.window)
    replies = await session.flight([*first, *commands, *last])
    counters = [*replies[: len(first)], *replies[len(replies) - len(last) :]]
    replies = replies[len(first) : len(first) + len(commands)]
    *numbers, resource, holder = replies[len(touched_menus) :]
    changed_menus = [
        path
        for path, reply in zip(others, numbers, strict=True)
        if number_of_rows(reply) != len(observation.rows[path])
    ]
    current = merge_menus(observation, list(touched_menus), replies[: len(touched_menus)])
    if changed_menus:
        current = merge_menus(current, changed_menus, await session.flight([*map(printing, changed_menus)]))
    facts = replace(
        observation.facts, version=_version(resource.check()), safe_mode_owner=Holder.of(holder).who or None
    )
    counts = (read_counts(reply, resource) for reply in counters)
    return _types.Observation(
        facts, current.rows, tuple(each for each in counts if each is not None), observation.modem
    )


async def _others(
    session: Channel, ours: Mapping[str, Sequence[_types.Row]], numbers: Mapping[str, api.Reply]
) -> dict[str, tuple[_types.Row, ...]]:
    """Return the menus that have other rows than ours: in full, or ids only for very many other rows."""
    number = {path: number_of_rows(numbers[path]) for path in ours}
    more = {path: len(rows) for path, rows in ours.items() if number[path] != len(rows)}
    bare = [path for path, few in more.items() if (number[path] or 0) - few > _types.FEW_FOREIGN]
    reading = {path: _print_ids(path) if path in bare else printing(path) for path in more}
    answers = await session.flight(list(reading.values())) if reading else ()
    rows_by_menu = {path: reply.check().rows for path, reply in zip(reading, answers, strict=True)}
    return {path: _together(rows, ours[path]) if path in bare else rows for path, rows in rows_by_menu.items()}


def _print_ids(path: str) -> api.Command:
    return api.Command(f"{path}/print", ((".proplist", ".id"),))


def _together(rows: Sequence[_types.Row], known_rows: Iterable[_types.Row]) -> tuple[_types.Row, ...]:
    """Return `rows`, replaced by the known full rows where available."""
    by_id = {row[".id"]: row for row in known_rows}
    return tuple(by_id.get(row[".id"], row) for row in rows)


def samples(observation: _types.Observation) -> dict[str, api.Command]:
    """Return, by menu, the command that reads the last few bare rows, so that the user sees their owner."""
    bare = {
        path: [row[".id"] for row in rows if _types.is_bare(row)][-_SAMPLES:] for path, rows in observation.rows.items()
    }
    either = {
        path: [f"?.id={first}", *(word for each in more for word in (f"?.id={each}", "?#|"))]
        for path, (first, *more) in ((path, ids) for path, ids in bare.items() if ids)
    }
    return {path: replace(printing(path), queries=tuple(words)) for path, words in either.items()}


def with_rows(
    observation: _types.Observation, menus: Iterable[str], replies: Iterable[api.Reply]
) -> _types.Observation:
    """Return the observation with bare rows replaced by the rows read since."""
    fresh = {
        path: _together(observation.rows[path], reply.check().rows) for path, reply in zip(menus, replies, strict=True)
    }
    return replace(observation, rows={**observation.rows, **fresh})


async def read_bare(session: Channel, observation: _types.Observation) -> _types.Observation:
    """Return the observation after reading in full all menus with bare rows."""
    menus = [path for path, rows in observation.rows.items() if any(map(_types.is_bare, rows))]
    replies = await session.flight([*map(printing, menus)])
    fresh = {path: _configuration_rows(path, reply.check()) for path, reply in zip(menus, replies, strict=True)}
    return replace(observation, rows={**observation.rows, **fresh})


def counting_rows(path: str) -> api.Command:
    """Return the command that counts the rows which `printing` would read."""
    return api.Command(f"{path}/print", (("count-only", ""),), _FOLLOWING.get(path, ()))


def number_of_rows(reply: api.Reply) -> int | None:
    """Parse the reply to `counting_rows`; None if the device did not count. Assumption: api-count-only."""
    return int(reply.ret) if reply.trap is None and reply.ret is not None and reply.ret.isdecimal() else None


async def complete_observation(
    session: Channel,
    endpoint: api.Endpoint,
    observation: _types.Observation,
    beside: Sequence[api.Command] = (),
    later: Iterable[str] = LATER,
) -> tuple[_types.Observation, list[api.Reply]]:
    """Return the observation with the menus in `later` and device-mode; known menus are not read again.

    `beside` is sent in the same round trip; its replies are returned second.
    """
    menus = [path for path in dict.fromkeys(later) if path not in observation.rows]
    replies = await session.flight([*map(printing, menus), _DEVICE_MODE, *beside])
    replies, answers = replies[: len(menus) + 1], replies[len(menus) + 1 :]
    *replies, device_mode = replies
    fresh = {path: _rows(path, reply, is_required=False) for path, reply in zip(menus, replies, strict=True)}
    rows = {**observation.rows, **{path: there for path, there in fresh.items() if there is not None}}
    facts = replace(observation.facts, policies=_policies(endpoint.user, rows), device_mode=_first(device_mode))
    return replace(observation, facts=facts, rows=rows), answers


def modem_row(reply: api.Reply) -> _types.Row | None:
    """Return a modem's SIM status without identifying numbers; None if the device has no modem."""
    if reply.trap is not None or not reply.rows:
        return None
    return {name: value for name, value in reply.rows[0].items() if name in pin.STATUS_FIELDS}


def merge_menus(
    observation: _types.Observation, menus: Sequence[str], replies: Sequence[api.Reply]
) -> _types.Observation:
    """Return an observation in which some menus are replaced by a later reading."""
    fresh = {path: _configuration_rows(path, reply.check()) for path, reply in zip(menus, replies, strict=True)}
    return _types.Observation(observation.facts, {**observation.rows, **fresh}, modem=observation.modem)


def printing(path: str) -> api.Command:
    """Return the command that reads a menu; settings in full, as a list of their names costs more than the values."""
    menu = MENUS[path]
    whole = menu.shape is Shape.SINGLETON or path in WHOLE
    arguments = () if whole else ((".proplist", ",".join((".id", *_properties(menu)))),)
    arguments = (*arguments, ("config", "")) if menu.has_config_view else arguments
    return api.Command(f"{path}/print", arguments, _FOLLOWING.get(path, ()))


def _properties(menu: Menu) -> tuple[str, ...]:
    """Return the property names of all versions: a device omits properties that it does not have.

    Assumption: api-unknown-property
    """
    readable = (each.name for each in menu.fields if not each.unread)
    return tuple(dict.fromkeys((*readable, *menu.flags)))


def _configuration_rows(path: str, reply: api.Reply) -> tuple[_types.Row, ...]:
    """Return the rows; for settings without unrequested properties, as clocks and counters are not configuration."""
    menu = MENUS[path]
    if menu.shape is not Shape.SINGLETON and menu.path not in WHOLE:
        return reply.rows
    if menu.shape is Shape.SINGLETON and len(reply.rows) > 1:
        raise DeviceError(
            f"{arg(menu.title)}: settings are a single row, but the device returned {arg(len(reply.rows))}; it is "
            "unknown which one applies",
            hint=f"check them on the device:  {arg(menu.title)} print",
        )
    names = (".id", *_properties(menu)) if menu.path in WHOLE else _properties(menu)
    return tuple({name: row[name] for name in names if name in row} for row in reply.rows)


def _rows(path: str, reply: api.Reply, *, is_required: bool) -> tuple[_types.Row, ...] | None:
    """Return the rows; None if the device lacks the menu, or forbids reading one that is not required."""
    silent = _MISSING if is_required else (*_MISSING, _FORBIDDEN)
    if reply.trap is not None and reply.trap.message.startswith(silent):
        return None
    return _configuration_rows(path, reply.check())


def _version(resource: api.Reply) -> Version:
    text = _first(resource).get("version", "")
    try:
        return Version.parse(text)
    except ValueError:
        raise DeviceError(f"unknown RouterOS version: `{arg(text)}`") from None


def _facts(
    preflight: _Preflight,
    endpoint: api.Endpoint,
    version: Version,
    rows: Mapping[str, Sequence[_types.Row]],
    *,
    is_requested: bool,
) -> _types.Facts:
    resource = _first(preflight.resource)
    return _types.Facts(
        identity=_first_of(rows.get(_IDENTITY, ())).get("name", ""),
        version=version,
        board=resource.get("board-name", ""),
        architecture=resource.get("architecture-name", ""),
        device_mode=_first(preflight.device_mode),
        packages=(),
        policies=_policies(endpoint.user, rows) if is_requested else None,
        has_safe_mode=preflight.safe_mode.trap is None,
        safe_mode_owner=Holder.of(preflight.safe_mode).who or None,
        session_address=_session_address(preflight.active, endpoint),
        history=_count(preflight.history),
    )


def _first(reply: api.Reply) -> _types.Row:
    return _first_of(reply.rows)


def _first_of(rows: Sequence[_types.Row]) -> _types.Row:
    return rows[0] if rows else {}


def _policies(user: str, rows: Mapping[str, Sequence[_types.Row]]) -> frozenset[str]:
    """Return the policies of our user's group; empty if the device does not show them (for a RADIUS user)."""
    group = next((row.get("group") for row in rows.get(_USER, ()) if row.get("name") == user), None)
    policy = next((row.get("policy", "") for row in rows.get(_GROUP, ()) if row.get("name") == group), "")
    return frozenset(word for word in policy.split(",") if word and not word.startswith("!"))


def _session_address(active: api.Reply, endpoint: api.Endpoint) -> str:
    """Return the address of our user's newest API session: the list grows at its end, and ours is the newest.

    Assumption: api-sessions-newest-last
    """
    ours = [row for row in active.rows if row.get("name") == endpoint.user and row.get("via", "").startswith("api")]
    return ours[-1].get("address", "") if ours else ""


def _count(reply: api.Reply) -> int:
    return int(reply.ret) if reply.ret is not None and reply.ret.isdecimal() else 0
