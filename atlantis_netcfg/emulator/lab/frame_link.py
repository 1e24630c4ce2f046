"""Links between network namespaces that carry Ethernet frames with delay, rate, loss and gaps.

Each end is a TAP device: Linux hands it complete frames, with checksums and at most one MTU long, which a veth does
not. One thread carries the frames of all links.
"""

from __future__ import annotations

import fcntl
import heapq
import os
import random
import selectors
import struct
import threading
import time
from contextlib import closing, suppress
from functools import partial
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.emulator.lab import hosts
from atlantis_netcfg.emulator.udp_link import LinkModel

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.emulator.udp_link import LinkShape

ETHERNET: Final = 14
"""Bytes of the Ethernet header; sizes on a link are those of IP packets, without it."""
TUN, TAP = 0x1001, 0x1002
"""Kinds of devices, for IP packets and for frames, without a header of their own (linux/if_tun.h)."""
_TUNSETIFF: Final = 0x400454CA
_LONGEST: Final = 65_536
_BURST: Final = 64
"""Frames read from one end before the others have their turn."""


class FrameLink:
    """One link, made by `FrameRelay.add`; `up` and `down` count what was sent from its first and its second end."""

    def __init__(self, ends: tuple[int, int], shapes: tuple[LinkShape, LinkShape], seed: int) -> None:
        self.ends = ends
        self.is_up = True
        """False: every frame is lost, and neither end notices."""
        self.watch: Callable[[bytes], object] | None = None
        """Called with each frame that is sent from the first end."""
        self.up, self.down = (LinkModel(shape, random.Random(seed + place)) for place, shape in enumerate(shapes))  # noqa: S311 - an emulation

    def model(self, end: int) -> LinkModel:
        """Return the direction of what is sent from an end."""
        return self.up if end == self.ends[0] else self.down


class FrameRelay:
    """Carries the frames of all links until it is closed."""

    def __init__(self) -> None:
        self._links: dict[int, FrameLink] = {}
        self._air: list[tuple[float, int, int, bytes]] = []
        self._count = 0
        self._begin = time.monotonic()
        self._selector = selectors.DefaultSelector()
        self._wake, self._waker = os.pipe()
        self._selector.register(self._wake, selectors.EVENT_READ)
        self._thread = threading.Thread(target=self._run, name="frames", daemon=True)
        self._thread.start()

    def add(self, first: tuple[str, str], second: tuple[str, str], shapes: tuple[LinkShape, LinkShape]) -> FrameLink:
        """Make a link between two new TAP devices, each given as namespace and name; they are not up yet.

        `shapes`: from the first end to the second, and back. Raises MachineError.
        """
        near, far = (_open_tap(namespace, name) for namespace, name in (first, second))
        link = FrameLink((near, far), shapes, len(self._links))
        self._links |= {near: link, far: link}
        for end in link.ends:
            self._selector.register(end, selectors.EVENT_READ)
        os.write(self._waker, b"\0")
        return link

    def close(self) -> None:
        """Stop carrying; the devices disappear."""
        os.write(self._waker, b"\1")
        self._thread.join()
        self._selector.close()
        for descriptor in (*self._links, self._wake, self._waker):
            os.close(descriptor)
        self._links = {}

    def _run(self) -> None:
        while True:
            now = time.monotonic() - self._begin
            while self._air and self._air[0][0] <= now:
                _, _, end, frame = heapq.heappop(self._air)
                with suppress(OSError):  # its device is down
                    os.write(end, frame)
            wait = max(0.0, self._air[0][0] - now) if self._air else None
            for key, _ in self._selector.select(wait):
                if key.fd != self._wake:
                    self._take(key.fd)
                elif os.read(self._wake, 1) == b"\1":
                    return

    def _take(self, end: int) -> None:
        """Read what is sent from an end, and note when it arrives."""
        link = self._links[end]
        other = next(item for item in link.ends if item != end)
        for _ in range(_BURST):
            try:
                frame = os.read(end, _LONGEST)
            except OSError:  # nothing is left, or the device is down
                return
            if link.watch is not None and end == link.ends[0]:
                link.watch(frame)
            if link.is_up:
                for arrival in link.model(end).offer(len(frame) - ETHERNET, time.monotonic() - self._begin):
                    self._count += 1
                    heapq.heappush(self._air, (arrival, self._count, other, frame))


def _open_tap(namespace: str, name: str) -> int:
    with closing(hosts.NamespaceSockets(namespace)) as inside:
        try:
            return inside.call(partial(open_device, TAP), name)
        except OSError as error:
            raise hosts.MachineError(f"/dev/net/tun: {error.strerror}") from error


def open_device(kind: int, name: str) -> int:
    """Return the program's end of a TUN or TAP device of this thread's namespace. Raises OSError."""
    descriptor = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(descriptor, _TUNSETIFF, struct.pack("16sH", name.encode(), kind))
    return descriptor
