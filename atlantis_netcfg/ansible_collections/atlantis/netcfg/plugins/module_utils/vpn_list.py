"""The list of revoked certificates, as `openssl crl` reads it: what OpenVPN would take, it is asked for beforehand.

OpenVPN fails open on a list of another authority, and locks everybody out with one that is early, expired or cut.
"""

from __future__ import annotations

import base64
import calendar
import re
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .refused import Refused

if TYPE_CHECKING:
    from typing import Callable

    from .programs import Done

__all__ = ["Crl", "accept", "number", "read"]

_PEM = re.compile(rb"-----BEGIN X509 CRL-----(.*?)-----END X509 CRL-----", re.DOTALL)
_NUMBER = re.compile(rb"\x06\x03\x55\x1d\x14\x04(.)\x02(.)", re.DOTALL)
"""The extension cRLNumber (RFC 5280, 5.2.3): its name 2.5.29.20, and an octet string that holds an integer."""
_HINT = "`provision vpn status` tells what is wrong with the authority's own list"


@dataclass(frozen=True)
class Crl:
    """What a list says; times in seconds since 1970."""

    number: int
    begins: int
    ends: int
    signed: bool
    """By the authority that this server takes its members from."""


def read(path: str, ca: str, run: Callable[[list[str]], Done]) -> Crl | None:
    """Read a list; None: it is no list, or none is there."""
    words = ["openssl", "crl", "-in", path, "-noout", "-crlnumber", "-lastupdate", "-nextupdate"]
    done = run([*words, "-verify", "-CAfile", ca])
    if done.code != 0:  # it has not even found the issuer's certificate
        done = run(words)
    told = dict(line.split("=", 1) for line in done.said.splitlines() if "=" in line)
    try:
        number = int(told["crlNumber"], 16)
        begins, ends = (_seconds(told[name]) for name in ("lastUpdate", "nextUpdate"))
    except (KeyError, ValueError):
        return None
    return Crl(number, begins, ends, "verify OK" in done.said.splitlines())


def number(pem: bytes) -> int | None:
    """The number of a list without asking OpenSSL, which takes 6 ms; None: it is not found so simply."""
    text = _PEM.search(pem)
    try:
        der = base64.b64decode(b"".join(text[1].split()), validate=True) if text else b""
    except ValueError:
        return None
    found = _NUMBER.search(der)
    if found is None or ord(found[1]) != ord(found[2]) + 2:
        return None
    return int.from_bytes(der[found.end() : found.end() + ord(found[2])], "big", signed=True)


def accept(new: Crl | None, old: Crl | None, now: float) -> Crl:
    """Refuse a list that must not take the place of another one; the same number is the same list again."""
    if new is None:
        raise Refused("the new list of revoked certificates cannot be read", _HINT)
    if not new.signed:
        raise Refused(
            "the new list of revoked certificates is of another authority than this server: OpenVPN would let every "
            "revoked member in",
            "the server was set up by another authority: `provision site=…` brings this one's",
        )
    if old is not None and old.signed and new.number < old.number:
        raise Refused(
            f"the new list of revoked certificates has number {new.number}, and the server has number {old.number}",
            "this is not the newest copy of the authority: find the one with which list "
            f"{old.number} was made; with an older one a revoked member would come back",
        )
    if new.begins > now:
        raise Refused(
            f"by the server's clock ({_words(now)}) the new list of revoked certificates is not valid yet: nobody "
            "could connect any more",
            "set the clocks right: `date` on both computers, `timedatectl` on the server",
        )
    if new.ends <= now:
        raise Refused(
            f"by the server's clock ({_words(now)}) the new list of revoked certificates has expired: nobody could "
            "connect any more",
            "`date` on the server; if it is right, `provision vpn sync --sign` signs a new list",
        )
    return new


def _seconds(told: str) -> int:
    """As OpenSSL prints a time: Nov 22 06:46:31 2026 GMT."""
    return calendar.timegm(time.strptime(told.strip(), "%b %d %H:%M:%S %Y GMT"))


def _words(now: float) -> str:
    return time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(now))
