"""`cat`, the kernel's table of UDP sockets, and what `openssl x509` says of a certificate."""

from __future__ import annotations

from ipaddress import IPv4Address
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import datetime

    from atlantis_netcfg.twin.computer._spec import ComputerSpec, UdpSpec

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
    head = "   sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode ref pointer drops"
    lines = [
        f"{number:5d}: {_reversed(one.address)}:{one.port:04X} 00000000:0000 07 00000000:00000000 00:00000000 00000000 "
        f"{one.uid:5d}        0 {20000 + number} 2 0000000000000000 0"
        for number, one in enumerate(sockets, start=1000)
    ]
    return "".join(f"{line:<127}\n" for line in (head, *lines))


def _reversed(address: str) -> str:
    return IPv4Address(address).packed[::-1].hex().upper()


def openssl(spec: ComputerSpec, argv: Sequence[str]) -> Printed:
    """Print subject and validity of the first certificate in a file (`x509 -noout -subject -dates -in PATH`)."""
    path = argv[-1]
    found = spec.certificates.get(path)
    if path in spec.denied:
        return 1, "", f"Can't open {path} for reading, Permission denied\n"
    if found is None:
        return 1, "", f"Can't open {path} for reading, No such file or directory\n"
    lines = {
        "-subject": f"subject=CN = {found.subject}\n",
        "-issuer": f"issuer=CN = {found.issuer}\n",
        "-dates": f"notBefore={_stamp(found.not_before)}\nnotAfter={_stamp(found.not_after)}\n",
    }
    return 0, "".join(lines.get(word, "") for word in argv), ""


def _stamp(moment: datetime) -> str:
    return f"{moment:%b} {moment.day:2d} {moment:%H:%M:%S %Y} GMT"
