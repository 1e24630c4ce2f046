"""`cat`, the kernel's table of UDP sockets, and what `openssl storeutl` says of the certificates in a file."""

from __future__ import annotations

from ipaddress import IPv4Address
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import datetime

    from atlantis_netcfg.emulator.linux._spec import CertificateSpec, ComputerSpec, UdpSpec

__all__ = ["cat", "openssl"]

Printed = tuple[int, str, str]
UDP_TABLE = "/proc/net/udp"


def cat(spec: ComputerSpec, argv: Sequence[str]) -> Printed:
    """Print files, one after the other."""
    out, err = "", ""
    for path in argv[1:]:
        if path == UDP_TABLE:
            out += _sockets(spec.udp)
        elif path in spec.denied:
            err += f"cat: {path}: Permission denied\n"
        elif path in spec.files:
            out += spec.files[path]
        else:
            err += f"cat: {path}: No such file or directory\n"
    return (1 if err else 0), out, err


def _sockets(sockets: Sequence[UdpSpec]) -> str:
    """As `net/ipv4/udp.c` prints them, on a computer whose lowest byte comes first."""
    head = (
        "   sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt"
        "   uid  timeout inode ref pointer drops"
    )
    lines = [
        f"{number:5d}: {_reversed(one.address)}:{one.port:04X} 00000000:0000 07 00000000:00000000 00:00000000 00000000 "
        f"{one.uid:5d}        0 {20000 + number} 2 0000000000000000 0"
        for number, one in enumerate(sockets, start=1000)
    ]
    return "".join(f"{line:<127}\n" for line in (head, *lines))


def _reversed(address: str) -> str:
    return IPv4Address(address).packed[::-1].hex().upper()


def openssl(spec: ComputerSpec, argv: Sequence[str]) -> Printed:
    """Print every certificate in a file (`storeutl -noout -text -certs PATH`); words and code of OpenSSL 3.0."""
    path, command = argv[-1], argv[1] if len(argv) > 1 else ""
    if command != "storeutl":
        return 1, "", f"Invalid command '{command}'; type \"help\" for a list.\n"
    if path in spec.denied or path not in spec.certificates:
        reason = "Permission denied" if path in spec.denied else "No such file or directory"
        return 1, "", f"Couldn't open file or uri {path}\n0:error:80000002:system library:file_open:{reason}\n"
    found = spec.certificates[path]
    told = "".join(f"{number}: Certificate\n{_text(one)}" for number, one in enumerate(found))
    # It knows no key of tls-crypt, says so, and ends with 8 although it has printed the rest.
    return 8, f"{told}Total found: {len(found)}\n", "0:error:1608010C:STORE routines::unsupported\n"


def _text(one: CertificateSpec) -> str:
    return (
        "Certificate:\n    Data:\n        Version: 3 (0x2)\n        Serial Number: 4096 (0x1000)\n"
        "        Signature Algorithm: ecdsa-with-SHA256\n"
        f"        Issuer: CN={one.issuer}\n"
        "        Validity\n"
        f"            Not Before: {_stamp(one.not_before)}\n"
        f"            Not After : {_stamp(one.not_after)}\n"
        f"        Subject: CN={one.subject}\n"
        "        Subject Public Key Info:\n            Public Key Algorithm: id-ecPublicKey\n"
    )


def _stamp(moment: datetime) -> str:
    return f"{moment:%b} {moment.day:2d} {moment:%H:%M:%S %Y} GMT"
