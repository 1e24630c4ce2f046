"""A 4G unit that does not end what it begins: each is over in bounded time, with words about the unit."""

import socket
import ssl
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from impostor import served

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.links.lte.rutos_client import RutosEndpoint, RutosError, RutosUnreachable
from atlantis_netcfg.links.lte.rutos_read import read

HEAD = b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\n"
NEVER = threading.Event()


def slowly(tls: socket.socket, data: bytes) -> None:
    """A byte each twentieth of a second, again and again."""
    while True:
        for byte in data:
            tls.sendall(bytes([byte]))
            NEVER.wait(0.05)


def whole(body: bytes) -> bytes:
    return HEAD + b"Content-Length: %d\r\n\r\n" % len(body) + body


def goes_on(tls: ssl.SSLSocket) -> None:
    while True:
        tls.sendall(b"HTTP/1.1 100 Continue\r\n\r\n" * 100)


def head_slowly(tls: ssl.SSLSocket) -> None:
    tls.sendall(HEAD)
    slowly(tls, b"X-A: b\r\n")


def body_slowly(tls: ssl.SSLSocket) -> None:
    tls.sendall(HEAD + b"Content-Length: 100000\r\n\r\n")
    slowly(tls, b" ")


@pytest.mark.parametrize("answer", [goes_on, head_slowly, body_slowly])
def test_endless_reply_is_abandoned(tmp_path: Path, answer: Callable[[ssl.SSLSocket], None]) -> None:
    def serve(tls: ssl.SSLSocket) -> None:
        tls.recv(65536)
        answer(tls)

    with served(tmp_path, serve) as unit:
        at = RutosEndpoint("127.0.0.1", unit.port, "reader", Secret("x"), unit.fingerprint, timeout_s=0.5)
        with pytest.raises(RutosUnreachable, match="the 4G unit did not complete its response within 1 s"):
            read(at)


def test_connection_closed_without_reply_is_not_retried(tmp_path: Path) -> None:
    def hangs_up(tls: ssl.SSLSocket) -> None:
        tls.recv(65536)

    with served(tmp_path, hangs_up) as unit:
        at = RutosEndpoint("127.0.0.1", unit.port, "reader", Secret("x"), unit.fingerprint, timeout_s=5)
        with pytest.raises(RutosUnreachable):
            read(at)
        assert unit.handshakes == 1


def test_endless_handshake_is_abandoned() -> None:
    with raw(lambda line: slowly(line, b"\x16\x03\x03\x40\x00" + bytes(10_000))) as port:
        at = RutosEndpoint("127.0.0.1", port, "reader", Secret("x"), "00" * 32, timeout_s=0.5)
        with pytest.raises(RutosUnreachable, match="does not respond"):
            read(at)


@contextmanager
def raw(serve: Callable[[socket.socket], None]) -> Iterator[int]:
    """Without TLS."""

    def meet() -> None:
        with suppress(OSError):
            line, _ = server.accept()
            with line:
                serve(line)

    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=meet, daemon=True)
        thread.start()
        yield server.getsockname()[1]
        server.close()
        thread.join()


@pytest.mark.parametrize(
    "body",
    [
        b"[" * 100_000,
        b'{"a":' * 100_000,
        b"9" * 10_000,
        b'{"error": "no", "result": {}}',
        b'{"data": [], "success": 1}',
    ],
    ids=["deep", "deeper", "long", "error", "shape"],
)
def test_reply_not_from_rutos_is_reported(tmp_path: Path, body: bytes) -> None:
    """Also on older firmware, which has the other interface."""

    def serve(tls: ssl.SSLSocket) -> None:
        while asked := tls.recv(65536):
            tls.sendall(b"HTTP/1.1 404 No\r\nContent-Length: 0\r\n\r\n" if b"/api/" in asked and old else whole(body))

    for old in (False, True):  # noqa: B007 - `serve` reads it
        with served(tmp_path, serve) as unit:
            at = RutosEndpoint("127.0.0.1", unit.port, "reader", Secret("x"), unit.fingerprint, timeout_s=5)
            with pytest.raises(RutosError, match=r"is not one of (RutOS|ubus)"):
                read(at)


def test_certificate_is_checked_again_on_reconnect(tmp_path: Path) -> None:
    """Whoever answers the second connection has to show the certificate as well."""
    told: list[bytes] = []

    def first(tls: ssl.SSLSocket) -> None:
        asked = b""
        while not asked.endswith(b"}"):
            asked += tls.recv(65536)
        body = b'{"success": true, "data": {"token": "t"}}'
        tls.sendall(HEAD + b"Connection: close\r\nContent-Length: %d\r\n\r\n" % len(body) + body)

    def second(tls: ssl.SSLSocket) -> None:
        told.append(tls.recv(65536))

    (tmp_path / "other").mkdir()
    with served(tmp_path / "other", second) as other, served(tmp_path, first) as unit:
        at = RutosEndpoint("127.0.0.1", unit.port, "reader", Secret("x"), unit.fingerprint, timeout_s=5)
        met: list[int] = []
        real = socket.create_connection

        def somebody_else(address: tuple[str, int], timeout: float | None = None) -> socket.socket:
            met.append(address[1])
            return real(address if len(met) == 1 else ("127.0.0.1", other.port), timeout)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(socket, "create_connection", somebody_else)
            with pytest.raises(Exception, match="the certificate is not the one of this unit"):
                read(at)
    assert len(met) == 2
    assert told in ([], [b""])
