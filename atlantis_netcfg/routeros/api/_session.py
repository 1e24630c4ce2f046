"""One session with one device, from the TLS handshake to the close."""

from __future__ import annotations

import asyncio
import os
import ssl
from typing import TYPE_CHECKING, Final, Self

from atlantis_netcfg.routeros.api._errors import Unreachable
from atlantis_netcfg.routeros.api._login import log_in
from atlantis_netcfg.routeros.api._tls import check_pin, client_context, fingerprint_of
from atlantis_netcfg.routeros.api._values import Traffic
from atlantis_netcfg.routeros.api._wire import Wire

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import TracebackType

    from atlantis_netcfg.routeros.api._values import Command, Endpoint, Reply

__all__ = ["WINDOW", "Session"]

WINDOW: Final = 24
"""Commands in flight at once. A 7.22.1 CHR hung at 25 and more `/console/inspect` on one connection
(https://github.com/tikoci/restraml, docs/mikrotik-bug-native-api-inspect.md), a 7.23.2 CHR answered more than a hundred
short commands at once (https://github.com/danikf/tik4net, Docs/findings-router-throughput-ceiling.md); the manual names
no limit. Not tried on hardware. A site's router is read in two windows."""

_CLOSE_S: Final = 3.0


class Session:
    """A logged-in session; use `Session.open`, then `async with` or `close`."""

    def __init__(self, endpoint: Endpoint, wire: Wire, certificate: str) -> None:
        self.endpoint = endpoint
        self.certificate = certificate
        self.traffic = wire.traffic
        self._wire = wire
        self._turn = asyncio.Lock()

    @classmethod
    async def open(cls, endpoint: Endpoint) -> Self:
        """Connect, check the certificate against the pin, then log in: one round trip after the TLS handshake.

        Raises Unreachable, CertificateUnknown, CertificateChanged, LoginRefused, SessionLost, ProtocolError.
        """
        wire = await _connect(endpoint)
        try:
            seen = fingerprint_of(endpoint, wire.transport)
            check_pin(endpoint, seen)
            await log_in(wire, endpoint)
        except BaseException:
            wire.abort()
            await wire.closed.wait()
            raise
        return cls(endpoint, wire, seen)

    async def command(self, command: Command, *, silence_s: float | None = None) -> Reply:
        """Send one command and wait for its answer: a flight of one."""
        (reply,) = await self.flight([command], silence_s=silence_s)
        return reply

    async def flight(self, commands: Sequence[Command], *, silence_s: float | None = None) -> list[Reply]:
        """Send commands in batches of WINDOW, each batch in one write and one round trip; replies stand in their order.

        In which order the device executes the commands of a batch is not documented. A refused command does not stop
        the others: see `Reply.checked`. `silence_s` replaces the endpoint's `reply_timeout_s` for commands that work
        silently. Raises SessionLost or ProtocolError; the session is then over.
        """
        patience_s = self.endpoint.reply_timeout_s if silence_s is None else silence_s
        replies: list[Reply] = []
        async with self._turn:
            for start in range(0, len(commands), WINDOW):
                replies += await self._wire.exchange(commands[start : start + WINDOW], patience_s)
        return replies

    async def close(self) -> None:
        """Close the connection; the device undoes safe mode if this session holds it. Never raises, may be repeated."""
        self._wire.close()
        try:
            async with asyncio.timeout(_CLOSE_S):
                await self._wire.closed.wait()
        except TimeoutError:
            self._wire.abort()
            await self._wire.closed.wait()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()


async def _connect(endpoint: Endpoint) -> Wire:
    loop = asyncio.get_running_loop()
    try:
        async with asyncio.timeout(endpoint.connect_timeout_s):
            _, wire = await loop.create_connection(
                lambda: Wire(str(endpoint), Traffic()),
                endpoint.host,
                endpoint.port,
                ssl=client_context(),
                server_hostname=endpoint.host,
                ssl_handshake_timeout=endpoint.connect_timeout_s,
                ssl_shutdown_timeout=_CLOSE_S,
            )
    except TimeoutError:
        raise Unreachable(
            f"{endpoint} did not answer within {endpoint.connect_timeout_s:g} s",
            hint="is it powered, and does this laptop have an address in its management network?",
        ) from None
    except (ssl.SSLError, ConnectionResetError, ConnectionAbortedError) as error:
        raise Unreachable(
            f"{endpoint} answered, but not with TLS and a certificate ({_why(error)})",
            hint="api-ssl needs a certificate:  /ip service set api-ssl certificate=NAME disabled=no",
        ) from None
    except (OSError, UnicodeError) as error:
        raise Unreachable(
            f"{endpoint} cannot be reached: {_why(error)}",
            hint="check cable and address; on the device:  /ip service print where name=api-ssl",
        ) from None
    return wire


def _why(error: Exception) -> str:
    """Say what the system said; asyncio replaces its words by the address that we name already."""
    if isinstance(error, ssl.SSLError):
        return error.reason or "the handshake failed"
    if isinstance(error, OSError) and error.errno is not None and error.errno > 0:
        return os.strerror(error.errno)
    return getattr(error, "strerror", None) or str(error) or "the connection was closed"
