"""The interface of an emulated modem: a TCP port for a limited number of clients, or a serial port."""

from __future__ import annotations

import os
import selectors
import socket
import threading
import time
import tty
from typing import TYPE_CHECKING, Protocol, Self

from pydantic import BaseModel, ConfigDict, Field

if TYPE_CHECKING:
    from types import TracebackType


class LineSpec(BaseModel):
    """Behaviour of the interface, independent of the protocol."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    serial: bool = False
    """A pseudo-terminal (`path`) instead of a TCP port."""
    refuses: bool = False
    """Connections are refused: no process listens on the port."""
    is_occupied: bool = False
    """The vehicle uses the only connection: every other client is disconnected at once."""
    seats: int | None = Field(default=1, ge=1)
    """Maximum number of simultaneous clients (`listen-single`); None: unlimited (`listen-respawn`)."""
    silent: bool = False
    """Accepts connections and input, but sends nothing."""
    mute_after: int | None = Field(default=None, ge=0)
    """Number of responses after which it sends nothing more; None: unlimited."""
    noise: bytes | None = None
    """Bytes sent instead of every response, as from another device or at a wrong baud rate."""
    piecewise: bool = False
    """Output is sent byte by byte."""
    byte_s: float = Field(default=0.0, ge=0)
    """Seconds for each byte if output is sent byte by byte."""


class Talker(Protocol):
    """A protocol handler for one client."""

    def hear(self, waiting: bytes) -> tuple[list[bytes], bytes]:
        """Process input; return responses, and the bytes of an incomplete command."""
        ...

    def tell(self, now_s: float) -> tuple[bytes, float | None]:
        """Return notifications due until `now_s` (seconds of service), and the time of the next one (None: never)."""
        ...


class _LineClient:
    def __init__(self, talker: Talker, sock: socket.socket | None) -> None:
        self.talker, self.sock, self.waiting, self.message_count = talker, sock, b"", 0
        self.since: float | None = None if sock is None else time.monotonic()
        """Time of connection; on a serial port the time of the first input, as a client is not detectable earlier."""


class ModemLine:
    """Emulated interface that runs in a thread during the context; address: `host` and `port`, or `path`."""

    def __init__(self, spec: LineSpec) -> None:
        self._line = spec
        self.host = "127.0.0.1"
        self.port = 0
        self.path = ""
        self.met = 0
        """Number of connections, including clients that were disconnected at once."""
        self._clients: dict[int, _LineClient] = {}
        self._thread = threading.Thread(target=self._run, name=f"twin: {type(self).__name__}", daemon=True)

    def talker(self) -> Talker:
        """Return a protocol handler for a new client."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        self._selector = selectors.DefaultSelector()
        self._stop, self._stopper = os.pipe()
        self._selector.register(self._stop, selectors.EVENT_READ)
        if self._line.serial:
            self._open_serial()
        else:
            self._open_tcp()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._stopper)
        self._thread.join()
        for handle in list(self._clients):
            self._hang_up(handle)
        self._selector.close()
        os.close(self._stop)
        if not self._line.serial:
            self._listener.close()

    def _open_serial(self) -> None:
        ours, theirs = os.openpty()
        tty.setraw(theirs)
        self.path = os.ttyname(theirs)
        # Our own hold on the far end would look like somebody who has the port; the near end survives without it.
        os.close(theirs)
        os.set_blocking(ours, False)
        self._clients[ours] = _LineClient(self.talker(), None)
        self._selector.register(ours, selectors.EVENT_READ)

    def _open_tcp(self) -> None:
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._listener.bind((self.host, 0))
        self.port = self._listener.getsockname()[1]
        if not self._line.refuses:
            # A port that is bound and does not listen refuses, and nobody else gets it meanwhile.
            self._listener.listen()
            self._listener.setblocking(False)
            self._selector.register(self._listener, selectors.EVENT_READ)

    def _run(self) -> None:
        pause: float | None = None
        while True:
            ready = {key.fd for key, _ in self._selector.select(pause)}
            if self._stop in ready:
                return
            # Who leaves makes room for who comes at the same moment.
            for handle in [client for client in self._clients if client in ready]:
                self._read(handle)
            if not self._line.serial and self._listener.fileno() in ready:
                self._accept()
            pause = self._tell()

    def _accept(self) -> None:
        try:
            sock, _ = self._listener.accept()
        except OSError:
            return
        self.met += 1
        if self._line.is_occupied or (self._line.seats is not None and len(self._clients) >= self._line.seats):
            sock.close()
            return
        # A client that does not read is disconnected: an emulator waits for nobody.
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._clients[sock.fileno()] = _LineClient(self.talker(), sock)
        self._selector.register(sock.fileno(), selectors.EVENT_READ)

    def _read(self, handle: int) -> None:
        """Read all available input, and detect disconnected clients."""
        while handle in self._clients:
            try:
                data = os.read(handle, 4096)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                self._drop_client(handle)
                return
            self._handle_data(handle, data)

    def _handle_data(self, handle: int, data: bytes) -> None:
        client = self._clients[handle]
        client.since = client.since or time.monotonic()
        answers, client.waiting = client.talker.hear(client.waiting + data)
        for answer in answers:
            client.message_count += 1
            mute = self._line.mute_after is not None and client.message_count > self._line.mute_after
            if not self._line.silent and not mute and handle in self._clients:
                self._write(handle, answer if self._line.noise is None else self._line.noise)

    def _drop_client(self, handle: int) -> None:
        if self._clients[handle].sock is not None:
            self._hang_up(handle)
            return
        # The far end of a serial port is closed: that is reported at once and for ever, so look again in a moment.
        self._clients[handle].waiting, self._clients[handle].since = b"", None
        time.sleep(0.01)

    def _tell(self) -> float | None:
        """Send due notifications to all clients; return the time until the next one."""
        pauses = []
        for handle, client in list(self._clients.items()):
            if client.since is None:
                continue
            now_s = time.monotonic() - client.since
            data, then_s = client.talker.tell(now_s)
            if data and not self._line.silent:
                self._write(handle, data)
            if then_s is not None:
                pauses.append(max(0.0, then_s - now_s))
        return min(pauses, default=None)

    def _write(self, handle: int, data: bytes) -> None:
        step = 1 if self._line.piecewise else len(data)
        try:
            while data:
                data = data[os.write(handle, data[:step]) :]
                if self._line.piecewise and self._line.byte_s:
                    time.sleep(self._line.byte_s)
        except OSError:
            self._drop_client(handle)

    def _hang_up(self, handle: int) -> None:
        client = self._clients.pop(handle, None)
        if client is None:
            return
        self._selector.unregister(handle)
        if client.sock is not None:
            client.sock.close()
        else:
            os.close(handle)
