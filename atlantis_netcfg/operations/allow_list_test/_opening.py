"""Rows that are on the router only while a proof needs them: a filter opened for one host, a way for one question.

Only under safe mode: if this computer or its link dies meanwhile, the router takes them back by itself (after about 2 s
of a session that was closed, after about 9 minutes of one that went silent: Manual, Configuration Management). In the
ordinary case the rows are removed one by one and safe mode is released, not unrolled: to unroll would also take back
what the router's own netwatch scripts have changed meanwhile, such as which link carries the traffic.
"""

from __future__ import annotations

from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceFailed, OutcomeUnknown
from atlantis_netcfg.routeros.api import Command

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Sequence

    from atlantis_netcfg.operations.allow_list_test._reading import Reading
    from atlantis_netcfg.routeros.api import Reply, Session

__all__ = ["MARK", "filter_rows", "temporarily"]

MARK = "atlantis: for a proof, taken back after it"
"""Comment of the rows, by which a person would know them."""
_FILTER = "/ip/firewall/filter"
_TRUE = frozenset({"true", "yes"})


@asynccontextmanager
async def temporarily(session: Session, rows: Sequence[Command]) -> AsyncIterator[None]:
    """Have these rows (`…/add` commands, marked by `MARK`) on the router while the context lasts.

    Raises DeviceFailed with the router as it was, or OutcomeUnknown if it does not say that the rows are gone.
    """
    await _take(session)
    added: list[Reply] = []
    try:
        added = await session.flight(rows)
        for reply in added:
            reply.checked()
        yield
    finally:
        await _close(session, rows, added)


def filter_rows(reading: Reading, chains: tuple[str, str], address: str) -> tuple[Command, ...]:
    """Rows that let ICMP to and from one host pass both chains, ahead of all others. Raises DeviceFailed."""
    words = (("action", "return"), ("comment", MARK), ("protocol", "icmp"))
    out = (("chain", chains[0]), ("dst-address", address), ("place-before", _first(reading, chains[0])))
    back = (("chain", chains[1]), ("src-address", address), ("place-before", _first(reading, chains[1])))
    return (
        Command(f"{_FILTER}/add", (*out, *words)),
        Command(f"{_FILTER}/add", (*back, *words, ("connection-state", "established"))),
    )


async def _take(session: Session) -> None:
    take, state = await session.flight([Command("/safe-mode/take"), Command("/safe-mode/print")])
    row = state.rows[0] if state.trap is None and state.rows else {}
    if take.trap is not None or row.get("current") not in _TRUE:
        words = take.trap.message if take.trap is not None else "somebody else holds it"
        raise DeviceFailed(
            f"safe mode could not be taken, so nothing was changed for the proof: {words}",
            hint="it needs RouterOS 7.18 or later, and nobody else may hold it",
        )


def _first(reading: Reading, chain: str) -> str:
    rows = reading.chain(chain)
    if not rows or ".id" not in rows[0]:
        raise DeviceFailed(f"the router has no chain {chain}: provision the site first")
    return rows[0][".id"]


def _menu(command: Command) -> str:
    return command.path.removesuffix("/add")


async def _close(session: Session, rows: Sequence[Command], added: Sequence[Reply]) -> None:
    """Remove the rows, see that none is left, and only then let safe mode go; otherwise everything is unrolled."""
    there = zip(rows, added, strict=False)
    removals = [Command(f"{_menu(row)}/remove", ((".id", one.ret),)) for row, one in there if one.ret is not None]
    await session.flight(removals)
    if await _gone(session, rows):
        await session.flight([Command("/safe-mode/release")])
        return
    await session.flight([Command("/safe-mode/unroll")])
    if not await _gone(session, rows):
        raise OutcomeUnknown(
            "the router does not say that the rows of the proof are gone",
            hint=f"remove the rows that say `{MARK}`; or run the site, which removes them, too: `provision site=…`",
        )


async def _gone(session: Session, rows: Sequence[Command]) -> bool:
    menus = dict.fromkeys(_menu(row) for row in rows)
    asked = [Command(f"{menu}/print", ((".proplist", ".id"),), (f"?comment={MARK}",)) for menu in menus]
    return all(reply.trap is None and not reply.rows for reply in await session.flight(asked))
