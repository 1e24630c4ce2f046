"""One TLS connection to a RutOS unit: the certificate is checked before anything is sent; requests are counted.

The standard library's `http.client` is used: a keep-alive connection, a certificate that can be inspected before the
first byte of a request, and no implicit redirects, proxies or retries. (httpx and requests hide the certificate
behind their pools, and verify chains, which a self-signed certificate does not have.)
"""

from __future__ import annotations

import hashlib
import http.client
import json
import socket
import ssl
import threading
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.errors import TRUST, DeviceError
from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.core.secret import Secret


class RutosUnreachable(DeviceError):
    """The unit does not respond, or the response broke off; only reads were sent."""


class CertificateUnknown(DeviceError):
    """The unit has no pinned certificate; it presented `fingerprint`, and no password was sent."""

    def __init__(self, message: str, *, fingerprint: str, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.fingerprint = fingerprint


class CertificateMismatch(DeviceError):
    """The certificate is not the pinned one; no password was sent."""


class RutosLoginError(DeviceError):
    """The unit rejected user name and password."""


class RutosError(DeviceError):
    """The unit refused a read, or its response cannot be parsed."""


class PageMissing(RutosError):
    """This firmware does not have the page: HTTP 404, 405 or 501."""


TIMEOUT_S = 180.0
"""Timeout in seconds: Certus has gaps of 70 s in practice (FFI report 20/01338); a response may wait for two."""
_LARGEST = 1_000_000
"""Maximum number of bytes in a response; a status page has a few thousand."""
_NOT_OFFERED = (404, 405, 501)


@dataclass(frozen=True, slots=True)
class RutosEndpoint:
    """Address and credentials of the unit's web interface."""

    host: str
    port: int
    user: str
    password: Secret
    pin: str | None
    """SHA-256 of the certificate in hex; None: no certificate is pinned yet."""
    timeout_s: float = TIMEOUT_S

    def __str__(self) -> str:
        return msg(f"{arg(self.host)} port {arg(self.port)}")


@dataclass(frozen=True, slots=True)
class RutosAnswer:
    """A response: HTTP status and the JSON body (None if the body is not JSON)."""

    status: int
    body: Any


class RutosWire:
    """The connection; opened by the first request, and reopened if the unit has closed it."""

    def __init__(self, endpoint: RutosEndpoint) -> None:
        self._endpoint = endpoint
        self._connection: http.client.HTTPSConnection | None = None
        self._line: socket.socket | None = None
        self.requests = 0
        self.sent = 0
        """Bytes sent in paths and bodies, without headers and TLS."""
        self.received = 0

    def close(self) -> None:
        """Close the connection."""
        self._close_line()
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def ask(self, method: str, path: str, body: Any = None, *, token: str | None = None) -> RutosAnswer:  # noqa: ANN401 - JSON
        """Send a request; raise RutosUnreachable, CertificateUnknown, CertificateMismatch or PageMissing."""
        headers = {"Accept": "application/json"} | ({"Authorization": f"Bearer {token}"} if token else {})
        data = None
        if body is not None:
            data = json.dumps(body).encode()
            headers["Content-Type"] = "application/json"
        status, text = self._exchange(method, path, data, headers)
        self.sent += len(path) + len(data or b"")
        self.received += len(text)
        if status in _NOT_OFFERED:
            raise PageMissing(
                f"{arg(self._endpoint)}: the unit's firmware does not offer {arg(path)} (HTTP {arg(status)})"
            )
        try:
            return RutosAnswer(status, json.loads(text) if text else None)
        except (ValueError, RecursionError):
            return RutosAnswer(status, None)

    def _exchange(self, method: str, path: str, data: bytes | None, headers: Mapping[str, str]) -> tuple[int, bytes]:
        """Send a request; retry once on a new connection if an old one was closed, as every request is a read."""
        fresh = self._connection is None
        try:
            return self._send_request(method, path, data, headers)
        except (http.client.RemoteDisconnected, ConnectionResetError, BrokenPipeError) as gone:
            self.close()
            if fresh:
                raise self._unreachable(gone) from gone
        except (OSError, http.client.HTTPException) as error:
            self.close()
            raise self._unreachable(error) from error
        return self._retry_request(method, path, data, headers)

    def _retry_request(
        self, method: str, path: str, data: bytes | None, headers: Mapping[str, str]
    ) -> tuple[int, bytes]:
        try:
            return self._send_request(method, path, data, headers)
        except (OSError, http.client.HTTPException) as error:
            self.close()
            raise self._unreachable(error) from error

    def _send_request(
        self, method: str, path: str, data: bytes | None, headers: Mapping[str, str]
    ) -> tuple[int, bytes]:
        with self._ended_in_time():
            if self._connection is not None and self._connection.sock is None:
                self.close()  # the unit has said that it would
            connection = self._connection or self._open()
            self.requests += 1
            connection.request(method, path, body=data, headers=dict(headers))
            response = connection.getresponse()
            text = response.read(_LARGEST + 1)
        if len(text) > _LARGEST:
            self.close()
            raise RutosError(f"{arg(self._endpoint)}: the response to {arg(path)} is larger than {arg(_LARGEST)} bytes")
        return response.status, text

    @contextmanager
    def _ended_in_time(self) -> Iterator[None]:
        """Abort a request that exceeds the total time: a socket timeout restarts with each byte received.

        So does http.client's wait for `100 Continue`.
        """
        longest_s, late = 2 * self._endpoint.timeout_s, threading.Event()

        def hang_up() -> None:
            late.set()
            if self._line is not None:
                with suppress(OSError):
                    self._line.shutdown(socket.SHUT_RDWR)

        clock = threading.Timer(longest_s, hang_up)
        clock.daemon = True
        clock.start()
        try:
            yield
        except (OSError, http.client.HTTPException):
            if not late.is_set():
                raise
        finally:
            clock.cancel()
        if late.is_set():
            self.close()
            raise RutosUnreachable(
                f"{arg(self._endpoint)}: the 4G unit did not complete its response within {arg(longest_s):g} s",
                hint="check that this is the unit in the inventory, then switch it off and on",
            )

    def _open(self) -> http.client.HTTPSConnection:
        endpoint = self._endpoint
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.check_hostname = False
        context.verify_mode = ssl.CERT_NONE  # self-signed: the pin is compared below, before a byte is sent
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        context.set_ciphers("DEFAULT:!aNULL:!eNULL")
        connection = http.client.HTTPSConnection(
            endpoint.host, endpoint.port, timeout=endpoint.timeout_s, context=context
        )
        connection.auto_open = 0  # by itself it would come back to whoever answers then, without a look
        wire = socket.create_connection((endpoint.host, endpoint.port), endpoint.timeout_s)
        try:
            self._keep_duplicate(wire)
            connection.sock = context.wrap_socket(wire, server_hostname=endpoint.host)
            self._check_certificate(connection)
        except BaseException:
            wire.close()
            connection.close()
            self._close_line()
            raise
        self._connection = connection
        return connection

    def _keep_duplicate(self, wire: socket.socket) -> None:
        """Keep a duplicate of the socket to abort with: TLS takes over the original and may block on it."""
        self._close_line()
        self._line = wire.dup()

    def _close_line(self) -> None:
        line, self._line = self._line, None
        if line is not None:
            line.close()

    def _check_certificate(self, connection: http.client.HTTPSConnection) -> None:
        der = connection.sock.getpeercert(binary_form=True) or b""
        fingerprint = hashlib.sha256(der).hexdigest()
        if self._endpoint.pin is None:
            raise CertificateUnknown(
                msg(
                    f"{arg(self._endpoint)}: unknown certificate; no password was sent; its fingerprint is "
                    f"{arg(fingerprint)}"
                ),
                fingerprint=fingerprint,
                hint=msg(f"{arg(TRUST)}; or set `fingerprint: {arg(fingerprint)}` under its `access`"),
            )
        if self._endpoint.pin != fingerprint:
            raise CertificateMismatch(
                msg(
                    f"{arg(self._endpoint)}: the certificate is not the one of this unit; pinned "
                    f"{arg(self._endpoint.pin)}, presented {arg(fingerprint)}"
                ),
                hint=msg(
                    "another device has this address, the unit was reset, or somebody intercepts the connection: "
                    f"no password was sent; only if you have reset it: {arg(TRUST)}"
                ),
            )

    def _unreachable(self, error: BaseException) -> RutosUnreachable:
        why = (isinstance(error, OSError) and error.strerror) or type(error).__name__
        return RutosUnreachable(
            f"{arg(self._endpoint)}: the 4G unit does not respond ({arg(why)})",
            hint="check that it is powered and that its own page opens in a browser at that address",
        )


def certificate_of(endpoint: RutosEndpoint) -> str:
    """Return the SHA-256 of the certificate presented, sending no request; raise RutosUnreachable."""
    wire = RutosWire(replace(endpoint, pin=None))
    try:
        wire.ask("GET", "/")
    except CertificateUnknown as unknown:
        return unknown.fingerprint
    finally:
        wire.close()
    raise AssertionError("without a pin nothing is sent")
