"""One session with one device, from the TLS handshake to the close.

Both login procedures of the manual are supported (API, "Initial login"): one round trip since RouterOS 6.43, two
before.
"""

from __future__ import annotations

import asyncio
import binascii
import hashlib
import os
import ssl
from typing import TYPE_CHECKING, Final, Self

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.routeros.api import _tls, _values
from atlantis_netcfg.routeros.api._wire import Wire

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import TracebackType


async def log_in(wire: Wire, endpoint: _values.Endpoint) -> None:
    """Log in over TLS after the certificate check. Raises LoginError with the device's message.

    A device older than 6.43 replies to name and password with a challenge. That it has seen the password is acceptable:
    it is the pinned device, and the connection is encrypted.
    """
    password = endpoint.password.reveal()
    reply = await _send_login(wire, endpoint, ("password", password))
    if reply.ret is not None:
        await _send_login(wire, endpoint, ("response", _response(reply.ret, password, endpoint)))


async def _send_login(wire: Wire, endpoint: _values.Endpoint, proof: tuple[str, str]) -> _values.Reply:
    command = _values.Command("/login", (("name", endpoint.user), proof))
    patience_s = min(endpoint.connect_timeout_s, endpoint.reply_timeout_s)
    try:
        (reply,) = await wire.exchange([command], patience_s, patience_s)
    except _values.SessionLost as lost:
        raise type(lost)(msg(f"{arg(lost)} (during the login of `{arg(endpoint.user)}`)"), in_flight=False) from None
    if reply.trap is not None:
        raise _values.LoginError(
            f"{arg(endpoint)} refused the login of `{arg(endpoint.user)}`: {arg(reply.trap.message)}",
            hint="check the name and the vaulted password of this device in the inventory",
        )
    return reply


def _response(challenge: str, password: str, endpoint: _values.Endpoint) -> str:
    try:
        salt = binascii.unhexlify(challenge)
    except ValueError:
        raise _values.ProtocolError(
            f"{arg(endpoint)} sent a login challenge that is no number", in_flight=False
        ) from None
    secret = password.encode("utf-8", "surrogateescape")
    return "00" + hashlib.md5(b"\x00" + secret + salt, usedforsecurity=False).hexdigest()


WINDOW: Final = 24
"""Commands in flight at once, unless all of them read (`print`): `Endpoint.window` applies to those.

A 7.22.1 CHR hung at 25 and more `/console/inspect` on one connection
(https://github.com/tikoci/restraml, docs/mikrotik-bug-native-api-inspect.md). A 7.23.2 CHR answered more than a
hundred short commands at once (https://github.com/danikf/tik4net, Docs/findings-router-throughput-ceiling.md).
The manual gives no limit. Not tested on hardware: a session that becomes silent with the larger window is
repeated with this one.

Assumption: api-flight-24
Assumption: api-flight-100
"""

_CLOSE_S: Final = 3.0


class Session:
    """A logged-in session; use `Session.open`, then `async with` or `close`."""

    def __init__(self, endpoint: _values.Endpoint, wire: Wire, certificate: str) -> None:
        self.endpoint = endpoint
        self.certificate = certificate
        self.traffic = wire.traffic
        self._wire = wire
        self._turn = asyncio.Lock()
        self._window = endpoint.window
        self._only_read = True
        """Only read commands were sent, so another session can replace this one."""

    @classmethod
    async def open(cls, endpoint: _values.Endpoint) -> Self:
        """Connect, check the certificate against the pin, then log in: one round trip after the TLS handshake.

        Raises Unreachable, CertificateUnknown, CertificateMismatch, LoginError, SessionLost, ProtocolError.
        """
        traffic = _values.Traffic()
        endpoint.opening(traffic)
        wire, fingerprint = await _logged_in(endpoint, traffic)
        return cls(endpoint, wire, fingerprint)

    @property
    def tls_version(self) -> str:
        """TLS version as named by the TLS library: `TLSv1.2`."""
        return str(self._wire.transport.get_extra_info("ssl_object").version())

    def fall_silent(self) -> None:
        """Simulate a dead link: neither end receives from the other; the connection remains until it is closed."""
        _tls.cut_off(self._wire.transport)

    async def command(self, command: _values.Command, *, silence_s: float | None = None) -> _values.Reply:
        """Send one command and wait for its reply."""
        (reply,) = await self.flight([command], silence_s=silence_s)
        return reply

    async def flight(
        self, commands: Sequence[_values.Command], *, silence_s: float | None = None
    ) -> list[_values.Reply]:
        """Send commands in batches of WINDOW (`Endpoint.window` if all only read); return replies in the same order.

        Each batch is one write and one round trip, and the device may execute it in any order. A refused command does
        not stop the others: see `Reply.check`. `silence_s` replaces the endpoint's `reply_timeout_s` for commands that
        produce no output for a long time.

        If the device stops responding in a window larger than WINDOW, and this session has only read so far, the
        session is reopened and everything is read again in batches of WINDOW. If that succeeds,
        `Endpoint.on_window_shrink` is called. A link lost at that moment looks the same; the only effect is a round
        trip more from then on.

        Raises SessionLost or ProtocolError; the session is then closed.
        """
        patience_s = self.endpoint.reply_timeout_s if silence_s is None else silence_s
        reading = all(map(_is_read, commands))
        self._only_read = self._only_read and reading
        async with self._turn:
            try:
                return await self._batches(commands, self._window if reading else WINDOW, patience_s)
            except _values.FellSilent:
                if not self._only_read or min(len(commands), self._window) <= WINDOW:
                    raise
            self._window = WINDOW
            await self._wire.closed.wait()
            self._wire, _ = await _logged_in(self.endpoint, self.traffic)
            replies = await self._batches(commands, WINDOW, patience_s)
            self.endpoint.on_window_shrink()
            return replies

    async def _batches(
        self, commands: Sequence[_values.Command], window: int, patience_s: float
    ) -> list[_values.Reply]:
        replies: list[_values.Reply] = []
        for start in range(0, len(commands), window):
            replies += await self._wire.exchange(commands[start : start + window], patience_s)
        return replies

    async def close(self, *, wait: bool = True) -> None:
        """Close the connection; the device undoes safe mode that this session holds. Never raises; idempotent.

        With `wait` the device has confirmed the end of the session; without, it learns of it half a round trip later.
        """
        self._wire.close(wait=wait)
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


async def certificate_of(endpoint: _values.Endpoint) -> str:
    """Return the SHA-256 of the device's certificate without sending any request. Raises Unreachable."""
    return hashlib.sha256(await shown_certificate(endpoint)).hexdigest()


async def shown_certificate(endpoint: _values.Endpoint) -> bytes:
    """Return the device's certificate (DER) without sending any request. Raises Unreachable."""
    wire = await _connect(endpoint, _values.Traffic())
    try:
        return _tls.certificate_bytes(endpoint, wire.transport)
    finally:
        wire.abort()
        await wire.closed.wait()


def _is_read(command: _values.Command) -> bool:
    return command.path.rpartition("/")[2] == "print"


async def _logged_in(endpoint: _values.Endpoint, traffic: _values.Traffic) -> tuple[Wire, str]:
    """Open a session; return its wire and the fingerprint of the device's certificate."""
    wire = await _connect(endpoint, traffic)
    try:
        fingerprint = _tls.fingerprint_of(endpoint, wire.transport)
        _tls.check_pin(endpoint, fingerprint)
        await log_in(wire, endpoint)
    except BaseException:
        wire.abort()
        await wire.closed.wait()
        raise
    return wire, fingerprint


async def _connect(endpoint: _values.Endpoint, traffic: _values.Traffic) -> Wire:
    wire = Wire(str(endpoint), traffic)
    try:
        async with asyncio.timeout(endpoint.connect_timeout_s):
            _, tls = await asyncio.get_running_loop().create_connection(
                lambda: _tls.TlsTransport(wire, endpoint.host, traffic), endpoint.host, endpoint.port
            )
            await _wait_for_handshake(tls)
    except TimeoutError:
        raise _values.Unreachable(
            f"{arg(endpoint)} did not answer within {arg(endpoint.connect_timeout_s):g} s",
            hint="is it powered, and does this laptop have an address in its management network?",
        ) from None
    except (ssl.SSLError, ConnectionResetError, ConnectionAbortedError) as error:
        raise _values.Unreachable(
            f"{arg(endpoint)} answered, but not with TLS and a certificate ({arg(_why(error))})",
            hint="api-ssl needs a certificate:  /ip service set api-ssl certificate=NAME disabled=no",
        ) from None
    except (OSError, UnicodeError) as error:
        raise _values.Unreachable(
            f"{arg(endpoint)} cannot be reached: {arg(_why(error))}",
            hint="check cable and address; on the device:  /ip service print where name=api-ssl",
        ) from None
    return wire


async def _wait_for_handshake(tls: _tls.TlsTransport) -> None:
    """Wait until the TLS handshake is finished. Raises ssl.SSLError, OSError."""
    try:
        await tls.established
    except BaseException:
        tls.abort()
        await tls.lost.wait()
        raise


def _why(error: Exception) -> str:
    """Return the operating system's error text; asyncio's own text would only repeat the address."""
    if isinstance(error, ssl.SSLError):
        return error.reason or "the handshake failed"
    if isinstance(error, OSError) and error.errno is not None and error.errno > 0:
        return os.strerror(error.errno)
    return getattr(error, "strerror", None) or str(error) or "the connection was closed"
