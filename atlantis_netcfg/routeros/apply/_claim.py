"""A sign on the device that a run is under way, for changes during which safe mode is not held all the time.

Two laptops have no lock in common. Safe mode is one, but between two pieces of a long plan nobody holds it, and without
it there is none. The sign is an entry of an address list that nothing uses, with a time-out: the device refuses a
second one, no export shows it, and it goes by itself when whoever put it up has died (manual, Address-lists).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.errors import DeviceFailed
from atlantis_netcfg.routeros.api import Command

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.routeros._types import Observed, Row
    from atlantis_netcfg.routeros.api import Reply
    from atlantis_netcfg.routeros.apply._job import Channel

__all__ = [
    "CLAIMS",
    "Claimed",
    "claim",
    "claimant",
    "claimed",
    "claimed_by",
    "is_claiming",
    "other",
    "other_in",
    "withdrawing",
]

_LIST = "atlantis-run"
_MENU = "/ip/firewall/address-list"
_ADDRESS = "192.0.2.1"
"""Of a documentation range: nothing can ever be sent to it, whatever uses the list."""

CLAIMS = Command(f"{_MENU}/print", ((".proplist", ".id,list,comment"),), (f"?list={_LIST}",))


class Claimed(DeviceFailed):
    """Another run is under way on this device."""


def claimant(run: str, user: str, address: str) -> str:
    """Return what the sign says: whose run it is, and from where."""
    who = f"{user}@{address}" if address else user
    return f"run {run} of {who}" if run else f"a run of {who}"


def other(observed: Observed, ours: str) -> str | None:
    """Return whose sign is on the device as it was read, if it is not ours."""
    return other_in(observed.rows.get(_MENU, ()), ours)


def other_in(rows: Sequence[Row], ours: str) -> str | None:
    """Return whose sign is among these rows, if it is not ours."""
    found = (row.get("comment") or "a run" for row in rows if row.get("list") == _LIST)
    return next((who for who in found if who != ours), None)


def claimed_by(who: str) -> Claimed:
    """Say whose run it is."""
    return Claimed(
        f"{who} is under way on this device",
        hint="wait until it has ended, then run the same command again; of a run that died the sign goes by itself",
    )


def claim(ours: str, seconds: float) -> Command:
    """Return the command that puts the sign up."""
    values = {"list": _LIST, "address": _ADDRESS, "timeout": f"{seconds:.0f}s", "comment": ours}
    return Command(f"{_MENU}/add", tuple(values.items()))


async def claimed(session: Channel, adding: Command, reply: Reply, rows: Sequence[Row], ours: str) -> str:
    """Read the answers to `claim` and to CLAIMS, and return the sign's `.id`.

    A sign of the same run, which was killed, is replaced. Raises Claimed, Refused, SessionLost.
    """
    if reply.trap is not None:
        rows = rows or (await session.command(CLAIMS)).checked().rows
    who = other_in(rows, ours)
    if who is not None:
        raise claimed_by(who)
    if reply.trap is not None:
        await session.flight([withdrawing(row[".id"]) for row in rows])
        reply = await session.command(adding)
    return reply.checked().ret or ""


def withdrawing(sign: str) -> Command:
    """Return the command that takes the sign down; that it has gone by itself is as good."""
    return Command(f"{_MENU}/remove", ((".id", sign),))


def is_claiming(action: str) -> bool:
    """Whether the history calls an action so that may be the sign's: `address list entry added` (seen on 7.x)."""
    return "address" in action and "list" in action and "added" in action
