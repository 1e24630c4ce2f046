"""A slow link with outages for one OpenVPN client: its UDP packets arrive late, one after the other, or not at all.

352 kbit/s up and 704 down, 350 ms each way, unless it is given other shapes; what would have to wait for longer than a
second is lost, as is whatever is under way when the link is cut. Headers of UDP and IP are counted.
"""

import ctypes
import heapq
import os
import random
import selectors
import socket
import threading
import time
from contextlib import suppress
from pathlib import Path

from atlantis_netcfg.emulator.udp_link import HEADERS, LinkModel, LinkShape

DELAY_S = 0.35
UP_BPS, DOWN_BPS = 352_000, 704_000
_QUEUE_S = 1.0
_CLONE_NEWNET = 0x40000000
SATELLITE = tuple(LinkShape(rate, DELAY_S, queue_bytes=int(rate / 8 * _QUEUE_S)) for rate in (UP_BPS, DOWN_BPS))
_LIBC = ctypes.CDLL(None, use_errno=True)


def open_in(namespace: str, *kind: int) -> socket.socket:
    """A socket that lives in a namespace, whoever uses it."""
    made: list[socket.socket] = []
    with Path("/run/netns", namespace).open("rb") as door:

        def enter() -> None:
            if _LIBC.setns(door.fileno(), _CLONE_NEWNET) == 0:
                made.append(socket.socket(*kind))

        thread = threading.Thread(target=enter)
        thread.start()
        thread.join()
    assert made, f"no socket in {namespace}"
    return made[0]


class Link:
    """Listens on a port of the namespace, and leads what comes to the server and back."""

    def __init__(
        self, namespace: str, server: tuple[str, int], shapes: tuple[LinkShape, ...] = SATELLITE, seed: int = 1
    ) -> None:
        self._client, self._server = (open_in(namespace, socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        self._client.bind(("0.0.0.0", 0))  # noqa: S104 - own namespace
        self._server.connect(server)
        self.port: int = self._client.getsockname()[1]
        self.carried = 0
        """Packets that have arrived, of both directions."""
        self._up = threading.Event()
        self._up.set()
        self._from: tuple[str, int] | None = None
        up, down = shapes
        self.up, self.down = LinkModel(up, random.Random(seed)), LinkModel(down, random.Random(seed + 1))  # noqa: S311
        self._begin = time.monotonic()
        self._air: list[tuple[float, int, LinkModel, bytes]] = []
        self._taken = 0
        self._wake, self._waker = os.pipe()
        self._thread = threading.Thread(target=self._run, name="link", daemon=True)
        self._thread.start()

    def cut(self) -> None:
        self._up.clear()

    def mend(self) -> None:
        self._up.set()

    def close(self) -> None:
        os.write(self._waker, b"x")
        self._thread.join()
        for one in (self._client, self._server):
            one.close()
        for descriptor in (self._wake, self._waker):
            os.close(descriptor)

    def _run(self) -> None:
        with selectors.DefaultSelector() as ready:
            for source, way in ((self._client, self.up), (self._server, self.down)):
                ready.register(source, selectors.EVENT_READ, way)
            ready.register(self._wake, selectors.EVENT_READ)
            while True:
                wait = max(0.0, self._air[0][0] - time.monotonic()) if self._air else None
                for key, _ in ready.select(wait):
                    if key.fileobj == self._wake:
                        return
                    self._take(key.data)
                self._give()

    def _take(self, way: LinkModel) -> None:
        try:
            if way is self.up:
                data, self._from = self._client.recvfrom(65536)
            else:
                data = self._server.recv(65536)
        except ConnectionError:  # nobody listens there yet
            return
        if not self._up.is_set():
            return
        for arrival in way.offer(len(data) + HEADERS, time.monotonic() - self._begin):
            self._taken += 1
            heapq.heappush(self._air, (self._begin + arrival, self._taken, way, data))

    def _give(self) -> None:
        while self._air and self._air[0][0] <= time.monotonic():
            _, _, way, data = heapq.heappop(self._air)
            if not self._up.is_set():
                continue
            self.carried += 1
            if way is self.up:
                with suppress(ConnectionError):  # of an earlier packet: nobody listens there any more
                    self._server.send(data)
            elif self._from is not None:
                self._client.sendto(data, self._from)
