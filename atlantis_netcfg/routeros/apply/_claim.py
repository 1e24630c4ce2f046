"""A sign on the device that a run is under way, for changes during which safe mode is not held all the time.

Two laptops have no lock in common. Safe mode is one, but between two pieces of a long plan nobody holds it, and without
it there is none. The sign is an entry of an address list that nothing uses, with a time-out: the device refuses a
second one, no export shows it, and it goes by itself when whoever put it up has died (manual, Address-lists).

A dead run's sign is taken over by the computer whose journal holds it, and by whoever names that run to `resume`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceFailed
from atlantis_netcfg.routeros.api import Command

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from atlantis_netcfg.routeros._types import Observed, Row
    from atlantis_netcfg.routeros.api import Reply
    from atlantis_netcfg.routeros.apply._job import Channel, DeviceJob

_LIST = "atlantis-run"
SIGNS = "/ip/firewall/address-list"
"""The menu that signs are rows of."""
_ADDRESS = "192.0.2.1"
"""Of a documentation range: nothing can ever be sent to it, whatever uses the list."""

CLAIMS = Command(f"{SIGNS}/print", ((".proplist", ".id,list,comment,timeout"),), (f"?list={_LIST}",))


class Claimed(DeviceFailed):
    """Another run is under way on this device."""


def run_of(text: str) -> str:
    """Return the run that a sign or a job names; empty where it names none."""
    named = re.match(r"run (\S+) of ", text)
    return named[1] if named else ""


@dataclass(frozen=True, slots=True)
class Sign:
    """A sign as it was read."""

    id: str
    text: str
    timeout: str
    """How long it stays, in the device's words; empty where the device does not say it."""

    @property
    def run(self) -> str:
        """The run that has put it up, as `provision runs` lists it there; empty where the sign does not say it."""
        return run_of(self.text)


@dataclass(frozen=True, slots=True)
class Signer:
    """A run that puts its sign up, and knows which signs it may take over."""

    job: DeviceJob
    address: str
    """Ours, as the device sees it."""

    @property
    def text(self) -> str:
        """What the sign says: whose run it is, and from where."""
        user = self.job.endpoint.user
        who = f"{user}@{self.address}" if self.address else user
        return f"run {self.job.run} of {who}" if self.job.run else f"a run of {who}"

    def other(self, found: Iterable[Sign]) -> Sign | None:
        """Return the sign of somebody else who may be at work; none of a dead run that may be taken over."""
        return next((sign for sign in found if not self.is_over(sign.text)), None)

    def is_over(self, text: str) -> bool:
        """Whether the run that a sign or a job names so is over for certain, so that what it has left may be taken."""
        run = run_of(text)
        return text == self.text or bool(run and self.job.history.signed(run, text))


def signs(rows: Sequence[Row]) -> tuple[Sign, ...]:
    """Return the signs among the rows of the address lists."""
    found = (row for row in rows if row.get("list") == _LIST)
    return tuple(Sign(row.get(".id", ""), row.get("comment") or "a run", row.get("timeout", "")) for row in found)


def seen(observed: Observed) -> tuple[Sign, ...]:
    """Return the signs on the device as it was read."""
    return signs(observed.rows.get(SIGNS, ()))


def claimed_by(sign: Sign, site: str) -> Claimed:
    """Say whose run it is, how long its sign stays, and how it is taken over."""
    stays = f"within {sign.timeout}" if sign.timeout else "within half an hour"
    over = f"; if that run has died, take over:  provision resume site={site} run={sign.run}" if sign.run else ""
    return Claimed(
        f"{sign.text} is under way on this device, or has died there",
        hint=f"wait until it has ended, then type the same command again: the sign of a run that died goes by itself"
        f" {stays}{over}",
    )


def claim(ours: str, seconds: float) -> Command:
    """Return the command that puts the sign up."""
    values = {"list": _LIST, "address": _ADDRESS, "timeout": f"{seconds:.0f}s", "comment": ours}
    return Command(f"{SIGNS}/add", tuple(values.items()))


async def claimed(session: Channel, adding: Command, reply: Reply, rows: Sequence[Row], signer: Signer) -> str:
    """Read the answers to `claim` and to CLAIMS, and return the sign's `.id`.

    The sign of a dead run that may be taken over is replaced. Raises Claimed, Refused, SessionLost.
    """
    if reply.trap is not None:
        rows = rows or (await session.command(CLAIMS)).checked().rows
    other = signer.other(signs(rows))
    if other is not None:
        raise claimed_by(other, signer.job.site)
    if reply.trap is not None:
        await session.flight([withdrawing(row[".id"]) for row in rows])
        reply = await session.command(adding)
    return reply.checked().ret or ""


def withdrawing(sign: str) -> Command:
    """Return the command that takes the sign down; that it has gone by itself is as good."""
    return Command(f"{SIGNS}/remove", ((".id", sign),))


def is_claiming(action: str) -> bool:
    """Whether the history calls an action so that may be the sign's: `address list entry added` (seen on 7.x)."""
    return "address" in action and "list" in action and "added" in action
