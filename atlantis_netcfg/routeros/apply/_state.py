"""Comparison of two observations of a device, the marker of a run on it, and its saved state."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.routeros._items import DesiredState, RowItem, RunTime
from atlantis_netcfg.routeros.api import Command, Reply
from atlantis_netcfg.routeros.apply import _writer
from atlantis_netcfg.routeros.commands import script_command
from atlantis_netcfg.routeros.menus import MENUS, Field, Menu, Shape

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from atlantis_netcfg.core.versions import Version
    from atlantis_netcfg.routeros import _types
    from atlantis_netcfg.routeros.api._values import Channel
    from atlantis_netcfg.routeros.apply._job import DeviceJob


_Content = tuple[str, ...]
"""The values of a row, in the order of its menu's fields."""
_BETWEEN, _END = "\x1f", "\x1e"
"""ASCII separators of units and of records, in hashed data."""


def differing_menus(
    before: _types.Observation, now: _types.Observation, run_time: Sequence[RunTime] = ()
) -> tuple[str, ...]:
    """Return the titles of the menus whose configuration differs.

    A value that the device itself replaces in our rows is ignored if listed in `run_time`.
    """
    paths = dict.fromkeys((*before.rows, *now.rows))
    return tuple(
        MENUS[path].title
        for path in paths
        if _content(path, before, run_time=run_time) != _content(path, now, run_time=run_time)
    )


def digest(observation: _types.Observation) -> str:
    """Return a hash of the configuration without secrets, which may therefore be stored."""
    state = hashlib.sha256()
    for path in sorted(observation.rows):
        rows = map(_BETWEEN.join, _content(path, observation, secrets=False))
        state.update(_END.join((path, *rows, _END)).encode(errors="surrogateescape"))
    return state.hexdigest()


def plan_hash(plan: _types.Plan) -> str:
    """Return a hash of what the user sees of a plan, to recognise the plan that was agreed to."""
    actions = [
        (action.menu, action.verb, action.subject, action.ids, action.get_masked_values(), action.before)
        for action in plan.actions
    ]
    return hashlib.sha256(json.dumps(actions).encode()).hexdigest()


def find_invalid_rows(observation: _types.Observation) -> tuple[str, ...]:
    """Return our rows that the device has accepted but does not use, with its reason if given."""
    return tuple(
        msg(f"{arg(menu.name_of(row))} in {arg(menu.title)} ({arg(row.get('.about') or 'invalid')})")
        for menu in map(MENUS.__getitem__, observation.rows)
        for row in observation.rows[menu.path]
        if menu.is_ours(row) and (row.get("invalid") in ("true", "yes") or row.get(".about", "").startswith("inactiv"))
    )


def restore_target(before: _types.Observation) -> DesiredState:
    """Return a desired state equal to the observed one: every row and value, and nothing else."""
    menus = [MENUS[path] for path in before.rows if not MENUS[path].readonly]
    items = {menu.path: tuple(_items(menu, before.rows[menu.path], before.facts.version)) for menu in menus}
    return DesiredState("the state before the run", items, frozenset(items), restores=True)


def _items(menu: Menu, rows: tuple[_types.Row, ...], version: Version) -> list[RowItem]:
    return [
        RowItem(menu.path, _values(menu, row, version), exists=menu.shape is not Shape.LIST or menu.is_stock(row))
        for row in rows
        if menu.is_touchable(row)
    ]


def _values(menu: Menu, row: _types.Row, version: Version) -> Mapping[str, str | None]:
    """Return the row's values; None for an unset property that no other value would reset."""
    return {
        each.name: row.get(each.name)
        for each in menu.fields
        if not each.unread and (each.name in row or (each.keep and each.default is None and each.exists(version)))
    }


def _content(
    path: str, observation: _types.Observation, *, secrets: bool = True, run_time: Sequence[RunTime] = ()
) -> list[_Content]:
    """Return the rows of a menu in comparable form; the order counts only within a chain of first-match rows."""
    menu = MENUS[path]
    run_times = [each for each in run_time if each.menu == path]
    rows = [row for row in observation.rows.get(path, ()) if menu.is_touchable(row)]
    if menu.chain is not None:
        rows = sorted(rows, key=lambda row: row.get(menu.chain or "", ""))
    visible_fields = [each for each in menu.fields if not each.unread and (secrets or not each.secret)]
    content = [_row(menu, _as_declared(menu, row, run_times) if run_times else row, visible_fields) for row in rows]
    return content if menu.is_ordered else sorted(content)


def _as_declared(menu: Menu, row: _types.Row, run_times: Iterable[RunTime]) -> _types.Row:
    """Return our row with the desired values where the device has replaced them."""
    if not menu.is_ours(row):
        return row
    return {
        **row,
        **{
            each.name: each.declared_value
            for each in run_times
            if each.covers(menu, each.name, each.declared_value, row)
        },
    }


def _row(menu: Menu, row: _types.Row, fields: Iterable[Field]) -> _Content:
    """Return a row in canonical form; an empty or default property may be printed or omitted."""
    return tuple(
        menu.form(each.name, row) if (text := row.get(each.name)) is None else each.form(text) for each in fields
    )


_LIST = "atlantis-run"
SIGNS = "/ip/firewall/address-list"
"""The menu that contains run markers."""
_ADDRESS = "192.0.2.1"
"""From a documentation range: no packet can ever be sent to it, whatever uses the list."""

CLAIMS = Command(f"{SIGNS}/print", ((".proplist", ".id,list,comment,timeout"),), (f"?list={_LIST}",))


class ClaimConflict(DeviceError):
    """Another run is in progress on this device."""


def run_of(text: str) -> str:
    """Return the run id in the text of a run marker or job; empty if there is none."""
    match = re.match(r"run (\S+) of ", text)
    return match[1] if match else ""


@dataclass(frozen=True, slots=True)
class RunMarker:
    """A run marker read from the device.

    Two laptops share no lock. Safe mode is one, but nobody holds it between two parts of a long plan, and some devices
    do not have it. The marker is an entry with a timeout in an address list that nothing uses. The device refuses a
    second one, no export contains it, and it expires if its owner has died (manual, Address-lists).
    """

    id: str
    text: str
    timeout: str
    """Remaining lifetime in the device's notation; empty if the device does not report it."""

    @property
    def run(self) -> str:
        """Id of the run that placed the marker, as listed by `provision report runs` there; empty if not given."""
        return run_of(self.text)


@dataclass(frozen=True, slots=True)
class RunSigner:
    """The marker of a run, and the rules for taking over other markers.

    A dead run's marker may be taken over by the computer whose journal contains that run, and by `resume` with its id.
    """

    job: DeviceJob
    address: str
    """Our address, as seen by the device."""

    @property
    def text(self) -> str:
        """Text of the marker: run id, user and address, and the attempt."""
        user = self.job.endpoint.user
        who = f"{user}@{self.address}" if self.address else user
        return msg(
            f"run {arg(self.job.run)} of {arg(who)} ({arg(self.job.nonce)})" if self.job.run else f"a run of {arg(who)}"
        )

    def other(self, candidates: Iterable[RunMarker]) -> RunMarker | None:
        """Return the marker of another run that may be active; dead runs that may be taken over are skipped."""
        return next((sign for sign in candidates if not self.is_over(sign.text)), None)

    def is_over(self, text: str) -> bool:
        """Return True if the run in a marker or job has certainly ended, so its leftovers may be removed."""
        run = run_of(text)
        return text == self.text or bool(run and self.job.history.can_take_over(run, text))


def parse_markers(rows: Sequence[_types.Row]) -> tuple[RunMarker, ...]:
    """Return the signs among the rows of the address lists."""
    sign_rows = (row for row in rows if row.get("list") == _LIST)
    return tuple(
        RunMarker(row.get(".id", ""), row.get("comment") or "a run", row.get("timeout", "")) for row in sign_rows
    )


def find_markers(observation: _types.Observation) -> tuple[RunMarker, ...]:
    """Return the run markers in an observation."""
    return parse_markers(observation.rows.get(SIGNS, ()))


def claim_conflict(sign: RunMarker, site: str) -> ClaimConflict:
    """Return an error with the owner of the marker, its remaining time, and how to take it over."""
    stays = msg(f"within {arg(sign.timeout)}" if sign.timeout else "within half an hour")
    over = msg(
        f"; if that run was interrupted, take over:  provision recover resume site={arg(site)} run={arg(sign.run)}"
        if sign.run
        else ""
    )
    return ClaimConflict(
        f"{arg(sign.text)} is active on this device, or was interrupted there",
        hint=(
            "wait until it has ended, then run the same command again: the marker of an interrupted run disappears "
            f"by itself {arg(stays)}{arg(over)}"
        ),
    )


def claim(ours: str, seconds: float) -> Command:
    """Return the command that places the run marker."""
    values = {"list": _LIST, "address": _ADDRESS, "timeout": f"{seconds:.0f}s", "comment": ours}
    return Command(f"{SIGNS}/add", tuple(values.items()))


async def confirm_claim(
    session: Channel, adding: Command, reply: Reply, rows: Sequence[_types.Row], signer: RunSigner
) -> str:
    """Read the replies to `claim` and to CLAIMS; return the marker's `.id`.

    The marker of a dead run that may be taken over is replaced. Raises ClaimConflict, CommandError, SessionLost.
    """
    if reply.trap is not None:
        rows = rows or (await session.command(CLAIMS)).check().rows
    other = signer.other(parse_markers(rows))
    if other is not None:
        raise claim_conflict(other, signer.job.site)
    if reply.trap is not None:
        await session.flight([withdrawing(row[".id"]) for row in rows])
        reply = await session.command(adding)
    return reply.check().ret or ""


def withdrawing(sign: str) -> Command:
    """Return the command that removes the marker; it is no error if the marker has expired."""
    return Command(f"{SIGNS}/remove", ((".id", sign),))


def is_claiming(action: str) -> bool:
    """Return True if a history entry may be that of a run marker: `address list entry added` (seen on 7.x)."""
    return "address" in action and "list" in action and "added" in action


_COMPLETE = "atlantis: all of it"
_PROBE = "atlantis"
_NAME = "atlantis-before"
_CHUNK = 32_768

SAVING = (script_command(f'/export\n:put "{_COMPLETE}"\n'), script_command(f':put "{_PROBE}"\n'))
"""Commands whose replies `parse_export` reads; they are sent with any round trip."""


@dataclass(frozen=True, slots=True)
class SavedExport:
    """The parsed replies to SAVING.

    An export hides secrets by default, and we keep that default: they must not be stored on a laptop for years.
    """

    text: str | None
    """The whole export; None if the device does not print it into a script's output."""
    writer: _writer.Writer


def parse_export(export: Reply, probe: Reply) -> SavedExport:
    """Parse the replies to SAVING."""
    text = _whole(export.ret or "") if export.trap is None else None
    runs = text is not None or (probe.trap is None and (probe.ret or "").strip() == _PROBE)
    return SavedExport(text, _writer.ScriptWriter() if runs else _writer.SentenceWriter())


async def fetch(session: Channel, instead: Callable[[], str] | None = None) -> str:
    """Read the export through a file on the device; if that fails, return the result of `instead`.

    Before RouterOS 7.13 no file can be read over the API. Raises DeviceError if nothing can be saved.
    """
    try:
        return await _export_to_file(session)
    except DeviceError:
        if instead is None:
            raise
        return instead()


async def _export_to_file(session: Channel) -> str:
    reply = await session.command(Command("/export", (("file", _NAME),)))
    if reply.trap is not None:
        raise _export_error(reply.trap.message)
    data = b""
    while True:
        chunk = await _chunk(session, len(data))
        data += chunk
        if len(chunk) < _CHUNK:
            break
    await session.command(Command("/file/remove", ((".id", f"{_NAME}.rsc"),)))
    text = data.decode(errors="replace")
    if not text.lstrip().startswith("#"):
        raise _export_error("its export is empty")
    return text


async def _chunk(session: Channel, offset: int) -> bytes:
    arguments = (("file", f"{_NAME}.rsc"), ("offset", str(offset)), ("chunk-size", str(_CHUNK)))
    reply = await session.command(Command("/file/read", arguments))
    if reply.trap is not None:
        raise _export_error(reply.trap.message)
    return "".join(row.get("data", "") for row in reply.rows).encode(errors="surrogateescape")


def _whole(text: str) -> str | None:
    """Return the export with one newline at its end; None if it is truncated."""
    body, end_marker, rest = text.replace("\r\n", "\n").rpartition(_COMPLETE)
    if not end_marker or rest.strip() or not body.lstrip().startswith("#"):
        return None
    return body.strip() + "\n"


def _export_error(words: str) -> DeviceError:
    return DeviceError(f"cannot save the state before the change, so nothing is changed; the device says: {arg(words)}")
