"""TLS to a device with a self-signed certificate: trust is the pinned fingerprint, never a chain.

asyncio's own TLS is not used: it does not count bytes on the wire, and does not close without the peer's close_notify.
"""

from __future__ import annotations

import asyncio
import ctypes
import hashlib
import socket
import ssl
import struct
from contextlib import suppress
from typing import Any, cast

from atlantis_netcfg.core.errors import TRUST
from atlantis_netcfg.core.messages import arg
from atlantis_netcfg.routeros.api import _values

_PIECE = 65_536
_ATTACH_FILTER = 26
"""Linux's SO_ATTACH_FILTER (asm-generic/socket.h), which Python does not define."""


class TlsTransport(asyncio.Transport, asyncio.Protocol):
    """TLS layer: protocol of the TCP connection, transport of the data above it; counts the bytes on the wire.

    `established` is set after the handshake; awaiting it raises ssl.SSLError or OSError on failure.
    """

    def __init__(self, inner: asyncio.Protocol, host: str, traffic: _values.Traffic) -> None:
        super().__init__()
        self.established = asyncio.get_running_loop().create_future()
        self.lost = asyncio.Event()
        self._inner = inner
        self._traffic = traffic
        self._in, self._out = ssl.MemoryBIO(), ssl.MemoryBIO()
        self._tls = client_context().wrap_bio(self._in, self._out, server_hostname=host)
        self._raw: asyncio.Transport | None = None
        self._failure: Exception | None = None

    # What asyncio reports of the TCP connection.

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Start the TLS handshake; the TCP connection took one round trip."""
        self._raw = cast("asyncio.Transport", transport)
        keep_alive(transport)
        self._traffic.connect()
        self._shake_hands()

    def data_received(self, data: bytes) -> None:
        """Decrypt, or continue the handshake."""
        self._traffic.receive(len(data))
        self._in.write(data)
        if not self.established.done():
            self._shake_hands()
        if self.established.done() and self._failure is None:
            self._read()

    def eof_received(self) -> None:
        """The device has closed its side; asyncio then closes ours."""

    def connection_lost(self, exc: Exception | None) -> None:
        """Report the loss of the TCP connection to the handshake or to the inner protocol."""
        failure = self._failure or exc
        if not self.established.done():
            self.established.set_exception(failure or ConnectionResetError("the connection was closed"))
        elif not self.established.cancelled() and self.established.exception() is None:
            self._inner.connection_lost(failure)
        self.lost.set()

    # What the inner protocol does with its transport.

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Encrypt and send."""
        self._tls.write(data)
        self._flush()

    def close(self, *, wait: bool = True) -> None:
        """Send close_notify; with `wait`, close the connection only after the device's close_notify."""
        if self._raw is None or self._raw.is_closing():
            return
        has_ended = False
        with suppress(ssl.SSLError):  # the device has not said it yet
            self._tls.unwrap()
            has_ended = True
        self._flush()
        if has_ended or not wait:
            self._raw.close()

    def abort(self) -> None:
        """Drop the connection without a TLS close."""
        if self._raw is not None:
            self._raw.abort()

    def is_closing(self) -> bool:
        """Return True if the connection is closed or about to be."""
        return self._raw is None or self._raw.is_closing()

    def get_extra_info(self, name: str, default: Any = None) -> Any:  # noqa: ANN401 - asyncio's
        """Return asyncio's extra information, with the TLS object of this connection."""
        if name == "ssl_object":
            return self._tls
        return default if self._raw is None else self._raw.get_extra_info(name, default)

    # TLS.

    def _shake_hands(self) -> None:
        try:
            self._tls.do_handshake()
        except ssl.SSLWantReadError:
            self._flush()
        except ssl.SSLError as error:
            self._flush()
            self._fail(error)
        else:
            self._flush()
            self.established.set_result(None)
            self._inner.connection_made(self)

    def _read(self) -> None:
        try:
            while piece := self._tls.read(_PIECE):
                self._inner.data_received(piece)
        except ssl.SSLWantReadError:
            self._flush()
        except ssl.SSLZeroReturnError:
            self.close(wait=False)
        except ssl.SSLError as error:
            self._fail(error)
        else:
            self.close(wait=False)

    def _fail(self, error: ssl.SSLError) -> None:
        self._failure = error
        self.abort()

    def _flush(self) -> None:
        data = self._out.read()
        if data and self._raw is not None and not self._raw.is_closing():
            self._raw.write(data)
            self._traffic.send(len(data))


_COMPARE = (
    "first compare it with `fingerprint` in  /certificate print detail  on the device's own console (cable, Winbox)"
)


def client_context() -> ssl.SSLContext:
    """Create a context for TLS 1.2 or newer that accepts any certificate, but no anonymous Diffie-Hellman."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.set_ciphers("DEFAULT:!aNULL:!eNULL")
    return context


def fingerprint_of(endpoint: _values.Endpoint, transport: asyncio.BaseTransport) -> str:
    """Return the SHA-256 of the device's certificate in RouterOS's notation. Raises Unreachable."""
    return hashlib.sha256(certificate_bytes(endpoint, transport)).hexdigest()


def certificate_bytes(endpoint: _values.Endpoint, transport: asyncio.BaseTransport) -> bytes:
    """Return the device's certificate in DER. Raises Unreachable."""
    der: bytes | None = transport.get_extra_info("ssl_object").getpeercert(binary_form=True)
    if not der:
        raise _values.Unreachable(f"{arg(endpoint)} showed no certificate")
    return der


def check_pin(endpoint: _values.Endpoint, fingerprint: str) -> None:
    """Check the certificate. Raises CertificateUnknown without a pin, CertificateMismatch if the pin differs."""
    if endpoint.pin is None:
        raise _values.CertificateUnknown(
            f"{arg(endpoint)}: its certificate is unknown here, so no password was sent; it presented "
            f"{arg(fingerprint)}",
            fingerprint=fingerprint,
            hint=f"{arg(TRUST)}; or set `fingerprint: {arg(fingerprint)}` under its `access` in the inventory, but "
            f"{arg(_COMPARE)}",
        )
    pinned_fingerprint = endpoint.pin.replace(":", "").lower()
    if pinned_fingerprint != fingerprint:
        raise _values.CertificateMismatch(
            f"{arg(endpoint)}: the certificate is not the one of this device; pinned is {arg(pinned_fingerprint)}, "
            f"it showed {arg(fingerprint)}",
            pinned_fingerprint=pinned_fingerprint,
            fingerprint=fingerprint,
            hint=f"{arg(_COMPARE)}; only if they are equal and it was renewed on purpose: "
            "`provision device trust site=…` asks you to agree to it; a device that stands in for another one is met by"
            " `provision device adopt site=… device=… --replaced`",
        )


def keep_alive(transport: asyncio.BaseTransport) -> None:
    """Disable Nagle's algorithm, and detect a dead link within minutes, but not during a gap of 70 s."""
    connection = transport.get_extra_info("socket")
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for option, value in (("TCP_KEEPIDLE", 60), ("TCP_KEEPINTVL", 30), ("TCP_KEEPCNT", 6)):
        if hasattr(socket, option):
            connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)


def cut_off(transport: asyncio.BaseTransport) -> None:
    """Make the kernel drop all incoming packets of this connection, ACKs included, and send none on its own.

    Uses a packet filter on the socket (socket(7), SO_ATTACH_FILTER). Raises PermissionError: see `may_cut_off`.
    """
    connection = transport.get_extra_info("socket")
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 0)
    _drop_all(connection)


def may_cut_off() -> bool:
    """Return True if this user may filter a TCP connection; on some kernels (seen on 6.18) only root may."""
    with socket.socket() as connection:
        try:
            _drop_all(connection)
        except PermissionError:
            return False
    return True


def _drop_all(connection: socket.socket) -> None:
    # One instruction, which takes no byte of any packet.
    nothing = ctypes.create_string_buffer(struct.pack("HBBI", 0x06, 0, 0, 0))
    program = struct.pack("HP", 1, ctypes.addressof(nothing))
    connection.setsockopt(socket.SOL_SOCKET, _ATTACH_FILTER, program)
