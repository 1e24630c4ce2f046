"""The interface between a measurement and the network: a monotonic clock, and datagrams to one far end."""

from __future__ import annotations

import errno
import select
import socket
import struct
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol, Self

from atlantis_netcfg.links.qualify.budget import IPV4_HEADERS, IPV6_HEADERS

if TYPE_CHECKING:
    from types import TracebackType

_SO_TIMESTAMPNS: Final = 35
_SO_BINDTODEVICE: Final = 25
_IP_RECVTTL: Final = 12
_IP_MTU_DISCOVER: Final = 10
_IPV6_RECVHOPLIMIT: Final = 51
_IPV6_HOPLIMIT: Final = 52
_IPV6_MTU_DISCOVER: Final = 23
_NO_FRAGMENTS: Final = 3
"""IP_PMTUDISC_PROBE: set the DF bit and ignore the kernel's path MTU."""
_LONGEST: Final = 65536
_RECEIVE_BUFFER: Final = 1 << 22
"""Requested receive buffer; the kernel may grant less. An overflow would look like packet loss of the link."""
_SECOND: Final = 1_000_000_000
_UNKNOWN_TTL: Final = 255


@dataclass(frozen=True, slots=True)
class Arrival:
    """A received datagram."""

    datagram: bytes
    at_ns: int
    """Arrival time on the monotonic clock; the kernel's timestamp if there is one."""
    ttl: int = _UNKNOWN_TTL


class DatagramTransport(Protocol):
    """The network interface of a measurement; tests use a simulated network with its own clock."""

    headers: int
    """Octets of the IP and UDP headers of each datagram."""

    def now_ns(self) -> int:
        """Return the monotonic clock's time."""

    def unix_ns(self) -> int:
        """Return the time since 1970 for timestamps on the wire: the monotonic clock plus a constant."""

    def send(self, datagram: bytes) -> str:
        """Send a datagram; return an empty text, or why this computer did not send it."""

    def receive(self, until_ns: int) -> Arrival | None:
        """Wait for a datagram until the deadline; return None when it has passed."""


class UdpTransport:
    """A UDP socket; `source` binds it to an address, `interface` to a device (needs root), and so to one link."""

    def __init__(self, far_end: tuple[str, int], *, source: str | None = None, interface: str | None = None) -> None:
        family = socket.AF_INET6 if ":" in far_end[0] else socket.AF_INET
        self.headers = IPV6_HEADERS if family == socket.AF_INET6 else IPV4_HEADERS
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
        if family == socket.AF_INET6:
            self._socket.setsockopt(socket.IPPROTO_IPV6, _IPV6_RECVHOPLIMIT, 1)
            self._socket.setsockopt(socket.IPPROTO_IPV6, _IPV6_MTU_DISCOVER, _NO_FRAGMENTS)
        else:
            self._socket.setsockopt(socket.IPPROTO_IP, _IP_RECVTTL, 1)
            self._socket.setsockopt(socket.IPPROTO_IP, _IP_MTU_DISCOVER, _NO_FRAGMENTS)
        if interface is not None:
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_BINDTODEVICE, interface.encode() + b"\0")
        if source is not None:
            self._socket.bind((source, 0))
        self._socket.setblocking(False)
        self._socket.connect(far_end)
        self._to_unix = time.time_ns() - time.monotonic_ns()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._socket.close()

    @property
    def source(self) -> tuple[str, int]:
        """The source address and port of this socket."""
        address, port = self._socket.getsockname()[:2]
        return address, port

    def now_ns(self) -> int:
        """Return `time.monotonic_ns()`."""
        return time.monotonic_ns()

    def unix_ns(self) -> int:
        """Return the time since 1970 by the clock at the socket's creation: later clock steps have no effect."""
        return time.monotonic_ns() + self._to_unix

    def send(self, datagram: bytes) -> str:
        """See `DatagramTransport`; a link that is down is reported as an error of this computer."""
        try:
            self._socket.send(datagram)
        except ConnectionRefusedError:  # for an earlier datagram: nobody listens there
            return "" if self._retry_send(datagram) else "refused"
        except OSError as error:
            return errno.errorcode.get(error.errno or 0, "error")
        return ""

    def _retry_send(self, datagram: bytes) -> bool:
        try:
            self._socket.send(datagram)
        except OSError:
            return False
        return True

    def receive(self, until_ns: int) -> Arrival | None:
        """See `DatagramTransport`."""
        while True:
            wait = (until_ns - time.monotonic_ns()) / 1e9
            if not select.select([self._socket], [], [], max(0.0, wait))[0]:
                if wait <= 0:
                    return None
                continue
            try:
                datagram, extra, _, _ = self._socket.recvmsg(_LONGEST, 256)
            except OSError:  # the ICMP error of an earlier datagram
                continue
            return self._arrival(datagram, extra)

    @staticmethod
    def _arrival(datagram: bytes, extra: list[tuple[int, int, bytes]]) -> Arrival:
        now, age, ttl = time.monotonic_ns(), 0, _UNKNOWN_TTL
        for level, kind, data in extra:
            if (level, kind) == (socket.SOL_SOCKET, _SO_TIMESTAMPNS):
                seconds, ns = struct.unpack_from("ll", data)
                age = time.time_ns() - (seconds * 1_000_000_000 + ns)
            elif (level, kind) in {(socket.IPPROTO_IP, socket.IP_TTL), (socket.IPPROTO_IPV6, _IPV6_HOPLIMIT)}:
                ttl = struct.unpack_from("i", data)[0]
        # A clock that was put back or forward between the two readings is no age of a datagram.
        return Arrival(datagram, now - age if 0 <= age < _SECOND else now, ttl)
