"""The emulated autopilot in a thread."""

from __future__ import annotations

import os
import secrets
import select
import socket
import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Self

from atlantis_netcfg.emulator.mavlink.rounds import Rounds

if TYPE_CHECKING:
    from types import TracebackType

    from atlantis_netcfg.emulator.mavlink.spec import AutopilotSpec

__all__ = ["RunningAutopilot"]

_LONGEST = 65535
_IP_RECVERR = 11
"""ip(7); the socket module has no name for it before Python 3.14."""


class RunningAutopilot:
    """Sends to `host` and `port` while the context lasts, whether anybody listens there or not.

    Port 0: one that is free when the context begins. It is not held, for whoever listens needs it. What the
    specification counts in rounds begins anew with whoever comes to listen.
    """

    host = "127.0.0.1"

    def __init__(self, spec: AutopilotSpec, port: int = 0) -> None:
        self.spec = spec
        self.port = port
        self.forbidden: list[bytes] = []
        """Datagrams that somebody has sent to it."""
        self._rounds = Rounds(spec)
        self._rest = b""
        self._thread = threading.Thread(target=self._run, name="twin of an autopilot", daemon=True)

    def __enter__(self) -> Self:
        self.port = self.port or _free_port(self.host)
        self._stop, self._stopper = os.pipe()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((self.host, 0))
        # Without it the system does not tell a socket that is not connected that nobody listens.
        self._socket.setsockopt(socket.IPPROTO_IP, _IP_RECVERR, 1)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._stopper)
        self._thread.join()
        os.close(self._stop)
        self._socket.close()

    @property
    def source(self) -> tuple[str, int]:
        """Where its datagrams come from."""
        host, port = self._socket.getsockname()
        return str(host), int(port)

    def _run(self) -> None:
        due = time.monotonic()
        ends: list[socket.socket | int] = [self._stop, self._socket]
        while True:
            ready = select.select(ends, [], [], max(0.0, due - time.monotonic()))[0]
            if self._stop in ready:
                return
            if self._socket in ready:
                self._hear()
            if time.monotonic() >= due:
                due += self.spec.every_s
                self._send(self._datagrams(self._rounds.next()))

    def _datagrams(self, frames: list[bytes]) -> list[bytes]:
        if not self.spec.split:
            return frames
        whole = self._rest + b"".join(frames)
        cut = len(whole) // 16 * 16
        self._rest = whole[cut:]
        return [whole[place : place + 16] for place in range(0, cut, 16)]

    def _hear(self) -> None:
        """Take what was sent, and what the system says of earlier datagrams: that nobody listened."""
        with suppress(BlockingIOError):
            while True:
                self._socket.recvmsg(0, _LONGEST, socket.MSG_ERRQUEUE | socket.MSG_DONTWAIT)
                self._begin_anew()
        with suppress(OSError):
            self.forbidden.append(self._socket.recv(_LONGEST, socket.MSG_DONTWAIT))

    def _send(self, datagrams: list[bytes]) -> None:
        try:
            for datagram in datagrams:
                self._socket.sendto(datagram, (self.host, self.port))
        except ConnectionRefusedError:
            self._begin_anew()

    def _begin_anew(self) -> None:
        self._rounds, self._rest = Rounds(self.spec), b""


_PORTS = range(20_000, 30_000)
"""Below those that Linux gives to whoever asks for none: nobody else comes upon one of them by accident."""
_given: set[int] = set()


def _free_port(host: str) -> int:
    """A port on which nobody listens, and that no other twin of this process has sent to."""
    while True:
        port = secrets.choice(_PORTS)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found, suppress(OSError):
            found.bind((host, port))
            if port not in _given:
                _given.add(port)
                return port
