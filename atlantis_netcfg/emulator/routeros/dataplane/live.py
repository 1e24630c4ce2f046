"""The live data plane of a router: a namespace that follows its rows, the packets of its own probes, and all counts.

A probe waits for its response in real seconds, at most as long as its row says; when it is due says the router's clock,
which may run ahead. So a script of the router acts after minutes of its own time, by packets that took a moment.
"""

from __future__ import annotations

import itertools
import json
import select
import shutil
import socket
import struct
import time
from contextlib import suppress
from dataclasses import dataclass
from ipaddress import IPv4Address
from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol

from atlantis_netcfg.emulator.lab import hosts
from atlantis_netcfg.emulator.routeros.dataplane import packets, rows, ruleset
from atlantis_netcfg.emulator.routeros.dataplane.namespace import RouterNamespace

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.emulator.routeros.dataplane.rows import NetworkState
    from atlantis_netcfg.emulator.routeros.network.topology import Topology
    from atlantis_netcfg.emulator.routeros.store import RowStore

GRACE_S: Final = 0.05
"""A response over a cable comes within this time; whoever has to wait longer lets other probes go on."""
_PING_TIMEOUT_S: Final = 1.0
_ICMP_FILTER: Final = (255, 1, struct.pack("I", 0xFFFFFFFF & ~1))
"""SOL_RAW, ICMP_FILTER and a mask that lets only echo replies in (raw(7))."""
_PADDING: Final = bytes(44)
"""Makes an echo request as long as that of `/ping`: an IP packet of 84 bytes."""
_IP_PKTINFO: Final = 8
"""Names the sender of one packet (ip(7)); Python 3.11 has no name for it."""
_SO_TIMESTAMPNS: Final = 35
"""Lets the kernel say when each packet has come (socket(7)): it may lie here while other probes go on."""
_TIMESTAMP: Final = struct.Struct("qq")
_AT_MOST: Final = 2048
_NTP_PORT: Final = 123
_SNTP_REQUEST: Final = bytes([0x23]) + bytes(47)
"""A client's request of version 4 (RFC 4330)."""
_CONNTRACK: Final = "conntrack"


class LiveCore(Protocol):
    """The router's state as far as it is followed and counted here: a `Core`."""

    met: dict[tuple[str, int], tuple[int, int]]

    @property
    def store(self) -> RowStore:
        """Its rows."""

    @property
    def topology(self) -> Topology:
        """What they mean now."""


@dataclass(slots=True)
class PacketProbe:
    """A packet of the router, and the response to it."""

    _wait: Callable[[float], tuple[float, int] | None]
    """Wait until a moment of `time.monotonic` for the response; return when it came, and its TTL."""
    sent_at: float
    end: float
    """Later responses do not count; both on `time.monotonic`."""
    response: tuple[float, int] | None = None
    """Round-trip time in seconds, and TTL."""

    def has_response(self, wait_s: float | None = None) -> bool:
        """Return whether the response has come; wait for it `wait_s` or, by default, until its timeout."""
        if self.response is None:
            end = self.end if wait_s is None else min(self.end, time.monotonic() + wait_s)
            if (arrival := self._wait(end)) is not None and arrival[0] <= self.end:
                self.response = arrival[0] - self.sent_at, arrival[1]
        return self.response is not None


class LiveNetwork:
    """A router that is attached to the namespace `name`, which exists; only one thread may use it."""

    def __init__(self, core: LiveCore, name: str) -> None:
        """Bring the namespace to the router's rows. Raises LookupError, or MachineError."""
        if not Path("/run/netns", name).exists():
            raise LookupError(f"there is no network namespace {name}")
        self.core = core
        self._router = RouterNamespace(name)
        self._sockets = hosts.NamespaceSockets(name)
        self._echoes = self._sockets.socket(socket.SOCK_RAW, protocol=socket.IPPROTO_ICMP)
        self._echoes.setsockopt(*_ICMP_FILTER)
        self._echoes.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        self._clock = self._sockets.socket(socket.SOCK_DGRAM)
        self._clock.setblocking(False)
        self._connections: dict[int, tuple[socket.socket, float]] = {}
        self._numbers = itertools.cycle(range(1, packets.MOST))
        self._arrivals: dict[int, tuple[float, int]] = {}
        self._state: NetworkState | None = None
        self._revision: int | None = None
        self._counts: dict[tuple[str, int], tuple[int, int]] = {}
        """Menu and row of a rule to its counters at the last reading, since the table was loaded."""
        self._octets: dict[str, tuple[int, int]] = self._read_octets()
        self._has_time_client = True
        self._time_server: str | None = None
        self.follow()

    def restart(self, core: LiveCore) -> None:
        """Continue with the router as it is after a reboot: its counters begin at 0, and no connection is known."""
        self._collect()
        self.core, self._revision = core, None
        self._octets = self._read_octets()
        self.forget_connections()

    def close(self) -> None:
        """Close all sockets; the namespace remains as it is."""
        for each in (self._echoes, self._clock, *(connection for connection, _ in self._connections.values())):
            each.close()
        self._sockets.close()

    @property
    def limits(self) -> tuple[str, ...]:
        """What the packets do not meet: rows that Linux cannot stand for, one line each."""
        missing = () if shutil.which(_CONNTRACK) else ("connections are not removed: conntrack is not installed",)
        return (*(() if self._state is None else self._state.limits), *missing)

    def follow(self) -> None:
        """Bring the namespace to the router's rows if they have changed. Raises MachineError."""
        if self.core.store.revision == self._revision:
            return
        self._revision = self.core.store.revision
        state = rows.network_state(self.core.topology)
        if state != self._state:
            self._collect()
            if self._router.apply(state):
                self._counts.clear()
            self._state = state
        is_on = _is_time_client_on(self.core)
        if is_on and not self._has_time_client:
            self._ask_time()
        self._has_time_client = is_on

    # --- probes ----------------------------------------------------------------------------------------------------

    def echo(self, target: IPv4Address, source: str | None, timeout_s: float) -> PacketProbe:
        """Send an echo request, which the router's own filter may drop."""
        self.follow()
        number = next(self._numbers)
        self._arrivals.pop(number, None)
        packet = packets.FlowPacket(IPv4Address(source or 0), target, "icmp", number, source_port=number)
        body = packet.encode()[packets.HEADER :] + _PADDING
        sender = [(socket.IPPROTO_IP, _IP_PKTINFO, struct.pack("=I4s4x", 0, IPv4Address(source or 0).packed))]
        now = time.monotonic()
        with suppress(OSError):  # the filter drops it, or there is no route
            self._echoes.sendmsg([body], sender, 0, (str(target), 0))
        return PacketProbe(lambda end: self._wait_for_echo(number, end), now, now + timeout_s)

    def connect(self, target: IPv4Address, port: int, source: str | None, timeout_s: float) -> PacketProbe:
        """Open a TCP connection; it is closed as soon as it is open."""
        self.follow()
        now = time.monotonic()
        for number in [number for number, (_, end) in self._connections.items() if end < now]:
            self._connections.pop(number)[0].close()
        number, connection = next(self._numbers), self._sockets.socket()
        self._connections[number] = connection, now + timeout_s
        connection.setblocking(False)
        with suppress(OSError):  # EINPROGRESS, or what `_wait_for_connection` finds out
            connection.bind((source or "", 0))
            connection.connect((str(target), port))
        return PacketProbe(lambda end: self._wait_for_connection(number, end), now, now + timeout_s)

    def ping(self, target: IPv4Address, source: str | None, count: int) -> list[tuple[float, int] | None]:
        """Send echo requests; return round-trip time in seconds and TTL of each response."""
        probes = []
        for _ in range(count):
            probes.append(self.echo(target, source, _PING_TIMEOUT_S))
            probes[-1].has_response(GRACE_S)
        return [probe.response if probe.has_response() else None for probe in probes]

    def _wait_for_echo(self, number: int, end: float) -> tuple[float, int] | None:
        while number not in self._arrivals and _is_ready(self._echoes, end, is_reading=True):
            data, ((_, _, stamp),), _, _ = self._echoes.recvmsg(_AT_MOST, socket.CMSG_SPACE(_TIMESTAMP.size))
            packet = packets.decode(data)
            if packet is not None and packet.source_port == packet.number:
                seconds, nanoseconds = _TIMESTAMP.unpack(stamp)
                waited_s = max(0.0, time.time() - seconds - nanoseconds / 1e9)
                self._arrivals[packet.number] = time.monotonic() - waited_s, data[8]
        return self._arrivals.pop(number, None)

    def _wait_for_connection(self, number: int, end: float) -> tuple[float, int] | None:
        connection, _ = self._connections.get(number, (None, 0.0))
        if connection is None or not _is_ready(connection, end, is_reading=False):
            return None
        del self._connections[number]
        with connection:
            is_open = connection.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) == 0 and _has_peer(connection)
        return (time.monotonic(), 0) if is_open else None

    # --- time ------------------------------------------------------------------------------------------------------

    def _ask_time(self) -> None:
        self._time_server = None
        table = self.core.store.table("/system/ntp/client/servers")
        for item in table.items:
            with suppress(OSError):  # the filter drops it, or there is no route; a name is not resolved
                server = self.core.store.text(table, item, "address") or ""
                self._clock.sendto(_SNTP_REQUEST, (str(IPv4Address(server)), _NTP_PORT))

    def time_server(self) -> str | None:
        """Return the server that has answered the last request, or None."""
        with suppress(OSError):
            self._time_server = self._clock.recvfrom(_AT_MOST)[1][0]
        return self._time_server

    # --- counters and connections ----------------------------------------------------------------------------------

    def count_packets(self, menu: str) -> None:
        """Add what the rules have met to the counters of the router's rows, if they are in this menu."""
        if menu in ruleset.MENUS:
            self.follow()
            self._collect()

    def _collect(self) -> None:
        if self._state is None:
            return
        listing = json.loads(self._router.run("nft", "-j", "list", "table", "ip", ruleset.TABLE))["nftables"]
        rules = sorted((entry["rule"] for entry in listing if "rule" in entry), key=lambda rule: str(rule["chain"]))
        for (_, menu, item), rule in zip(self._state.counters, rules, strict=True):
            key = menu, item
            (counter,) = [part["counter"] for part in rule["expr"] if "counter" in part]
            now, before = (counter["packets"], counter["bytes"]), self._counts.get(key, (0, 0))
            total = self.core.met.get(key, (0, 0))
            self.core.met[key] = total[0] + now[0] - before[0], total[1] + now[1] - before[1]
            self._counts[key] = now

    def octets(self) -> dict[int, tuple[int, int]]:
        """Return bytes received and sent by each interface since the start of the router."""
        self.follow()
        now = self._read_octets()
        result = {}
        for number, device in rows.devices_of(self.core.topology).items():
            (rx, tx), (earlier_rx, earlier_tx) = now.get(device, (0, 0)), self._octets.get(device, (0, 0))
            result[number] = rx - earlier_rx, tx - earlier_tx
        return result

    def _read_octets(self) -> dict[str, tuple[int, int]]:
        text = self._sockets.call(lambda path: Path(path).read_text("ascii"), "/proc/thread-self/net/dev")
        fields = [line.replace(":", " ").split() for line in text.splitlines()[2:]]
        return {name: (int(numbers[0]), int(numbers[8])) for name, *numbers in fields}

    def connections(self) -> list[dict[str, str]]:
        """Return the tracked connections by the names of `/ip/firewall/connection`; none without `conntrack`."""
        if shutil.which(_CONNTRACK) is None:
            return []
        return [_connection(line) for line in self._router.run(_CONNTRACK, "-L").splitlines()]

    def forget_connections(self, *rows_: dict[str, str]) -> None:
        """Remove tracked connections; by default all of them."""
        if shutil.which(_CONNTRACK) is None:
            return
        if not rows_:
            self._router.run(_CONNTRACK, "-F")
        for row in rows_:
            (source, source_port), (target, port) = (row[name].split(":") for name in ("src-address", "dst-address"))
            words = ["-D", "-p", row["protocol"], "-s", source, "-d", target]
            ports = ["--sport", source_port, "--dport", port] if row["protocol"] in ("tcp", "udp") else []
            with suppress(hosts.MachineError):  # it has ended meanwhile
                self._router.run(_CONNTRACK, *words, *ports)


def _is_ready(each: socket.socket, end: float, *, is_reading: bool) -> bool:
    if each.fileno() < 0:  # the router was detached while a probe of it was open
        return False
    readers, writers = ([each], []) if is_reading else ([], [each])
    return any(select.select(readers, writers, [], max(0.0, end - time.monotonic())))


def _has_peer(connection: socket.socket) -> bool:
    with suppress(OSError):
        return bool(connection.getpeername())
    return False


def _is_time_client_on(core: LiveCore) -> bool:
    table = core.store.table("/system/ntp/client")
    return any(core.store.text(table, item, "enabled") == "yes" for item in table.items)


def _connection(line: str) -> dict[str, str]:
    """Return a connection from a line of `conntrack -L`: its protocol, and twice addresses and ports."""
    words = [word.split("=", 1) for word in line.split() if "=" in word]
    both = {name: [value for other, value in words if other == name] for name in ("src", "dst", "sport", "dport")}
    ends = {}
    for place, prefix in enumerate(("", "reply-")):
        for side, port in (("src", "sport"), ("dst", "dport")):
            number = both[port][place] if both[port] else "0"
            ends[f"{prefix}{side}-address"] = f"{both[side][place]}:{number}"
    return {"protocol": line.split(maxsplit=1)[0], **ends}
