"""Reading a device in one go: what it is, who we are on it, the rows of every menu that matters. Nothing is changed.

All commands go out in batches of `api.WINDOW`, each batch in one round trip. A menu that the device lacks answers
`no such command`: what needs it is then refused in words.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.errors import DeviceFailed
from atlantis_netcfg.routeros._types import Facts, Observed, Row
from atlantis_netcfg.routeros.api import Command, Reply
from atlantis_netcfg.routeros.counting import looks, read_counts
from atlantis_netcfg.routeros.menus import MENUS, Menu, Shape
from atlantis_netcfg.routeros.pin import LTE, MONITOR, SAID
from atlantis_netcfg.versions import Version

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from atlantis_netcfg.routeros.api import Endpoint
    from atlantis_netcfg.routeros.apply._job import Channel

__all__ = ["LATER", "MenuMissing", "completed", "merged", "modem_row", "observe", "printing"]

_RESOURCE = Command("/system/resource/print", ((".proplist", "version,board-name,architecture-name,uptime"),))
_SAFE_MODE = Command("/safe-mode/print")
_DEVICE_MODE = Command("/system/device-mode/print")
_ACTIVE = Command("/user/active/print", ((".proplist", "name,address,via"),))
_HISTORY = Command("/system/history/print", (("count-only", ""),))
_IDENTITY, _USER, _GROUP = "/system/identity", "/user", "/user/group"
LATER = ("/certificate", _USER, _GROUP)
"""Menus that matter once something is to change: whether it may be changed, and by us."""
_MISSING = ("no such command", "no such directory")
_FORBIDDEN = "not enough permissions"


class MenuMissing(DeviceFailed):
    """The device lacks a menu that the declaration needs: its version is too old, or a package is not installed."""


@dataclass(frozen=True, slots=True)
class _Preflight:
    """The answers about the device itself."""

    resource: Reply
    safe_mode: Reply
    active: Reply
    history: Reply
    device_mode: Reply = field(default_factory=Reply)


# Last, so that who holds safe mode is the latest that is known.
_PREFLIGHT = (_RESOURCE, _SAFE_MODE, _ACTIVE, _HISTORY, _DEVICE_MODE)
_AGAIN = 2
"""So many of them are asked of a device that is known already: what it runs, and who holds safe mode."""


async def observe(  # noqa: PLR0913, PLR0917 - what to read, and what is known already
    session: Channel,
    endpoint: Endpoint,
    needed: Sequence[str],
    looked_at: Sequence[str] = (),
    counted: Sequence[str] = (),
    known: Facts | None = None,
) -> Observed:
    """Read facts and menus. `needed` must be there, `looked_at` are read where the device has them.

    What our user may do, and what device-mode forbids, is told if users and groups are among them.

    The byte counters of the ports `counted` are read first and last, as far as the round trips of the reading have room
    for it: they never cost one of their own. `known`: what an earlier reading of this run has told of the device
    itself, of which only version, name and the holder of safe mode are told anew.
    Raises MenuMissing naming what the device lacks, Refused if it may not be read, SessionLost.
    """
    menus = list(dict.fromkeys((*needed, *looked_at, _IDENTITY)))
    asked = _GROUP in menus
    about = _PREFLIGHT[:_AGAIN] if known is not None else _PREFLIGHT if asked else _PREFLIGHT[:-1]
    commands = [*map(printing, menus), *about]
    modem = [MONITOR] if LTE in needed else []
    commands = [*modem, *commands]
    first, last = looks(counted, len(commands))
    replies = await session.flight([*first, *commands, *last])
    counters = [*replies[: len(first)], *replies[len(replies) - len(last) :]]
    replies = replies[len(first) : len(first) + len(commands)]
    told, replies = replies[: len(modem)], replies[len(modem) :]
    answers = dict(zip(menus, replies, strict=False))
    silent = [Reply()] * (len(_PREFLIGHT) + len(menus) - len(replies))
    seen = _Preflight(*replies[len(menus) :], *silent)
    rows = {path: _rows(reply, needed=path in needed) for path, reply in answers.items()}
    version = _version(seen.resource.checked())
    missing = [path for path in needed if rows[path] is None]
    if missing:
        names = ", ".join(MENUS[path].title for path in missing)
        raise MenuMissing(
            f"this device (RouterOS {version}) does not have {names}",
            hint="upgrade RouterOS or install the package that brings it, or take these rows out of the template",
        )
    found = {path: there for path, there in rows.items() if there is not None}
    counts = (read_counts(reply, seen.resource) for reply in counters)
    facts = _facts(seen, endpoint, version, found, asked=asked)
    if known is not None:
        facts = replace(
            facts, device_mode=known.device_mode, session_address=known.session_address, history=known.history
        )
    return Observed(facts, found, tuple(each for each in counts if each is not None), *map(modem_row, told))


async def completed(session: Channel, endpoint: Endpoint, observed: Observed) -> Observed:
    """Return the observation with what is read LATER, and device-mode; menus that are there are not asked again."""
    menus = [path for path in LATER if path not in observed.rows]
    *replies, device_mode = await session.flight([*map(printing, menus), _DEVICE_MODE])
    fresh = {path: _rows(reply, needed=False) for path, reply in zip(menus, replies, strict=True)}
    rows = {**observed.rows, **{path: there for path, there in fresh.items() if there is not None}}
    facts = replace(observed.facts, policies=_policies(endpoint.user, rows), device_mode=_first(device_mode))
    return replace(observed, facts=facts, rows=rows)


def modem_row(reply: Reply) -> Row | None:
    """Return what a modem says of its SIM, without the numbers that name it; None: the device has no modem."""
    if reply.trap is not None or not reply.rows:
        return None
    return {name: value for name, value in reply.rows[0].items() if name in SAID}


def merged(observed: Observed, menus: Sequence[str], replies: Sequence[Reply]) -> Observed:
    """Return an observation with some menus as they were read since."""
    fresh = {path: reply.checked().rows for path, reply in zip(menus, replies, strict=True)}
    return Observed(observed.facts, {**observed.rows, **fresh}, modem=observed.modem)


def printing(path: str) -> Command:
    """Return the command that reads a menu."""
    own = (("config", ""),) if MENUS[path].configured else ()
    return Command(f"{path}/print", ((".proplist", ",".join(_properties(MENUS[path]))), *own))


def _properties(menu: Menu) -> tuple[str, ...]:
    """Name what is wanted in the words of every version: a device leaves out properties that it does not have."""
    identity = () if menu.shape is Shape.SINGLETON else (".id",)
    readable = (each.name for each in menu.fields if not each.unread)
    return tuple(dict.fromkeys((*identity, *readable, *menu.flags)))


def _rows(reply: Reply, *, needed: bool) -> tuple[Row, ...] | None:
    """Return the rows, or None if the device has no such menu, or keeps one from us that we can do without."""
    silent = _MISSING if needed else (*_MISSING, _FORBIDDEN)
    if reply.trap is not None and reply.trap.message.startswith(silent):
        return None
    return reply.checked().rows


def _version(resource: Reply) -> Version:
    text = _first(resource).get("version", "")
    try:
        return Version.parse(text)
    except ValueError:
        raise DeviceFailed(f"this is no RouterOS that we know: it calls its version `{text}`") from None


def _facts(
    seen: _Preflight, endpoint: Endpoint, version: Version, rows: Mapping[str, Sequence[Row]], *, asked: bool
) -> Facts:
    resource = _first(seen.resource)
    holder = _first(seen.safe_mode)
    taken = holder.get("enabled") in ("true", "yes")
    return Facts(
        identity=_first_of(rows.get(_IDENTITY, ())).get("name", ""),
        version=version,
        board=resource.get("board-name", ""),
        architecture=resource.get("architecture-name", ""),
        device_mode=_first(seen.device_mode),
        packages=(),
        policies=_policies(endpoint.user, rows) if asked else None,
        has_safe_mode=seen.safe_mode.trap is None,
        safe_mode_owner=(holder.get("owner") or holder.get("user") or "somebody") if taken else None,
        session_address=_session_address(seen.active, endpoint),
        history=_count(seen.history),
    )


def _first(reply: Reply) -> Row:
    return _first_of(reply.rows)


def _first_of(rows: Sequence[Row]) -> Row:
    return rows[0] if rows else {}


def _policies(user: str, rows: Mapping[str, Sequence[Row]]) -> frozenset[str]:
    """Return what our user's group may do; nothing if the device does not tell (a user of RADIUS, for instance)."""
    group = next((row.get("group") for row in rows.get(_USER, ()) if row.get("name") == user), None)
    policy = next((row.get("policy", "") for row in rows.get(_GROUP, ()) if row.get("name") == group), "")
    return frozenset(word for word in policy.split(",") if word and not word.startswith("!"))


def _session_address(active: Reply, endpoint: Endpoint) -> str:
    """Return the address of the newest API session of our user: the list grows at its end, and ours is the newest."""
    ours = [row for row in active.rows if row.get("name") == endpoint.user and row.get("via", "").startswith("api")]
    return ours[-1].get("address", "") if ours else ""


def _count(reply: Reply) -> int:
    return int(reply.ret) if reply.ret is not None and reply.ret.isdecimal() else 0
