"""The list of revoked certificates, as `openssl crl` reads it: what OpenVPN would take, it is asked for beforehand.

OpenVPN fails open on a list of another authority, and locks everybody out with one that is early, expired or cut.
"""

from __future__ import annotations

import calendar
import re
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .refused import Refused

if TYPE_CHECKING:
    from typing import Callable

    from .programs import Done

__all__ = ["Crl", "accept", "read"]

_SERIAL = re.compile(r"^ +Serial Number: ([0-9A-F]+)$", re.MULTILINE)
_HINT = "`provision vpn status` tells what is wrong with the authority's own list"


@dataclass(frozen=True)
class Crl:
    """What a list says; times in seconds since 1970."""

    number: int
    begins: int
    ends: int
    signed: bool
    """By the authority that this server takes its members from."""
    serials: frozenset[str] = frozenset()
    """Of the revoked certificates, in hex."""


def read(path: str, ca: str, run: Callable[[list[str]], Done]) -> Crl | None:
    """Read a list; None: it is no list, or none is there."""
    words = ["openssl", "crl", "-in", path, "-noout", "-text", "-crlnumber", "-lastupdate", "-nextupdate"]
    done = run([*words, "-verify", "-CAfile", ca])
    if done.code != 0:  # it has not even found the issuer's certificate
        done = run(words)
    values = dict(line.split("=", 1) for line in done.output.splitlines() if "=" in line)
    try:
        number = int(values["crlNumber"], 16)
        begins, ends = (_seconds(values[name]) for name in ("lastUpdate", "nextUpdate"))
    except (KeyError, ValueError):
        return None
    return Crl(number, begins, ends, "verify OK" in done.output.splitlines(), frozenset(_SERIAL.findall(done.output)))


def accept(new: Crl | None, old: Crl | None, now: float) -> Crl:
    """Refuse a list that must not take the place of another one: it may not be older, nor of another branch.

    A restored older copy of the authority gives out the numbers of the lists that it does not know a second time.
    """
    if new is None:
        raise Refused("the new list of revoked certificates cannot be read", _HINT)
    if not new.signed:
        raise Refused(
            "the new list of revoked certificates is of another authority than this server: OpenVPN would let every "
            "revoked member in",
            "the server was set up by another authority: `provision site=…` brings this one's",
        )
    if old is not None and old.signed and new != old:
        _follow(new, old)
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


def _follow(new: Crl, old: Crl) -> None:
    lost = len(old.serials - new.serials)
    if new.number > old.number and not lost:
        return
    why = f"has number {new.number}, and the server has number {old.number}"
    if new.number == old.number:
        why = f"has number {new.number}, as the server's, and is another one"
    elif new.number > old.number:
        why = f"lacks {lost} of the certificates that are revoked on the server"
    raise Refused(
        f"the new list of revoked certificates {why}: with it a revoked member would come back",
        f"this is not the newest copy of the authority: find the one with which list {old.number} was made; "
        "`provision vpn status` tells what the server knows beyond this one, and what to do if that copy is lost",
    )


def _seconds(text: str) -> int:
    """As OpenSSL prints a time: Nov 22 06:46:31 2026 GMT."""
    return calendar.timegm(time.strptime(text.strip(), "%b %d %H:%M:%S %Y GMT"))


def _words(now: float) -> str:
    return time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(now))
