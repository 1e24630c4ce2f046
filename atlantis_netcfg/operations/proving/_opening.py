"""The router's filter, opened for one host for a moment, so that the terminal alone decides.

Only under safe mode: if this computer or its link dies meanwhile, the router closes the filter by itself (after about
2 s of a session that was closed, after about 9 minutes of one that went silent: Manual, Configuration Management).
"""

from __future__ import annotations

from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

from atlantis_netcfg.errors import DeviceFailed, OutcomeUnknown
from atlantis_netcfg.routeros.api import Command

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Sequence

    from atlantis_netcfg.operations.proving._reading import Reading
    from atlantis_netcfg.routeros.api import Session

__all__ = ["MARK", "opened"]

MARK = "atlantis: open for a proof"
"""Comment of the two rows, by which a person would know them."""
_FILTER = "/ip/firewall/filter"
_TRUE = frozenset({"true", "yes"})
_OURS = Command(f"{_FILTER}/print", ((".proplist", ".id"),), (f"?comment={MARK}",))


@asynccontextmanager
async def opened(session: Session, reading: Reading, chains: tuple[str, str], address: str) -> AsyncIterator[None]:
    """Let ICMP to and from one host pass both chains while the context lasts.

    Raises DeviceFailed with the router as it was, or OutcomeUnknown if it does not say that the rows are gone.
    """
    out, back = (_first(reading, chain) for chain in chains)
    taken = await session.flight([Command("/safe-mode/take"), Command("/safe-mode/print")])
    state = taken[1].rows[0] if taken[1].trap is None and taken[1].rows else {}
    if taken[0].trap is not None or state.get("current") not in _TRUE:
        words = taken[0].trap.message if taken[0].trap is not None else "somebody else holds it"
        raise DeviceFailed(
            f"safe mode could not be taken, so the filter was not opened: {words}",
            hint="it needs RouterOS 7.18 or later, and nobody else may hold it",
        )
    try:
        for reply in await session.flight(_rows(chains, (out, back), address)):
            reply.checked()
        yield
    finally:
        await _close(session)


def _first(reading: Reading, chain: str) -> str:
    rows = reading.chain(chain)
    if not rows or ".id" not in rows[0]:
        raise DeviceFailed(f"the router has no chain {chain}: provision the site first")
    return rows[0][".id"]


def _rows(chains: tuple[str, str], before: tuple[str, str], address: str) -> Sequence[Command]:
    words = (("action", "return"), ("comment", MARK), ("protocol", "icmp"))
    out = (("chain", chains[0]), ("dst-address", address), ("place-before", before[0]))
    back = (("chain", chains[1]), ("src-address", address), ("place-before", before[1]))
    return (
        Command(f"{_FILTER}/add", (*out, *words)),
        Command(f"{_FILTER}/add", (*back, *words, ("connection-state", "established"))),
    )


async def _close(session: Session) -> None:
    """Unroll, and see that nothing is left."""
    unrolled, left = await session.flight([Command("/safe-mode/unroll")]), await session.command(_OURS)
    if unrolled[0].trap is not None or left.trap is not None or left.rows:
        raise OutcomeUnknown(
            "the router does not say that its filter is closed again",
            hint="close the session's safe mode, or remove the rows that say "
            f"`{MARK}`; the next `provision site=…` removes them too",
        )
