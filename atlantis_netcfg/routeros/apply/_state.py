"""Comparing two readings of a device, the sign of a run on it, and its saved state."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceError
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
"""ASCII's separators of units and of records, for what is hashed."""


def differing(before: _types.Observation, now: _types.Observation, run_time: Sequence[RunTime] = ()) -> tuple[str, ...]:
    """Return the menus (as a person writes them) whose configuration differs.

    What a device does to rows of ours by itself (`run_time`) is no difference where it is named.
    """
    paths = dict.fromkeys((*before.rows, *now.rows))
    return tuple(
        MENUS[path].title
        for path in paths
        if _content(path, before, run_time=run_time) != _content(path, now, run_time=run_time)
    )


def digest(observation: _types.Observation) -> str:
    """Return a hash of the configuration without its secrets, so that it may be written down."""
    state = hashlib.sha256()
    for path in sorted(observation.rows):
        rows = map(_BETWEEN.join, _content(path, observation, secrets=False))
        state.update(_END.join((path, *rows, _END)).encode(errors="surrogateescape"))
    return state.hexdigest()


def plan_hash(plan: _types.Plan) -> str:
    """Return a hash of what a person sees of a plan, so that the plan agreed to can be told from another one."""
    actions = [
        (action.menu, action.verb, action.subject, action.ids, action.get_masked_values(), action.before)
        for action in plan.actions
    ]
    return hashlib.sha256(json.dumps(actions).encode()).hexdigest()


def invalid(observation: _types.Observation) -> tuple[str, ...]:
    """Return the rows of ours that the device has taken but does not use, with its reason where it gives one."""
    return tuple(
        f"{menu.name_of(row)} in {menu.title} ({row.get('.about') or 'invalid'})"
        for menu in map(MENUS.__getitem__, observation.rows)
        for row in observation.rows[menu.path]
        if menu.is_ours(row) and (row.get("invalid") in ("true", "yes") or row.get(".about", "").startswith("inactiv"))
    )


def restoring(before: _types.Observation) -> DesiredState:
    """Return the observed state as something to declare: every row and every value, nothing else."""
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
    """What the row says, and None for what it did not say and nothing else would take back: it was unset."""
    return {
        each.name: row.get(each.name)
        for each in menu.fields
        if not each.unread and (each.name in row or (each.keep and each.default is None and each.exists(version)))
    }


def _content(
    path: str, observation: _types.Observation, *, secrets: bool = True, run_time: Sequence[RunTime] = ()
) -> list[_Content]:
    """Return the rows of a menu; of first-match rows the order counts, but only among those of one chain."""
    menu = MENUS[path]
    run_times = [each for each in run_time if each.menu == path]
    rows = [row for row in observation.rows.get(path, ()) if menu.is_touchable(row)]
    if menu.chain is not None:
        rows = sorted(rows, key=lambda row: row.get(menu.chain or "", ""))
    visible_fields = [each for each in menu.fields if not each.unread and (secrets or not each.secret)]
    content = [_row(menu, _as_declared(menu, row, run_times) if run_times else row, visible_fields) for row in rows]
    return content if menu.is_ordered else sorted(content)


def _as_declared(menu: Menu, row: _types.Row, run_times: Iterable[RunTime]) -> _types.Row:
    """Return a row of ours with the declared values where the device has put others in their place."""
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
    """Return a row in canonical form; a property that is empty or at its default may be printed or left out."""
    return tuple(
        menu.form(each.name, row) if (text := row.get(each.name)) is None else each.form(text) for each in fields
    )


_LIST = "atlantis-run"
SIGNS = "/ip/firewall/address-list"
"""The menu that signs are rows of."""
_ADDRESS = "192.0.2.1"
"""Of a documentation range: nothing can ever be sent to it, whatever uses the list."""

CLAIMS = Command(f"{SIGNS}/print", ((".proplist", ".id,list,comment,timeout"),), (f"?list={_LIST}",))


class ClaimConflict(DeviceError):
    """Another run is under way on this device."""


def run_of(text: str) -> str:
    """Return the run that a sign or a job names; empty where it names none."""
    match = re.match(r"run (\S+) of ", text)
    return match[1] if match else ""


@dataclass(frozen=True, slots=True)
class Sign:
    """A sign as it was read.

    Two laptops have no lock in common. Safe mode is one, but between two pieces of a long plan nobody holds it, and
    without it there is none. The sign is an entry of an address list that nothing uses, with a time-out: the device
    refuses a second one, no export shows it, and it goes by itself when whoever put it up has died (manual,
    Address-lists).
    """

    id: str
    text: str
    timeout: str
    """How long it stays, in the device's words; empty where the device does not say it."""

    @property
    def run(self) -> str:
        """The run that has put it up, as `provision runs` lists it there; empty where the sign does not say it."""
        return run_of(self.text)


@dataclass(frozen=True, slots=True)
class RunSigner:
    """A run that puts its sign up, and knows which signs it may take over.

    A dead run's sign is taken over by the computer whose journal holds it, and by whoever names that run to `resume`.
    """

    job: DeviceJob
    address: str
    """Ours, as the device sees it."""

    @property
    def text(self) -> str:
        """What the sign says: whose run it is, from where, and which attempt at it."""
        user = self.job.endpoint.user
        who = f"{user}@{self.address}" if self.address else user
        return f"run {self.job.run} of {who} ({self.job.nonce})" if self.job.run else f"a run of {who}"

    def other(self, candidates: Iterable[Sign]) -> Sign | None:
        """Return the sign of somebody else who may be at work; none of a dead run that may be taken over."""
        return next((sign for sign in candidates if not self.is_over(sign.text)), None)

    def is_over(self, text: str) -> bool:
        """Whether the run that a sign or a job names so is over for certain, so that what it has left may be taken."""
        run = run_of(text)
        return text == self.text or bool(run and self.job.history.can_take_over(run, text))


def signs(rows: Sequence[_types.Row]) -> tuple[Sign, ...]:
    """Return the signs among the rows of the address lists."""
    sign_rows = (row for row in rows if row.get("list") == _LIST)
    return tuple(Sign(row.get(".id", ""), row.get("comment") or "a run", row.get("timeout", "")) for row in sign_rows)


def read_signs(observation: _types.Observation) -> tuple[Sign, ...]:
    """Return the signs on the device as it was read."""
    return signs(observation.rows.get(SIGNS, ()))


def claimed_by(sign: Sign, site: str) -> ClaimConflict:
    """Say whose run it is, how long its sign stays, and how it is taken over."""
    stays = f"within {sign.timeout}" if sign.timeout else "within half an hour"
    over = f"; if that run has died, take over:  provision resume site={site} run={sign.run}" if sign.run else ""
    return ClaimConflict(
        f"{sign.text} is under way on this device, or has died there",
        hint=f"wait until it has ended, then type the same command again: the sign of a run that died goes by itself"
        f" {stays}{over}",
    )


def claim(ours: str, seconds: float) -> Command:
    """Return the command that puts the sign up."""
    values = {"list": _LIST, "address": _ADDRESS, "timeout": f"{seconds:.0f}s", "comment": ours}
    return Command(f"{SIGNS}/add", tuple(values.items()))


async def confirm_claim(
    session: Channel, adding: Command, reply: Reply, rows: Sequence[_types.Row], signer: RunSigner
) -> str:
    """Read the answers to `claim` and to CLAIMS, and return the sign's `.id`.

    The sign of a dead run that may be taken over is replaced. Raises Claimed, Refused, SessionLost.
    """
    if reply.trap is not None:
        rows = rows or (await session.command(CLAIMS)).check().rows
    other = signer.other(signs(rows))
    if other is not None:
        raise claimed_by(other, signer.job.site)
    if reply.trap is not None:
        await session.flight([withdrawing(row[".id"]) for row in rows])
        reply = await session.command(adding)
    return reply.check().ret or ""


def withdrawing(sign: str) -> Command:
    """Return the command that takes the sign down; that it has gone by itself is as good."""
    return Command(f"{SIGNS}/remove", ((".id", sign),))


def is_claiming(action: str) -> bool:
    """Whether the history calls an action so that may be the sign's: `address list entry added` (seen on 7.x)."""
    return "address" in action and "list" in action and "added" in action


_COMPLETE = "atlantis: all of it"
_PROBE = "atlantis"
_NAME = "atlantis-before"
_CHUNK = 32_768

SAVING = (script_command(f'/export\n:put "{_COMPLETE}"\n'), script_command(f':put "{_PROBE}"\n'))
"""Commands whose answers `parse_export` reads; they go wherever a round trip is under way."""


@dataclass(frozen=True, slots=True)
class SavedExport:
    """What the answers to SAVING hold.

    An export hides secrets unless asked otherwise, and is not asked otherwise: what is kept on a laptop for years is no
    place for them.
    """

    text: str | None
    """The whole export, or None if the device does not print it into a script's output."""
    writer: _writer.Writer


def parse_export(export: Reply, probe: Reply) -> SavedExport:
    """Read the answers to SAVING."""
    text = _whole(export.ret or "") if export.trap is None else None
    runs = text is not None or (probe.trap is None and (probe.ret or "").strip() == _PROBE)
    return SavedExport(text, _writer.ScriptWriter() if runs else _writer.SentenceWriter())


async def fetch(session: Channel, instead: Callable[[], str] | None = None) -> str:
    """Get the export by way of a file on the device, or what is to be saved `instead` of it.

    Before RouterOS 7.13 no file can be read over the API. Raises DeviceFailed if nothing can be saved.
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
        raise _impossible(reply.trap.message)
    data = b""
    while True:
        chunk = await _chunk(session, len(data))
        data += chunk
        if len(chunk) < _CHUNK:
            break
    await session.command(Command("/file/remove", ((".id", f"{_NAME}.rsc"),)))
    text = data.decode(errors="replace")
    if not text.lstrip().startswith("#"):
        raise _impossible("its export is empty")
    return text


async def _chunk(session: Channel, offset: int) -> bytes:
    arguments = (("file", f"{_NAME}.rsc"), ("offset", str(offset)), ("chunk-size", str(_CHUNK)))
    reply = await session.command(Command("/file/read", arguments))
    if reply.trap is not None:
        raise _impossible(reply.trap.message)
    return "".join(row.get("data", "") for row in reply.rows).encode(errors="surrogateescape")


def _whole(text: str) -> str | None:
    """Return an export that was not cut off, with one newline at its end."""
    body, end_marker, rest = text.replace("\r\n", "\n").rpartition(_COMPLETE)
    if not end_marker or rest.strip() or not body.lstrip().startswith("#"):
        return None
    return body.strip() + "\n"


def _impossible(words: str) -> DeviceError:
    return DeviceError(f"the state before the change cannot be saved, so nothing is changed; the device says: {words}")
