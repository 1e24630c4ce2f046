"""The way to one device that is only read: its endpoint, and what the reading has cost."""

from __future__ import annotations

from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.routeros.api import Command, Session, Traffic

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from atlantis_netcfg.bearers.query import Query
    from atlantis_netcfg.routeros._types import Row
    from atlantis_netcfg.routeros.api import Endpoint, Reply

__all__ = ["Door", "command", "rows"]


@dataclass(slots=True)
class Door:
    """A RouterOS device by its name in the inventory."""

    name: str
    endpoint: Endpoint
    spent: list[Traffic] = field(default_factory=list)

    @asynccontextmanager
    async def opened(self) -> AsyncIterator[Session]:
        """A session that is closed at the end. Raises what `Session.open` raises, all of it a DeviceFailed."""
        session = await Session.open(replace(self.endpoint, opening=self.spent.append))
        try:
            yield session
        finally:
            await session.close(wait=False)

    @property
    def connections(self) -> int:
        """How many were made, also those whose session failed before its login was over."""
        return Traffic.total(self.spent).connections

    @property
    def round_trips(self) -> int:
        """Turns on the link, handshakes and logins included."""
        return Traffic.total(self.spent).round_trips

    @property
    def bytes(self) -> int:
        """Sent and received, handshakes and TLS included."""
        return Traffic.total(self.spent).bytes


def command(query: Query) -> Command:
    """A reader's question as a sentence of the API."""
    return Command(query.path, query.words)


def rows(reply: Reply) -> tuple[Row, ...] | None:
    """What was answered; None if the device refused the question, as it does for a menu that it has not got."""
    return None if reply.trap is not None else reply.rows
