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
    from collections.abc import Mapping, Sequence

    from atlantis_netcfg.routeros._types import Observed, Row
    from atlantis_netcfg.routeros.apply._job import Channel

__all__ = ["CLAIMS", "Claimed", "claim", "claimant", "claimed_by", "other", "other_in", "withdraw"]

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


async def claim(session: Channel, ours: str, seconds: float) -> str:
    """Put the sign up, or take over the one of the same run; return its `.id`. Raises Claimed, DeviceFailed."""
    adding = Command(f"{_MENU}/add", tuple(_values(ours, seconds).items()))
    reply = await session.command(adding)
    if reply.trap is not None:
        rows = (await session.command(CLAIMS)).checked().rows
        who = other_in(rows, ours)
        if who is not None:
            raise claimed_by(who)
        for row in rows:
            await session.command(Command(f"{_MENU}/remove", ((".id", row[".id"]),)))
        reply = await session.command(adding)
    return reply.checked().ret or ""


def _values(ours: str, seconds: float) -> Mapping[str, str]:
    return {"list": _LIST, "address": _ADDRESS, "timeout": f"{seconds:.0f}s", "comment": ours}


async def withdraw(session: Channel, sign: str) -> None:
    """Take the sign down; that it has gone by itself is as good. Raises SessionLost."""
    await session.command(Command(f"{_MENU}/remove", ((".id", sign),)))
