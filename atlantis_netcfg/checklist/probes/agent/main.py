"""The agent program: runs all requests at once and prints each result as a line of JSON as soon as it is complete.

Requests wait for earlier ones that use the same endpoint or medium. Whatever happens to one request, the others get a
result, and at the deadline everything ends with the data received so far.

Also the requests that are not streams: a program, the DHCP servers and the IPv6 routers of a segment, the DDS
participants of a host, and messages that another computer sends back.

Programs are read-only; which ones may run is decided before the request is sent.

DHCP: DISCOVER is broadcast, every OFFER is kept, and nothing is requested. Without a REQUEST no server grants a lease
(RFC 2131, 3.1), though it may reserve the offered address for some seconds or minutes. A server may respond only to
known network cards, or only to unknown ones. So DISCOVER is sent for the interface's own MAC address, for one that
nobody has (always the same), and for those that are given. Transaction numbers are random, so that no other client
mistakes the response for its own. Frames have this card's source address, the only one that switches learn, and come
from 0.0.0.0: the interface keeps its address, and the system's DHCP client is not disturbed.

Routers: a solicitation is multicast from the unspecified address, every advertisement is kept, and none is applied.
They are read from the segment, so that neither the firewall nor the kernel of this computer hides them.

A message to another computer of the pilot has a new random token, is sent by the regular route, and is padded to the
length of its response. Whatever returns is reported with its sender and the interface on which it arrived.

DDS: a participant without topics announces itself at the ports in the inventory, and leaves (DDSI-RTPS 8.5.3). A
participant that accepts it announces itself to the port given, and addresses its identity, which is random each time: a
program that has only bound a port cannot know that identity.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import traceback
from contextlib import contextmanager, suppress
from typing import IO, Any, Callable, Iterator

from atlantis_netcfg.checklist.probes.agent.streams import (
    ProbeError,
    ReceiveBuffer,
    encode_bytes,
    no_answer,
    serial,
    tcp,
    udp,
)

_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
_LONGEST = 65536
_RUNNING: list[subprocess.Popen[bytes]] = []


def run(question: dict[str, Any]) -> dict[str, Any]:
    """Run a program without a shell; return the fields of `CommandResult`. Raises ProbeError: missing, denied."""
    began = time.time()
    try:
        program = subprocess.Popen(  # noqa: S603 - of the closed list, and without a shell
            question["argv"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={"PATH": _PATH, "LC_ALL": "C"},
            start_new_session=True,
        )
    except OSError as error:
        raise no_answer(error, question["argv"][0]) from None
    _RUNNING.append(program)
    trouble, words = None, ""
    out, err = bytearray(), bytearray()
    readers = [threading.Thread(target=_drain, args=each) for each in ((program.stdout, out), (program.stderr, err))]
    ends = time.monotonic() + question["within_s"]
    for reader in readers:
        reader.start()
    for reader in readers:
        reader.join(max(0.0, ends - time.monotonic()))
    if any(reader.is_alive() for reader in readers):
        trouble, words = "silent", f"{question['argv'][0]} did not end within {question['within_s']:g} s"
        _end(program)
    program.wait()
    for reader in readers:
        reader.join()
    _RUNNING.remove(program)
    values = {"out": _text(out), "err": _text(err)}
    return {"trouble": trouble, "words": words, "rc": program.returncode, "began": began, **values}


def end_all() -> None:
    """Kill the programs that still run."""
    for program in tuple(_RUNNING):
        _end(program)


def _end(program: subprocess.Popen[bytes]) -> None:
    """Kill a program and its child processes."""
    with suppress(OSError):
        os.killpg(program.pid, signal.SIGKILL)


def _drain(pipe: IO[bytes], output: bytearray) -> None:
    """Keep the beginning of a program's output, and discard the rest without blocking it."""
    with pipe:
        for chunk in iter(lambda: pipe.read(_LONGEST), b""):
            output += chunk[: _LONGEST - len(output)]


def _text(data: bytearray) -> str:
    return data.decode("utf-8", "replace")


_IPV4, _UDP = 0x0800, 17
_OUTGOING = 4
"""Packet type of a frame that this computer has sent (packet(7))."""
_COOKIE = b"\x63\x82\x53\x63"
_DISCOVER, _OFFER = 1, 2
_ROUTER, _TYPE, _SERVER, _PARAMETERS = 3, 53, 54, 55
_BROADCAST = b"\xff" * 6
_ROUNDS = 2
_MOST_OFFERS = 200


def probing(question: dict[str, Any]) -> dict[str, Any]:
    """Discover DHCP servers; return the fields of `DhcpOffers`. Raises ProbeError: missing, denied, unreachable."""
    with _segment(question["interface"], _IPV4, "DHCP servers") as (wire, _, mac):
        number = os.urandom(4)
        extra_cards = [bytes.fromhex(card.replace(":", "")) for card in question.get("cards", ())]
        cards = list(dict.fromkeys([mac, _nobody(mac), *extra_cards]))
        requests = [_frame(mac, card, number) for card in cards]
        offers = _answers(
            wire, requests, lambda frame: _offer(frame, cards, number), question["within_s"], _MOST_OFFERS
        )
    return {"trouble": None, "words": "", "offers": offers}


@contextmanager
def _segment(word: str, protocol: int, what: str) -> Iterator[tuple[socket.socket, str, bytes]]:
    """Open a raw socket for a protocol; yield it with the interface's name and MAC. Raises ProbeError, also within."""
    name = _interface(word)
    try:
        # With a protocol it would hear all interfaces until it is bound.
        with socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0) as wire:
            wire.bind((name, protocol))
            mac = wire.getsockname()[4]
            if len(mac) != len(_BROADCAST):
                raise ProbeError("missing", f"{name} is no Ethernet")
            yield wire, name, mac
    except PermissionError:
        raise ProbeError("denied", f"only root may ask a segment for its {what}") from None
    except OSError as error:
        raise no_answer(error, name) from None


def _interface(word: str) -> str:
    """Return the interface with this name or address."""
    if word in [name for _, name in socket.if_nameindex()]:
        return word
    result = run({"argv": ["ip", "-j", "-4", "addr"], "within_s": 10})["out"]
    for link in json.loads(result or "[]"):
        if word in [address.get("local") for address in link.get("addr_info", ())]:
            return str(link["ifname"])
    raise ProbeError("missing", f"this computer has no interface {word}")


def _nobody(mac: bytes) -> bytes:
    """Return a locally administered MAC address (IEEE 802) that no other computer has."""
    return bytes([mac[0] & 0xFC | 2, *mac[1:5], mac[5] ^ 0x55])


def _frame(mac: bytes, card: bytes, number: bytes) -> bytes:
    """Build a DISCOVER frame: Ethernet, IP, UDP without checksum, BOOTP (RFC 2131, 2; RFC 2132, 9.6 and 9.8)."""
    # The broadcast flag: the answer comes to everybody, since nobody has the offered address.
    bootp = struct.pack("!4B4sHH16x6s10x192x", 1, 1, 6, 0, number, 0, 0x8000, card)
    options = bytes([_TYPE, 1, _DISCOVER, _PARAMETERS, 3, 1, _ROUTER, 51, 255])
    body = (bootp + _COOKIE + options).ljust(300, b"\0")
    udp = struct.pack("!4H", 68, 67, 8 + len(body), 0) + body
    ip = struct.pack("!BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), 0, 0, 64, _UDP, 0, b"\0" * 4, b"\xff" * 4)
    ip = ip[:10] + struct.pack("!H", _checksum(ip)) + ip[12:]
    return _BROADCAST + mac + struct.pack("!H", _IPV4) + ip + udp


def _checksum(header: bytes) -> int:
    total: int = sum(struct.unpack(f"!{len(header) // 2}H", header))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return ~total & 0xFFFF


def _answers(
    wire: socket.socket,
    requests: list[bytes],
    read: Callable[[bytes], dict[str, Any] | None],
    within_s: float,
    most: int,
) -> list[dict[str, Any]]:
    """Send the requests, and collect each different response, until the timeout or the maximum number."""
    result: list[dict[str, Any]] = []
    for _ in range(_ROUNDS):  # a frame may be lost
        for request in requests:
            wire.send(request)
        ends = time.monotonic() + within_s / _ROUNDS
        while len(result) < most and (remaining_s := ends - time.monotonic()) > 0:
            wire.settimeout(remaining_s)
            try:
                frame, where = wire.recvfrom(65535)
            except socket.timeout:
                break
            answer = None if where[2] == _OUTGOING else read(frame)
            if answer is not None and answer not in result:
                result.append(answer)
    return result


def _offer(frame: bytes, cards: list[bytes], number: bytes) -> dict[str, str | None] | None:
    """Parse a frame; None if it is not an offer for our request."""
    head = 14 + (frame[14] & 15) * 4 if len(frame) > 14 else 0  # noqa: PLR2004 - Ethernet's header
    bootp = frame[head + 8 :]
    to_client = frame[23:24] == bytes([_UDP]) and frame[head + 2 : head + 4] == b"\0\x44"
    if not to_client or bootp[:1] != b"\2" or bootp[4:8] != number or bootp[28:34] not in cards:
        return None
    options = _parse_dhcp_options(bootp[240:]) if bootp[236:240] == _COOKIE else {}
    if options.get(_TYPE) != bytes([_OFFER]):
        return None
    return {
        "server": _address(options.get(_SERVER, b"")) or _address(frame[26:30]),
        "mac": ":".join(f"{byte:02x}" for byte in frame[6:12]),
        "address": _address(bootp[16:20]),
        "router": _address(options.get(_ROUTER, b"")[:4]),
    }


def _parse_dhcp_options(data: bytes) -> dict[int, bytes]:
    result: dict[int, bytes] = {}
    while data and data[0] != 255:  # noqa: PLR2004 - the last option
        if data[0] == 0:
            data = data[1:]
        elif len(data) > 1:
            result[data[0]] = result.get(data[0], b"") + data[2 : 2 + data[1]]
            data = data[2 + data[1] :]
        else:
            break
    return result


def _address(four: bytes) -> str | None:
    return socket.inet_ntoa(four) if len(four) == 4 else None  # noqa: PLR2004 - an IPv4 address


_IPV6, _PREFIX, _ALL_NODES = 0x86DD, 3, bytes.fromhex("333300000001")
_ADVERTISEMENT = bytes([58, 255, 134, 0])
"""ICMPv6, a hop limit that no router has lowered, type and code of the advertisement."""
_SOL_PACKET, _ADD_MEMBERSHIP = 263, 1
"""Options of packet(7), so that the network card accepts multicast frames of one address."""
_MOST_ROUTERS, _MOST_PREFIXES = 20, 8
_OPTIONS = 70
"""Offset of the options: after Ethernet, IPv6 and the 16 bytes of an advertisement."""


def solicit(question: dict[str, Any]) -> dict[str, Any]:
    """Discover IPv6 routers; return the fields of `RouterAdvertisements`. Raises ProbeError like `probing`."""
    with _segment(question["interface"], _IPV6, "routers") as (wire, name, mac):
        group = struct.pack("=iHH8s", socket.if_nametoindex(name), 0, len(_ALL_NODES), _ALL_NODES)
        wire.setsockopt(_SOL_PACKET, _ADD_MEMBERSHIP, group)
        routers = _answers(wire, [_solicitation(mac)], _advertisement, question["within_s"], _MOST_ROUTERS)
    return {"trouble": None, "words": "", "routers": routers}


def _solicitation(mac: bytes) -> bytes:
    """Build a solicitation: Ethernet, IPv6 from the unspecified address, ICMPv6 without options (RFC 4861, 4.1)."""
    routers = socket.inet_pton(socket.AF_INET6, "ff02::2")
    ip = bytes.fromhex("86dd60000000 0008 3aff") + bytes(16) + routers
    return b"\x33\x33" + routers[-4:] + mac + ip + bytes.fromhex("8500 7bb8 00000000")  # with its checksum


def _advertisement(frame: bytes) -> dict[str, Any] | None:
    """Parse a frame; None if it is not a router advertisement of this segment (RFC 4861, 6.1.2)."""
    end = 54 + int.from_bytes(frame[18:20], "big")
    if frame[20:22] + frame[54:56] != _ADVERTISEMENT or not _OPTIONS <= end <= len(frame):
        return None
    prefixes: list[str] = []
    options = frame[_OPTIONS:end]
    while len(options) > 1 and options[1] and len(prefixes) < _MOST_PREFIXES:
        option, options = options[: options[1] * 8], options[options[1] * 8 :]
        if (option[:2], len(option)) == (bytes([_PREFIX, 4]), 32):
            prefixes.append(f"{socket.inet_ntop(socket.AF_INET6, option[16:])}/{option[2]}")
    return {
        "address": socket.inet_ntop(socket.AF_INET6, frame[22:38]),
        "mac": ":".join(f"{byte:02x}" for byte in frame[6:12]),
        "lifetime_s": int.from_bytes(frame[60:62], "big"),
        "prefixes": prefixes,
    }


_LEASE_S = 10
_AGAIN_S = 1.0
_MOST = 40
"""Maximum of datagrams kept: two of each participant."""
_WRITER = b"\x00\x01\x00\xc2"
"""Writer of SPDP (9.3.1.5)."""
_ENDPOINTS = 0x3F
"""Announcers and detectors of participants, publications and subscriptions (9.3.2)."""


def discover(question: dict[str, Any]) -> dict[str, Any]:
    """Announce a DDS participant; return the fields of `DdsDiscoverResult`. Raises ProbeError."""
    prefix, where = os.urandom(12), question["address"]
    datagrams: dict[tuple[bytes, bool], list[Any]] = {}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
        try:
            _check_address(where)
            wire.bind(("", 0))  # Fast DDS without a profile answers an address of its own computer by the loopback
            local = wire.getsockname()[1]
            ends, due = time.monotonic() + question["within_s"], 0.0
            while time.monotonic() < ends:
                if time.monotonic() >= due:
                    _send(wire, question, _hello(prefix, where, local, question["domain"]))
                    due = time.monotonic() + _AGAIN_S
                wire.settimeout(max(min(due, ends) - time.monotonic(), 0.001))
                try:
                    data, source = wire.recvfrom(65535)
                except socket.timeout:
                    continue
                if data[:4] == b"RTPS" and (prefix in data or _WRITER in data) and len(datagrams) < _MOST:
                    datagrams.setdefault((data[8:20], prefix in data), [source[0], encode_bytes(data)])
            _send(wire, question, _bye(prefix))
        except OSError as error:
            raise no_answer(error, where) from None
    return {"trouble": None, "words": "", "prefix": prefix.hex(), "datagrams": list(datagrams.values())}


def _check_address(address: str) -> None:
    """Raise OSError if the computer does not have this address."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as there:
        there.bind((address, 0))


def _send(wire: socket.socket, question: dict[str, Any], message: bytes) -> None:
    for port in question["ports"]:
        wire.sendto(message, (question["address"], port))


def _hello(prefix: bytes, address: str, port: int, domain: int) -> bytes:
    """Build SPDP's DATA with the parameters of a participant, with numbers in their shortest form (9.6.2.2)."""
    there = struct.pack("<iI12x", 1, port) + socket.inet_aton(address)
    result = (
        (0x15, b"\x02\x01\0\0"),
        (0x16, b"\0" * 4),
        (0x50, prefix + b"\x00\x00\x01\xc1"),
        (0x02, struct.pack("<iI", _LEASE_S, 0)),
        (0x31, there),
        (0x32, there),
        (0x58, struct.pack("<I", _ENDPOINTS)),
        (0x0F, struct.pack("<I", domain)),
    )
    return _message(prefix, 0x05, 1, b"", result)


def _bye(prefix: bytes) -> bytes:
    """Build the message that disposes of the participant; key and status in the inline QoS (9.6.3.8, 9.6.3.9)."""
    guid = prefix + b"\x00\x00\x01\xc1"
    return _message(prefix, 0x0B, 2, _pack_parameters(((0x70, guid), (0x71, b"\0\0\0\x03"))), ((0x50, guid),))


def _pack_parameters(result: tuple[tuple[int, bytes], ...]) -> bytes:
    """Encode parameters by their numbers, with the end marker (9.4.2.11)."""
    return b"".join(struct.pack("<HH", name, len(value)) + value for name, value in result) + struct.pack("<HH", 1, 0)


def _message(prefix: bytes, flags: int, number: int, inline: bytes, result: tuple[tuple[int, bytes], ...]) -> bytes:
    body = struct.pack("<HH", 0, 16) + b"\0" * 4 + _WRITER + struct.pack("<iI", 0, number) + inline
    body += b"\x00\x03\0\0" + _pack_parameters(result)
    return b"RTPS\x02\x01\0\0" + prefix + struct.pack("<BBH", 0x15, flags, len(body)) + body


_LENGTH = 224
"""Bytes of a message; no response is longer, so that nobody can be made to flood others."""
_APART_S = 0.2
_PKTINFO, _RECVERR = 8, 11
"""Options of ip(7): report the interface of a datagram, and report refusals."""


def reflect(question: dict[str, Any]) -> dict[str, Any]:
    """Send the messages; return the fields of `ReflectResult`. Raises ProbeError."""
    tokens = [os.urandom(16).hex() for _ in range(question["count"])]
    send_times: dict[str, float] = {}
    answers: list[list[Any]] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
        wire.setsockopt(socket.IPPROTO_IP, _PKTINFO, 1)
        wire.setsockopt(socket.IPPROTO_IP, _RECVERR, 1)
        try:
            wire.bind((question["source"], 0))
        except OSError as error:
            raise no_answer(error, question["source"]) from None
        began = time.monotonic()
        try:
            for number, token in enumerate(tokens, start=1):
                message = b"atlantis-reflect " + token.encode()
                send_times[token] = time.monotonic()
                wire.sendto(message.ljust(_LENGTH), (question["address"], question["port"]))
                last = number == len(tokens)
                until = began + question["within_s"] if last else time.monotonic() + _APART_S
                _collect(wire, until, send_times, answers, len(tokens) if last else _MOST)
        except OSError as error:
            raise no_answer(error, question["address"]) from None
    return {"trouble": None, "words": "", "tokens": tokens, "answers": answers}


def _collect(
    wire: socket.socket, ends: float, send_times: dict[str, float], answers: list[list[Any]], enough: int
) -> None:
    """Collect datagrams until the deadline, or until there are enough responses."""
    while len(answers) < enough:
        remaining_s = ends - time.monotonic()
        if remaining_s <= 0:
            return
        wire.settimeout(remaining_s)
        try:
            data, ancillary, _, source = wire.recvmsg(4096, 256)
        except socket.timeout:
            return
        now = time.monotonic()
        borne = [token for token in send_times if token.encode() in data]
        delay = now - (send_times[borne[0]] if borne else min(send_times.values()))
        answers.append([source[0], _receiving_interface(ancillary), round(delay, 4), encode_bytes(data)])


def _receiving_interface(ancillary: list[Any]) -> str:
    for level, kind, data in ancillary:
        if (level, kind) == (socket.IPPROTO_IP, _PKTINFO):
            with suppress(OSError):
                return socket.if_indextoname(struct.unpack_from("=I", data)[0])
    return "?"


_BREATH_S = 0.3
"""Pause after which a single-client server, or a serial server, notices that the last client has gone."""
_UNREACHABLE_TROUBLES = ("silent", "unreachable")
_STREAMS: dict[str, Callable[[dict[str, Any], ReceiveBuffer], None]] = {"tcp": tcp, "udp": udp, "serial": serial}
_OTHERS: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
    "run": run,
    "dhcp": probing,
    "routers": solicit,
    "dds": discover,
    "reflect": reflect,
}


class _AgentRequest(threading.Thread):
    """A request and its thread, from its turn to its response."""

    def __init__(
        self, row: dict[str, Any], before: list[_AgentRequest], tell: Callable[[str, dict[str, Any]], None]
    ) -> None:
        super().__init__(daemon=True)
        self.over = threading.Event()
        self.answer: dict[str, Any] = {}
        self._row, self._before, self._tell = row, before, tell
        self._sound: ReceiveBuffer | None = None
        self._lock = threading.Lock()

    def run(self) -> None:
        """Wait for the requests before it, then send it."""
        for other in self._before:
            other.over.wait()
        if self.over.is_set():  # given up meanwhile
            return
        self._report_answer(self._same_end() or self._ask(), {})

    def report_timeout(self) -> None:
        """Report the data received so far, if the request has not ended."""
        sound = self._sound
        self._report_answer({} if sound is None else sound.as_answer(), {"trouble": "silent", "words": "timed out"})

    def _report_answer(self, answer: dict[str, Any], more: dict[str, Any]) -> None:
        with self._lock:
            if not self.over.is_set():
                self.answer = {**answer, **more}
                self._tell(self._row["key"], self.answer)
                self.over.set()

    def _same_end(self) -> dict[str, Any] | None:
        """Return the response of an endpoint that was just unreachable, so that it is not tried a second time."""
        for other in self._before:
            same = all(self._row.get(name) == other._row.get(name) for name in ("kind", "address", "port"))  # noqa: SLF001 - its like
            if same and self._row["kind"] == "tcp" and other.answer.get("trouble") in _UNREACHABLE_TROUBLES:
                return other.answer
        return None

    def _ask(self) -> dict[str, Any]:
        if self._before:
            time.sleep(_BREATH_S)
        try:
            if self._row["kind"] in _OTHERS:
                return _OTHERS[self._row["kind"]](self._row)
            self._sound = ReceiveBuffer(self._row["max_bytes"])
            _STREAMS[self._row["kind"]](self._row, self._sound)
            return self._sound.as_answer()
        except ProbeError as why:
            return {"trouble": why.trouble, "words": why.words}
        except Exception as fault:  # noqa: BLE001 - the other questions go on
            last = traceback.extract_tb(fault.__traceback__)[-1]
            return {"fault": f"{type(fault).__name__}: {fault} ({last.filename}, line {last.lineno})"}


def answer_all(batch: dict[str, Any], tell: Callable[[str, dict[str, Any]], None]) -> None:
    """Run all requests in `questions`, each `after` some earlier ones; report the responses by their keys.

    After `deadline_s`, requests without a response are reported as silent, with the data received so far.
    """
    ends = time.monotonic() + batch["deadline_s"]
    work: list[_AgentRequest] = []
    for row in batch["questions"]:
        work.append(_AgentRequest(row, [work[number] for number in row["after"]], tell))
    for request in work:
        request.start()
    for request in work:
        request.over.wait(max(ends - time.monotonic(), 0.0))
    for request in reversed(work):  # who waits for another one must not begin now
        request.report_timeout()
    end_all()


def main(batch: dict[str, Any]) -> None:
    """Print responses to standard output; stop when nobody reads it any more."""
    lock = threading.Lock()

    def tell(key: str, result: dict[str, Any]) -> None:
        with lock:
            try:
                sys.stdout.write(json.dumps({"key": key, **result}, separators=(",", ":")) + "\n")
                sys.stdout.flush()
            except OSError:
                end_all()
                os._exit(1)

    answer_all(batch, tell)
    os._exit(0)  # threads that hang
