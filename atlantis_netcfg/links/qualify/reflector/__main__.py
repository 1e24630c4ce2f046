"""Serves on a UDP port until it is ended: `python -m atlantis_netcfg.links.qualify.reflector --key-file FILE`."""

from __future__ import annotations

import argparse
import asyncio
import select
import signal
import socket
import struct
import sys
import time
from contextlib import suppress
from pathlib import Path

from .answering import Reflector
from .clock import ClockState, kernel_clock
from .stamp import MIN_KEY_SIZE, PORT, reflector_key

_SO_TIMESTAMPNS = 35
_IP_RECVTTL = 12
_IPV6_RECVHOPLIMIT = 51
_IPV6_HOPLIMIT = 52
_IP_MTU_DISCOVER = 10
_IPV6_MTU_DISCOVER = 23
_NO_FRAGMENTS = 3
"""IP_PMTUDISC_PROBE: set the DF bit and ignore the kernel's path MTU."""
_LONGEST = 65536
_RECEIVE_BUFFER = 1 << 22
"""Requested receive buffer; the kernel may grant less. An overflow would look like packet loss of the link."""
_AT_ONCE = 64
"""Maximum number of datagrams answered before the loop checks its signals again."""
_UNKNOWN_TTL = 255
_QUEUE_S = 0.05
"""Seconds to wait while this computer's send queue is full."""


def open_socket(address: str, port: int) -> socket.socket:
    """Bind a socket with receive timestamps and TTL, and without fragmentation."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    udp_socket = socket.socket(family, socket.SOCK_DGRAM)
    udp_socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
    udp_socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
    if family == socket.AF_INET:
        udp_socket.setsockopt(socket.IPPROTO_IP, _IP_RECVTTL, 1)
        udp_socket.setsockopt(socket.IPPROTO_IP, _IP_MTU_DISCOVER, _NO_FRAGMENTS)
    else:
        udp_socket.setsockopt(socket.IPPROTO_IPV6, _IPV6_RECVHOPLIMIT, 1)
        udp_socket.setsockopt(socket.IPPROTO_IPV6, _IPV6_MTU_DISCOVER, _NO_FRAGMENTS)
    udp_socket.setblocking(False)
    udp_socket.bind((address, port))
    return udp_socket


def answer_waiting(udp_socket: socket.socket, reflector: Reflector) -> None:
    """Answer the datagrams that are waiting."""
    for _ in range(_AT_ONCE):
        try:
            datagram, extra, _, source = udp_socket.recvmsg(_LONGEST, 256)
        except BlockingIOError:
            return
        except OSError:  # an ICMP error for an earlier answer
            continue
        received_ns, ttl = _parse_ancillary(extra)
        reply = reflector.answer(datagram, source, received_ns, ttl, time.time_ns)
        if reply is not None:
            try:
                udp_socket.sendto(reply, source)
            except OSError:  # nobody is there any more, or the queue is full: it is lost, as on the link
                continue


def _parse_ancillary(extra: list[tuple[int, int, bytes]]) -> tuple[int, int]:
    """Return the kernel's receive time and the received TTL."""
    received_ns, ttl = time.time_ns(), _UNKNOWN_TTL
    for level, kind, data in extra:
        if (level, kind) == (socket.SOL_SOCKET, _SO_TIMESTAMPNS):
            seconds, ns = struct.unpack_from("ll", data)
            received_ns = seconds * 1_000_000_000 + ns
        elif (level, kind) in ((socket.IPPROTO_IP, socket.IP_TTL), (socket.IPPROTO_IPV6, _IPV6_HOPLIMIT)):
            ttl = struct.unpack_from("i", data)[0]
    return received_ns, ttl


def send_requested(udp_socket: socket.socket, reflector: Reflector) -> float | None:
    """Send the due chunks; return the seconds until the next one, None if no message is in transit."""
    for _ in range(_AT_ONCE):
        chunk = reflector.requested_chunk(time.time_ns)
        if chunk is None:
            break
        try:
            udp_socket.sendto(*chunk)
        except BlockingIOError:
            # What this computer could not take at once would look like loss of the link.
            select.select([], [udp_socket], [], _QUEUE_S)
            with suppress(OSError):
                udp_socket.sendto(*chunk)
        except OSError:  # nobody is there any more
            continue
    due = reflector.due_ns()
    return None if due is None else max(0.0, (due - time.time_ns()) / 1e9)


async def serve(udp_socket: socket.socket, reflector: Reflector, end: asyncio.Event) -> None:
    """Answer datagrams until the event is set."""
    loop = asyncio.get_running_loop()
    timers: list[asyncio.TimerHandle] = []

    def send() -> None:
        for timer in timers:
            timer.cancel()
        wait = send_requested(udp_socket, reflector)
        timers[:] = [] if wait is None else [loop.call_later(wait, send)]

    def answer() -> None:
        answer_waiting(udp_socket, reflector)
        send()

    loop.add_reader(udp_socket.fileno(), answer)
    try:
        await end.wait()
    finally:
        loop.remove_reader(udp_socket.fileno())


async def _wait_for_end(udp_socket: socket.socket, reflector: Reflector, idle_s: float | None) -> None:
    end = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, end.set)
    print("ready on port {}".format(udp_socket.getsockname()[1]), flush=True)  # noqa: T201, UP032 - a program of its own
    watch = loop.create_task(_end_when_idle(reflector, end, idle_s))
    await serve(udp_socket, reflector, end)
    watch.cancel()


async def _end_when_idle(reflector: Reflector, end: asyncio.Event, idle_s: float | None) -> None:
    """Set the event once nothing was answered for `idle_s`; None means never."""
    answer_count = -1
    while idle_s is not None and answer_count != reflector.statistics.answered + reflector.statistics.requested:
        answer_count = reflector.statistics.answered + reflector.statistics.requested
        await asyncio.sleep(idle_s)
    if idle_s is not None:
        end.set()


def _key(file: Path) -> bytes:
    """Read the key without surrounding white space, from standard input (`-`) if systemd opened a root-only file."""
    return (sys.stdin.buffer.read() if str(file) == "-" else file.read_bytes()).strip()


def main(words: list[str] | None = None) -> int:
    """Run the program and return its exit code."""
    parser = argparse.ArgumentParser(prog="reflector", description=__doc__)
    parser.add_argument("--address", default="0.0.0.0", help="where it listens")  # noqa: S104 - authenticated by default
    parser.add_argument("--port", type=int, default=PORT)
    parser.add_argument("--rate-mbps", type=float, default=50.0, help="what one source is sent at most")
    parser.add_argument("--synchronised", action="store_true", help="this clock is, whatever the kernel says of it")
    parser.add_argument("--clock-error-s", type=float, default=1.0, help="the error of this clock, then")
    who = parser.add_mutually_exclusive_group(required=True)
    who.add_argument("--key-file", type=Path, help="only who has this key is answered; `-`: standard input")
    who.add_argument("--unauthenticated", action="store_true", help="answer anybody: for testers of others")
    parser.add_argument("--idle-s", type=float, help="end when nobody was answered for so long")
    parser.add_argument("--name", help="what this reflector is called where its key is shared with others")
    arguments = parser.parse_args(words)
    key = None if arguments.unauthenticated else _key(arguments.key_file)
    if key is not None and len(key) < MIN_KEY_SIZE:
        parser.error("the key in {} has fewer than {} octets".format(arguments.key_file, MIN_KEY_SIZE))  # noqa: UP032
    if key is not None and arguments.name is not None:
        key = reflector_key(key, arguments.name)
    with open_socket(arguments.address, arguments.port) as udp_socket:
        reflector = Reflector(
            key,
            port=udp_socket.getsockname()[1],
            rate_bps=arguments.rate_mbps * 1e6,
            clock=(lambda: ClockState(True, arguments.clock_error_s)) if arguments.synchronised else kernel_clock,
        )
        asyncio.run(_wait_for_end(udp_socket, reflector, arguments.idle_s))
    print(reflector.statistics, file=sys.stderr)  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(main())
