"""The emulated computer: the program for each command line, and the DHCP servers of its segments."""

from __future__ import annotations

import json
import socket
import struct
import time
from base64 import b64decode, b64encode
from datetime import UTC, datetime
from hashlib import sha256
from ipaddress import IPv4Address, IPv4Interface
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

from atlantis_netcfg.emulator.linux import _ip, _spec

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence


_NOT_SYNCHRONISED = (
    "00000000,,0,0.000000000,0.000000000,0.000000000,0.000000000,0.000,0.000,0.000,1.000000000,1.000000000,0.0,"
    "Not synchronised\n"
)


def timedatectl(spec: _spec.ComputerSpec, argv: Sequence[str], now: float) -> ProgramOutput:
    """Emulate `timedatectl show`; `now`: seconds since 1970 by its own clock."""
    if list(argv[1:]) != ["show"]:
        return 1, "", f"Unknown command verb {argv[1] if len(argv) > 1 else ''}.\n"
    time = spec.time
    stamp = datetime.fromtimestamp(now, UTC).astimezone(ZoneInfo(time.zone)).strftime("%a %Y-%m-%d %H:%M:%S %Z")
    values = {
        "Timezone": time.zone,
        "LocalRTC": "no",
        "CanNTP": "yes",
        "NTP": "yes" if time.ntp else "no",
        "NTPSynchronized": "yes" if time.is_synchronised else "no",
        "TimeUSec": stamp,
        "RTCTimeUSec": stamp,
    }
    return 0, "".join(f"{name}={value}\n" for name, value in values.items()), ""


def chronyc(spec: _spec.ComputerSpec, argv: Sequence[str], now: float) -> ProgramOutput:
    """Emulate `chronyc -n -c tracking` and `sources`."""
    time = spec.time
    if not time.chrony:
        return 1, "", "506 Cannot talk to daemon\n"
    command = argv[-1]
    if command == "sources":
        mark, reach = ("*", 377) if time.is_synchronised else ("?", 0)
        return 0, f"^,{mark},{time.server},{time.stratum - 1},6,{reach},12,0.000120,0.000120,0.002000000\n", ""
    if command != "tracking":
        return 1, "", "Unrecognized command\n"
    if not time.is_synchronised:
        return 0, _NOT_SYNCHRONISED, ""
    number = "".join(f"{int(part):02X}" for part in time.server.split("."))
    tracking_values = "0.000012345,0.000010000,0.000020000,-11.234,0.001,0.020,0.012000000,0.001000000,64.2"
    return 0, f"{number},{time.server},{time.stratum},{now - 40:.9f},{tracking_values},Normal\n", ""


_WRITER = b"\x00\x01\x00\xc2"


def answers(number: int, spec: _spec.DdsSpec, asked_by: bytes) -> tuple[bytes, ...]:
    """Build the messages of one participant in response to the announcement of a GUID prefix."""
    data = b"\x01\x10" + struct.pack(">HII", spec.domain, 0xA71A, number)
    head = b"RTPS\x02\x01\x01\x10" + data
    to_the_asker = struct.pack("<BBH", 0x0E, 1, 12) + asked_by
    beat = struct.pack("<BBH", 0x07, 1, 28) + b"\0\0\x04\xc7\0\0\x03\xc2" + struct.pack("<iIiIi", 0, 1, 0, 0, 1)
    announcement = _build_announcement(data, spec, 7410 + 250 * spec.domain + 2 * number)
    return (head + to_the_asker + announcement, head + to_the_asker + beat)


def _build_announcement(data: bytes, spec: _spec.DdsSpec, port: int) -> bytes:
    there = [struct.pack("<iI12x", 1, port) + socket.inet_aton(address) for address in spec.addresses]
    result = [
        (0x50, data + b"\x00\x00\x01\xc1"),
        (0x0F, struct.pack("<I", spec.domain)),
        (0x02, struct.pack("<iI", 120, 0)),
        *((0x32, item) for item in there),
        (0x58, struct.pack("<I", 0xFC3F)),
    ]
    parameters = b"".join(struct.pack("<HH", name, len(value)) + value for name, value in result)
    payload = b"\x00\x03\0\0" + parameters + struct.pack("<HH", 1, 0)
    body = struct.pack("<HH", 0, 16) + b"\x00\x01\x00\xc7" + _WRITER + struct.pack("<iI", 0, 1) + payload
    return struct.pack("<BBH", 0x15, 0x05, len(body)) + body


UDP_TABLE = "/proc/net/udp"


def cat(spec: _spec.ComputerSpec, argv: Sequence[str]) -> ProgramOutput:
    """Print files, one after the other."""
    out, err = "", ""
    for path in argv[1:]:
        if path == UDP_TABLE:
            out += _sockets(spec.udp)
        elif path in spec.unreadable_paths:
            err += f"cat: {path}: Permission denied\n"
        elif path in spec.files:
            out += spec.files[path]
        else:
            err += f"cat: {path}: No such file or directory\n"
    return (1 if err else 0), out, err


def _sockets(sockets: Sequence[_spec.UdpSpec]) -> str:
    """Format UDP sockets as `net/ipv4/udp.c` does on a little-endian computer."""
    head = (
        "   sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt"
        "   uid  timeout inode ref pointer drops"
    )
    lines = [
        f"{number:5d}: "
        f"{_reverse_bytes(udp.address)}:{udp.port:04X} 00000000:0000 07 00000000:00000000 00:00000000 00000000 "
        f"{udp.uid:5d}        0 {20000 + number} 2 0000000000000000 0"
        for number, udp in enumerate(sockets, start=1000)
    ]
    return "".join(f"{line:<127}\n" for line in (head, *lines))


def _reverse_bytes(address: str) -> str:
    return IPv4Address(address).packed[::-1].hex().upper()


def openssl(spec: _spec.ComputerSpec, argv: Sequence[str]) -> ProgramOutput:
    """Print all certificates of a file (`storeutl -noout -text -certs PATH`); output and exit code of OpenSSL 3.0."""
    path, command = argv[-1], argv[1] if len(argv) > 1 else ""
    if command != "storeutl":
        return 1, "", f"Invalid command '{command}'; type \"help\" for a list.\n"
    if path in spec.unreadable_paths or path not in spec.certificates:
        reason = "Permission denied" if path in spec.unreadable_paths else "No such file or directory"
        return 1, "", f"Couldn't open file or uri {path}\n0:error:80000002:system library:file_open:{reason}\n"
    certificates = spec.certificates[path]
    text = "".join(f"{number}: Certificate\n{_text(certificate)}" for number, certificate in enumerate(certificates))
    # It knows no key of tls-crypt, says so, and ends with 8 although it has printed the rest.
    return 8, f"{text}Total found: {len(certificates)}\n", "0:error:1608010C:STORE routines::unsupported\n"


def _text(certificate: _spec.CertificateSpec) -> str:
    return (
        "Certificate:\n    Data:\n        Version: 3 (0x2)\n        Serial Number: 4096 (0x1000)\n"
        "        Signature Algorithm: ecdsa-with-SHA256\n"
        f"        Issuer: CN={certificate.issuer}\n"
        "        Validity\n"
        f"            Not Before: {_stamp(certificate.not_before)}\n"
        f"            Not After : {_stamp(certificate.not_after)}\n"
        f"        Subject: CN={certificate.subject}\n"
        "        Subject Public Key Info:\n            Public Key Algorithm: id-ecPublicKey\n"
    )


def _stamp(moment: datetime) -> str:
    return f"{moment:%b} {moment.day:2d} {moment:%H:%M:%S %Y} GMT"


def uname(spec: _spec.ComputerSpec, argv: Sequence[str]) -> ProgramOutput:
    """Print name, release and machine of the kernel (`-s`, `-n`, `-r`, `-m`); output of coreutils 9."""
    fields = {"s": "Linux", "n": spec.name, "r": spec.kernel, "m": spec.machine}
    options = [word.removeprefix("-") for word in argv[1:] if word.startswith("-")]
    extra = next((word for word in argv[1:] if not word.startswith("-")), None)
    odd = next((letter for letter in "".join(options) if letter not in fields), None)
    if extra is not None or odd is not None:
        reason = f"invalid option -- '{odd}'" if odd is not None else f"extra operand '{extra}'"
        return 1, "", f"uname: {reason}\nTry 'uname --help' for more information.\n"
    requested_fields = set("".join(options)) or {"s"}
    return 0, " ".join(value for letter, value in fields.items() if letter in requested_fields) + "\n", ""


def ssh_keygen(spec: _spec.ComputerSpec, argv: Sequence[str]) -> ProgramOutput:
    """Print the fingerprint of an Ed25519 public key (`-l -f PATH`); output and exit code of OpenSSH 9."""
    if list(argv[1:3]) != ["-l", "-f"] or len(argv) != 4:  # noqa: PLR2004 - the program and three words
        return 1, "", "Too many arguments.\r\n"
    path = argv[3]
    if path in spec.unreadable_paths or path not in spec.files:
        reason = "Permission denied" if path in spec.unreadable_paths else "No such file or directory"
        return 255, "", f"ssh-keygen: {path}: {reason}\r\n"
    kind, _, rest = spec.files[path].strip().partition(" ")
    key, _, comment = rest.partition(" ")
    if kind != "ssh-ed25519":
        return 255, "", f"{path} is not a public key file.\r\n"
    digest = b64encode(sha256(b64decode(key)).digest()).decode().rstrip("=")
    return 0, f"256 SHA256:{digest} {comment or 'no comment'} (ED25519)\n", ""


def dpkg_query(spec: _spec.ComputerSpec, argv: Sequence[str]) -> ProgramOutput:
    """Print installed packages by name, no patterns (`-W -f=FORMAT NAME…`); output and codes of dpkg 1.21."""
    if len(argv) < 2 or argv[1] != "-W":  # noqa: PLR2004 - the program and its action
        reason = f"unknown option {argv[1]}" if len(argv) > 1 else "need an action option"
        return 2, "", f"dpkg-query: error: {reason}\n\nUse --help for help about querying packages.\n"
    layout = next((word.removeprefix("-f=") for word in argv[2:] if word.startswith("-f=")), _PACKAGE_LINE)
    names = [word for word in argv[2:] if not word.startswith("-")]
    out = "".join(
        layout.replace("${Package}", name)
        .replace("${Version}", spec.packages[name])
        .replace("${db:Status-Status}", "installed")
        .replace("\\n", "\n")
        .replace("\\t", "\t")
        for name in sorted(spec.packages)
        if name in names or not names
    )
    err = "".join(f"dpkg-query: no packages found matching {name}\n" for name in names if name not in spec.packages)
    return (1 if err else 0), out, err


_PACKAGE_LINE = r"${Package}\t${Version}\n"
"""Default output format of dpkg-query."""
ProgramOutput = tuple[int, str, str]
NOT_FOUND = 127
"""Exit code of a shell for a program that does not exist (POSIX, 2.8.2)."""


class Computer:
    """Emulated computer without sockets or processes; its interface is the command line, as for SSH."""

    def __init__(self, spec: _spec.ComputerSpec, clock: Callable[[], float] = time.time) -> None:
        self.spec = spec
        """Specification; may be replaced at any time and applies from the next response on."""
        self.inputs: list[tuple[str, ...]] = []
        """All command lines received."""
        self._clock = clock

    @property
    def now(self) -> float:
        """Seconds since 1970 by its own clock."""
        return self._clock() + self.spec.time.offset_s

    def answer(self, argv: Sequence[str]) -> ProgramOutput:
        """Run a command line: exit code, output, error output; 127 for a missing program."""
        self.inputs.append(tuple(argv))
        program = argv[0] if argv else ""
        if program in self.spec.lacks or program not in _PROGRAMS:
            return NOT_FOUND, "", f"sh: 1: {program}: not found\n"
        return _PROGRAMS[program](self, argv)

    def offers(self, interface: str, cards: Sequence[str] = ()) -> tuple[_spec.OfferSpec, ...] | None:
        """Return the DHCP offers on an interface (name or address); None: no such interface.

        The requests use the MAC addresses of the interface and of `cards`, and an unknown one.
        """
        item = self._segment_interface(interface)
        if item is None:
            return None
        requested_cards = {card.lower() for card in (item.mac or "", *cards)}
        there = self.spec.dhcp.get(item.name, ()) if item.up else ()
        return tuple(
            server for server in there if not server.knows or requested_cards & {card.lower() for card in server.knows}
        )

    def routers(self, interface: str) -> tuple[_spec.AdvertisementSpec, ...] | None:
        """Return the router advertisements on an interface, named as for `offers`; None: no such interface."""
        item = self._segment_interface(interface)
        if item is None:
            return None
        return self.spec.routers.get(item.name, ()) if item.up else ()

    def _segment_interface(self, word: str) -> _spec.InterfaceSpec | None:
        """Return the interface with this name or address."""
        item = self.spec.interface(word)
        return self.spec.holding(word) if item is None and word[:1].isdigit() else item

    def participants(self, domain: int, address: str, asked_by: bytes) -> tuple[tuple[str, bytes], ...] | None:
        """Return address and messages of the DDS participants that respond to an announcement.

        None: no interface has this address.
        """
        if self.spec.holding(address) is None:
            return None
        there = [item for item in self.spec.dds if item.domain == domain]
        return tuple(
            (address, message) for number, dds in enumerate(there) for message in answers(number, dds, asked_by)
        )

    def reflect(
        self, source: str, address: str, tokens: Sequence[str]
    ) -> tuple[tuple[str, str, float, bytes], ...] | None:
        """Return sender, interface, delay in seconds and text of each response to messages with these tokens.

        None: no interface has the source address. Each response says that it is emulated.
        """
        interface, way, there = self.spec.holding(source), self.spec.towards(address), self.spec.reflectors.get(address)
        if interface is None:
            return None
        if way is None or there is None:
            return ()
        delivered_tokens = [
            token for number, token in enumerate(tokens, start=1) if not _ip.is_lost(number, there.loss_percent)
        ]
        rows = {"host": there.host, "from": source, "to": address, "by": there.arrives_by, "emulated": True}
        texts = (json.dumps({"token": token, **rows}).encode() for token in delivered_tokens)
        return tuple((address, way[0], there.rtt_ms / 1000, text) for text in texts)


_PROGRAMS: dict[str, Callable[[Computer, Sequence[str]], ProgramOutput]] = {
    "cat": lambda computer, argv: cat(computer.spec, argv),
    "chronyc": lambda computer, argv: chronyc(computer.spec, argv, computer.now),
    "dpkg-query": lambda computer, argv: dpkg_query(computer.spec, argv),
    "ip": lambda computer, argv: _ip.ip(computer.spec, argv),
    "iw": lambda computer, argv: _ip.iw(computer.spec, argv),
    "openssl": lambda computer, argv: openssl(computer.spec, argv),
    "ping": lambda computer, argv: _ip.ping(computer.spec, argv),
    "ssh-keygen": lambda computer, argv: ssh_keygen(computer.spec, argv),
    "timedatectl": lambda computer, argv: timedatectl(computer.spec, argv, computer.now),
    "uname": lambda computer, argv: uname(computer.spec, argv),
}

_CARD = "02:00:5E:00:FA:01"
"""MAC address that no real device has."""


def lan_computer(  # noqa: PLR0913 - each is one value of an inventory
    name: str,
    *,
    address: str,
    mac: str | None,
    router: tuple[str, str],
    others: Mapping[str, str],
    tunnel: str | None = None,
    server: str | None = None,
    interface: str = "eth0",
) -> _spec.ComputerSpec:
    """Build a computer on a LAN, on which all addresses respond to pings.

    `address` has a prefix length; `router` and `others`: address and MAC; `tunnel`: own VPN address.
    `mac`: None if the inventory has none; `server`: address of the VPN server in the tunnel. Only the router offers
    addresses.
    """
    there = {router[0]: router[1], **others}
    interfaces = [
        _spec.InterfaceSpec(name=interface, mac=mac or _CARD, addresses=(_spec.AddressSpec(address=address),))
    ]
    echoes = dict.fromkeys(there, _spec.EchoSpec())
    if tunnel is not None:
        interfaces.append(_spec.InterfaceSpec(name="tun0", addresses=(_spec.AddressSpec(address=tunnel),)))
    if server is not None:
        echoes[server] = _spec.EchoSpec(rtt_ms=62.0)
    first = IPv4Interface(address).network.network_address + 100
    return _spec.ComputerSpec(
        name=name,
        interfaces=tuple(interfaces),
        routes=(_spec.RouteSpec(via=router[0], dev=interface),),
        neighbours=tuple(_spec.NeighbourSpec(address=ip, dev=interface, mac=card) for ip, card in there.items()),
        echoes=echoes,
        files={"/etc/resolv.conf": f"nameserver {router[0]}\n"},
        dhcp={interface: (_spec.OfferSpec(server=router[0], mac=router[1], address=str(first), router=router[0]),)},
    )
