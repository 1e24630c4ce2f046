"""Answer one request a line, until standard input ends: after its start each costs one round trip of the link.

A line is JSON, compressed and in base64, both ways; `MARK` goes before each answer, because shells greet. Requests are
`{"id": …, "do": …, "place": {…}, …}`; answers have its id, and `done`, `refused` (words and a hint), or `broken`.
"""

from __future__ import annotations

import base64
import json
import os
import platform
import signal
import sys
import zlib
from typing import TYPE_CHECKING, Any

from .refused import Refused, in_words
from .vpn_cut import revoke, verify
from .vpn_look import look, seen, sessions
from .vpn_place import Place
from .vpn_put import push
from .vpn_server import Server

if TYPE_CHECKING:
    from typing import Callable

__all__ = ["MARK", "main", "packed", "unpacked"]

MARK = "ATLANTIS-VPN "
_DOES: dict[str, Callable[..., dict[str, Any]]] = {
    "look": look,
    "sessions": sessions,
    "seen": seen,
    "push": push,
    "revoke": revoke,
    "verify": verify,
}


def packed(values: dict[str, Any]) -> bytes:
    """A line without its end."""
    return base64.b64encode(zlib.compress(json.dumps(values, separators=(",", ":")).encode(), 6))


def unpacked(line: bytes) -> dict[str, Any]:
    """What such a line holds. Raises ValueError for one that is torn."""
    try:
        result = json.loads(zlib.decompress(base64.b64decode(line, validate=True)).decode())
    except zlib.error as error:
        raise ValueError(f"a line is torn: {error}") from error
    if not isinstance(result, dict):
        raise ValueError("a line is no request")  # noqa: TRY004 - as any other that is torn
    return result


def main() -> None:
    """Serve. A link that breaks does not stop what was begun."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    _tell({"id": 0, "done": {"python": platform.python_version(), "root": os.geteuid() == 0}})
    for line in iter(sys.stdin.buffer.readline, b""):
        _tell(_answer(line.strip()))


def _answer(line: bytes) -> dict[str, Any]:
    number = None
    try:
        requested = unpacked(line)
        number = requested.pop("id")
        server = Server(Place(**requested.pop("place")))
        return {"id": number, "done": _DOES[requested.pop("do")](server, **requested)}
    except Refused as refused:
        return {"id": number, "refused": refused.message, "hint": refused.hint}
    except OSError as error:
        reply = in_words(error, str(error.filename or "a file"))
        return {"id": number, "refused": reply.message, "hint": reply.hint}
    except Exception as error:  # noqa: BLE001 - whoever asks is told, and goes on asking
        return {"id": number, "broken": f"{type(error).__name__}: {error}"}


def _tell(values: dict[str, Any]) -> None:
    sys.stdout.buffer.write(MARK.encode() + packed(values) + b"\n")
    sys.stdout.buffer.flush()
