"""The way to one device that is only read: its endpoint, the pin of a first contact, and what the reading has cost."""

from __future__ import annotations

from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.routeros.api import CertificateUnknown, Command, Session, Traffic

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable

    from atlantis_netcfg.bearers.query import Query
    from atlantis_netcfg.routeros._types import Row
    from atlantis_netcfg.routeros.api import Endpoint, Reply

__all__ = ["Door", "command", "rows"]


@dataclass(slots=True)
class Door:
    """A RouterOS device by its name in the inventory."""

    name: str
    endpoint: Endpoint
    pin: Callable[[str, str], None]
    """Called with name and certificate of a device that was never met, before the login is sent."""
    spent: list[Traffic] = field(default_factory=list)

    @asynccontextmanager
    async def opened(self) -> AsyncIterator[Session]:
        """A session that is closed at the end. Raises what `Session.open` raises, all of it a DeviceFailed."""
        session = await self._open()
        try:
            yield session
        finally:
            await session.close(wait=False)

    async def _open(self) -> Session:
        try:
            return await self._logged_in()
        except CertificateUnknown as unknown:
            self.pin(self.name, unknown.fingerprint)
            self.endpoint = replace(self.endpoint, pin=unknown.fingerprint)
            return await self._logged_in()

    async def _logged_in(self) -> Session:
        return await Session.open(replace(self.endpoint, opening=self.spent.append))

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
