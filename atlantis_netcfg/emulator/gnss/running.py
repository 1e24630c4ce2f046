"""Emulated receivers in threads; each lasts as long as its context."""

from __future__ import annotations

import os
import select
import socket
import threading
import time
import tty
from contextlib import suppress
from typing import TYPE_CHECKING, Protocol, Self

from atlantis_netcfg.emulator.gnss.gpsd import Client
from atlantis_netcfg.emulator.gnss.reports import Source
from atlantis_netcfg.emulator.gnss.spec import Access

if TYPE_CHECKING:
    from types import TracebackType

    from atlantis_netcfg.emulator.gnss.spec import GnssSpec

__all__ = ["RunningGpsd", "RunningNmea", "RunningNmeaPort"]

_AT_MOST = 4096


class _Running:
    """A thread, and the pipe that ends it."""

    def __init__(self, spec: GnssSpec) -> None:
        self.spec = spec
        self.heard: list[bytes] = []
        """Whatever clients have sent."""
        self.forbidden: list[str] = []
        """What of it a receiver must never be sent."""
        self._thread = threading.Thread(target=self._run, name="twin of a GNSS receiver", daemon=True)

    def __enter__(self) -> Self:
        self._stop, self._stopper = os.pipe()
        self._open()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._stopper)
        self._thread.join()
        os.close(self._stop)
        self._close()

    def _open(self) -> None:
        raise NotImplementedError

    def _close(self) -> None:
        raise NotImplementedError

    def _run(self) -> None:
        raise NotImplementedError


class _Listener(Protocol):
    """What one connection says and hears."""

    def greet(self) -> bytes: ...
    def hear(self, data: bytes) -> tuple[bytes, list[str]]: ...
    def report(self) -> bytes: ...


class _GpsdClient:
    def __init__(self, spec: GnssSpec) -> None:
        self._client, self._source = Client(spec), Source(spec)

    def greet(self) -> bytes:
        return self._client.greeting

    def hear(self, data: bytes) -> tuple[bytes, list[str]]:
        return self._client.hear(data)

    def report(self) -> bytes:
        watched = self._client.state
        if not (watched["enable"] and self._client.spec.device and self._source.speaks):
            return b""
        return self._source.next(objects=watched["json"], sentences=watched["nmea"])


class _NmeaClient:
    def __init__(self, spec: GnssSpec) -> None:
        self._source = Source(spec)

    def greet(self) -> bytes:
        del self
        return b""

    def hear(self, data: bytes) -> tuple[bytes, list[str]]:
        """Whatever is sent reaches the receiver."""
        del self
        return b"", [data.decode("ascii", "replace")]

    def report(self) -> bytes:
        return self._source.next(sentences=True) if self._source.speaks else b""


class _Server(_Running):
    """A TCP server; `host` and `port` are where it listens (or, refused, where nothing does)."""

    host = "127.0.0.1"

    def __init__(self, spec: GnssSpec, port: int = 0) -> None:
        super().__init__(spec)
        self.port = port
        self._clients: dict[socket.socket, _Listener] = {}

    def _listener(self) -> _Listener:
        raise NotImplementedError

    def _open(self) -> None:
        self._door = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._door.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._door.bind((self.host, self.port))
        self.port = self._door.getsockname()[1]
        # A port that is bound and does not listen refuses, and nobody else can get it meanwhile.
        if self.spec.access is not Access.REFUSED:
            self._door.listen()

    def _close(self) -> None:
        for client in self._clients:
            client.close()
        self._door.close()

    def _run(self) -> None:
        due = time.monotonic()
        while True:
            waiting: list[socket.socket | int] = [self._stop, *self._clients]
            if self.spec.access is not Access.REFUSED:
                waiting.append(self._door)
            ready = select.select(waiting, [], [], max(0.0, due - time.monotonic()))[0]
            if self._stop in ready:
                return
            if self._door in ready:
                self._admit()
            for client in [one for one in self._clients if one in ready]:
                self._hear(client)
            if time.monotonic() >= due:
                # Who was kept from telling tells on from now: a receiver does not make up for what it has left out.
                due = max(due + self.spec.every_s, time.monotonic() + self.spec.every_s / 2)
                for client, listener in list(self._clients.items()):
                    self._send(client, listener.report())

    def _admit(self) -> None:
        client = self._door.accept()[0]
        if self.spec.access is Access.IN_USE:
            client.close()
            return
        self._clients[client] = self._listener()
        self._send(client, self._clients[client].greet())

    def _hear(self, client: socket.socket) -> None:
        try:
            data = client.recv(_AT_MOST)
        except OSError:
            data = b""
        if not data:
            del self._clients[client]
            client.close()
            return
        self.heard.append(data)
        answer, forbidden = self._clients[client].hear(data)
        self.forbidden += forbidden
        self._send(client, answer)

    def _send(self, client: socket.socket, data: bytes) -> None:
        if self.spec.access is Access.MUTE:
            return
        size = 1 if self.spec.piecewise else len(data)
        try:
            for place in range(0, len(data), size or 1):
                client.sendall(data[place : place + size])
        except OSError:
            # It has gone; the next reading of it says so as well.
            return


class RunningGpsd(_Server):
    """gpsd with one receiver."""

    def _listener(self) -> _Listener:
        return _GpsdClient(self.spec)


class RunningNmea(_Server):
    """A server that passes a receiver's sentences on to every client."""

    def _listener(self) -> _Listener:
        return _NmeaClient(self.spec)


class RunningNmeaPort(_Running):
    """A receiver at a serial port; `path` is the port."""

    path = ""

    def _open(self) -> None:
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        self.path = os.ttyname(self._theirs)
        # Our own hold on the far end would look like somebody who has the port; the near end survives without it.
        os.close(self._theirs)
        os.set_blocking(self._ours, False)

    def _close(self) -> None:
        os.close(self._ours)

    def _run(self) -> None:
        source = Source(self.spec)
        while not select.select([self._stop], [], [], self.spec.every_s)[0]:
            if not self._opened():
                # Bytes of a receiver are lost where nobody has the port open; its mood begins anew with the next one.
                source = Source(self.spec)
                continue
            self._hear()
            if source.speaks:
                self._send(source.next(sentences=True))

    def _opened(self) -> bool:
        poll = select.poll()
        poll.register(self._ours, 0)
        return not any(event & select.POLLHUP for _, event in poll.poll(0))

    def _hear(self) -> None:
        with suppress(OSError):
            data = os.read(self._ours, _AT_MOST)
            self.heard.append(data)
            self.forbidden.append(data.decode("ascii", "replace"))

    def _send(self, data: bytes) -> None:
        """Bytes are lost as well where whoever has the port open reads too slowly."""
        size = 1 if self.spec.piecewise else len(data)
        with suppress(OSError):
            for place in range(0, len(data), size):
                os.write(self._ours, data[place : place + size])
