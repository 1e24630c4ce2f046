"""What every way of asking shares: why there is no answer, and what was heard so far."""

from __future__ import annotations

import errno
import time
from base64 import b64encode
from typing import Any

__all__ = ["NoAnswer", "Sound", "no_answer", "packed"]

_BY_NUMBER = {
    errno.ECONNREFUSED: "refused",
    errno.ETIMEDOUT: "silent",
    errno.EHOSTUNREACH: "unreachable",
    errno.ENETUNREACH: "unreachable",
    errno.ENETDOWN: "unreachable",
    errno.EADDRNOTAVAIL: "unreachable",
    errno.EADDRINUSE: "busy",
    errno.EBUSY: "busy",
    errno.ENOENT: "missing",
    errno.ENODEV: "missing",
    errno.ENXIO: "missing",
    errno.ENOTTY: "missing",
    errno.ENOEXEC: "missing",
    errno.EACCES: "denied",
    errno.EPERM: "denied",
}
"""The system's error to the value of `Trouble`."""
_PLAIN = frozenset(range(0x20, 0x7F)) - {*b'"\\'}
"""What JSON writes as one byte."""


class NoAnswer(Exception):
    """There is no answer; `trouble` is a value of `Trouble`."""

    def __init__(self, trouble: str, words: str) -> None:
        super().__init__(words)
        self.trouble = trouble
        self.words = words


def no_answer(error: OSError, what: str) -> NoAnswer:
    """Put the system's error into a trouble; what nobody foresaw proves nothing: unreachable."""
    words = error.strerror or str(error) or type(error).__name__
    return NoAnswer(_BY_NUMBER.get(error.errno or 0, "unreachable"), f"{what}: {words}")


def packed(data: bytes) -> Any:  # noqa: ANN401 - JSON: a text, or a list of one
    """Bytes for JSON in the shorter of two ways: text in Latin-1, which SSH compresses best, or `[base64]`."""
    text = data.decode("latin-1")
    escaped = sum(byte not in _PLAIN for byte in data)
    return text if escaped * 4 <= len(data) else [b64encode(data).decode()]


class Sound:
    """What was heard on a stream, also by whoever has to stop before its end."""

    def __init__(self, max_bytes: int) -> None:
        self.began = time.time()
        self.chunks: list[tuple[float, bytes]] = []
        self.senders: list[str] = []
        self.data = bytearray()
        self.closed = False
        self.words = ""
        self.trouble: str | None = None
        self._zero = time.monotonic()
        self._left = max_bytes

    @property
    def seconds(self) -> float:
        """Since it began."""
        return time.monotonic() - self._zero

    @property
    def full(self) -> bool:
        """Whether no more is kept."""
        return self._left <= 0

    def add(self, data: bytes, sender: str = "") -> None:
        """Keep what came now, as far as there is room; `sender`: address that a datagram came from."""
        kept = data[: self._left]
        self._left -= len(kept)
        if kept:
            self.chunks.append((round(self.seconds, 3), kept))
            self.senders += [sender] if sender else []
            self.data += kept
        if self.full:
            self.words = f"cut after {len(self.data)} bytes"

    def as_answer(self) -> dict[str, Any]:
        """The fields of `Transcript`."""
        return {
            "trouble": self.trouble,
            "words": self.words,
            "chunks": [[at, packed(data)] for at, data in self.chunks],
            **({"senders": self.senders} if self.senders else {}),
            "began": self.began,
            "ended_s": round(self.seconds, 3),
        }
