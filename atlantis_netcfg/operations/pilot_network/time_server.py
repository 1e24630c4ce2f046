"""A time server of the emulated internet: answers SNTP with this computer's clock (RFC 5905, section 7.3)."""

from __future__ import annotations

import socket
import struct
import threading
import time
from typing import TYPE_CHECKING, Final, Self

from atlantis_netcfg.emulator.lab import hosts

if TYPE_CHECKING:
    from types import TracebackType

_PORT: Final = 123
_SINCE_1900_S: Final = 2_208_988_800
_SERVER: Final = (4 << 3) | 4
"""No leap second, version 4, mode 4: a server."""
_REQUEST: Final = 48
"""Bytes of a request without extensions."""
_POLL_S: Final = 0.2


class SntpResponder:
    """Answers at an address of a namespace while its context lasts."""

    def __init__(self, namespace: str, address: str) -> None:
        self._inside = hosts.NamespaceSockets(namespace)
        self._socket = self._inside.socket(socket.SOCK_DGRAM)
        self._socket.bind((address, _PORT))
        self._socket.settimeout(_POLL_S)
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._serve, name=f"ntp-{address}", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._ends.set()
        self._thread.join()
        self._socket.close()
        self._inside.close()

    def _serve(self) -> None:
        while not self._ends.is_set():
            try:
                request, sender = self._socket.recvfrom(_REQUEST)
            except OSError:
                continue
            if len(request) == _REQUEST:
                self._socket.sendto(_response(request), sender)


def _response(request: bytes) -> bytes:
    now = int((time.time() + _SINCE_1900_S) * 2**32)
    origin = request[40:48]
    return struct.pack("!BBbbIIIQ8sQQ", _SERVER, 2, request[2], -20, 0, 0, 0, now, origin, now, now)
