"""Parser for an EvoLogics S2C modem: frames, bare lines, settings, states and fixes (devices.md 5.1).

In data mode responses are `+++AT?S:<length>:<answer>` and notifications `+++AT:<length>:<text>`; the length counts
bytes, which may have any content: NUL, line ends, another frame. Bare lines and raw data of a connection may be in
between. Input that is not recognised is skipped, and nothing here raises.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

NOTIFICATION = "AT"
"""Command name of an unsolicited piece."""

_HEADER = re.compile(rb"\+\+\+(AT[^:\r\n]{0,90}):(\d{1,6}):")
_LONGEST = 65_536
_FAMILIES = rb"RECV|SEND|BITRATE|SRCLEVEL|PHY|USBL|DELIVERED|FAILED|CANCELED|EXPIRED|RADDR"  # role_at.erl of EVINS, BIR
_BARE = rb"(?:\A|\n)(?!\+\+\+AT|" + _FAMILIES + rb")[^\r\n]+\r?\n"
"""A line that may be a response in the bare form, without a frame."""
_STATES = re.compile(
    r"\b(OFFLINE (?:READY|CONNECTION FAILED|TERMINATED|ALARM)|INITIATION (?:LISTEN|ESTABLISH|DISCONNECT)"
    r"|ONLINE|BACKOFF|NOISE|DEAF)\b"
)
_SETTING = re.compile(r"(\[\*\])?([A-Z][A-Za-z ]*): (-?\d{1,9})")
_NAMES = frozenset(
    (
        *("Source Level", "Source Level Control", "Gain", "Carrier Waveform ID", "Local Address", "Highest Address"),
        *("Cluster Size", "Packet Time", "Retry Count", "Retry Timeout", "Wake Up Active Time", "Wake Up Period"),
        *("Promiscuous Mode", "Sound Speed", "IM Retry Count", "Pool Size", "Hold Timeout", "Idle Timeout"),
    )
)


@dataclass(frozen=True, slots=True)
class Piece:
    """A frame or a bare line of the modem's output."""

    command: str | None
    """Command that it responds to: `AT?S`; NOTIFICATION: no command; None: a bare line."""
    body: bytes
    end: int
    """Offset of its end in the stream."""

    @property
    def text(self) -> str:
        """Body as text; bytes that are not ASCII become replacement characters."""
        return self.body.decode("ascii", "replace").strip()


@dataclass(frozen=True, slots=True)
class EvologicsSettings:
    """Settings reported by `AT&V`; unknown names are left out."""

    values: Mapping[str, int]
    """Values by names of firmware 1.9: `IM Retry Count`, also where the modem writes `Rerty`."""
    pending: tuple[str, ...]
    """Settings that were changed but are not in force yet, marked `[*]`."""


@dataclass(frozen=True, slots=True)
class EvologicsFix:
    """A position fix: one USBLLONG, or one USBLANGLES (without a position)."""

    remote: int
    clock_s: float
    """Modem clock when it reports the fix: seconds since it was switched on, or since 1970."""
    measured_s: float
    """Modem clock at the time of the measurement."""
    position_m: tuple[float, float, float] | None
    propagation_us: float | None
    """One-way propagation time."""
    rssi_db: float
    integrity: float
    accuracy: float
    end: int
    """Offset of its end in the stream."""


def pieces(data: bytes) -> tuple[Piece, ...]:
    """Return all complete pieces of a stream, in order; the content of a frame is never parsed as a piece."""
    return tuple(_pieces(data))


def _pieces(data: bytes) -> Iterator[Piece]:
    begin = look = 0
    while header := _HEADER.search(data, look):
        end = header.end() + int(header[2])
        if int(header[2]) > _LONGEST or (len(data) >= end + 2 and data[end : end + 2] != b"\r\n"):
            # Its length does not lead to a line's end: no frame, but text that looks like one.
            look = header.start() + 1
            continue
        yield from _lines(data, begin, header.start())
        if len(data) < end + 2:
            return
        yield Piece(header[1].decode("ascii", "replace"), data[header.end() : end], end + 2)
        begin = look = end + 2
    yield from _lines(data, begin, len(data))


def _lines(data: bytes, begin: int, end: int) -> Iterator[Piece]:
    """Yield complete bare lines; a truncated line could be misread."""
    while (stop := data.find(b"\n", begin, end)) >= 0:
        if line := data[begin:stop].strip(b"\r"):
            yield Piece(None, line, stop + 1)
        begin = stop + 1


def answer(replies: Sequence[Piece], command: str) -> str | None:
    """Return the last framed response to a command; None if there is none, or for ERROR or BUSY."""
    text = _last(replies, command)
    return None if text is None or text.startswith(("ERROR", "BUSY")) else text


def trouble_words(replies: Sequence[Piece], command: str) -> str | None:
    """Return `ERROR …` or `BUSY …` in response to a command, or a bare one for any command."""
    bare = next(
        (piece.text for piece in replies if piece.command is None and piece.text.startswith(("ERROR", "BUSY"))), None
    )
    text = _last(replies, command) or bare
    return text if text and text.startswith(("ERROR", "BUSY")) else None


def _last(replies: Sequence[Piece], command: str) -> str | None:
    # The answer to a command with parameters names it with or without them.
    return next((p.text for p in reversed(replies) if p.command and p.command.partition(",")[0] == command), None)


def number(text: str | None) -> float | None:
    """Return the number at the start of a response, also if a change of it is pending; None if unknown."""
    match = re.match(r"(?:\[\*\])?(-?\d{1,15}(?:\.\d{1,15})?)(?:$|[\s,])", text or "")
    return float(match[1]) if match else None


def state(replies: Sequence[Piece]) -> str | None:
    """Return the state's text, also if it is unknown; None if it was not reported."""
    text = answer(replies, "AT?S")
    if text is not None:
        match = _STATES.search(text)
        return match[1] if match else text[:60]
    bare = (_STATES.match(p.text.removeprefix("+++")) for p in reversed(replies) if p.command is None)
    return next((match[1] for match in bare if match), None)


def settings(replies: Sequence[Piece]) -> EvologicsSettings | None:
    """Return all known settings reported by `AT&V`, framed or bare; None if there are none."""
    text = answer(replies, "AT&V") or "\n".join(p.text for p in replies if p.command is None)
    matches = [_SETTING.fullmatch(line.strip()) for line in text.splitlines()]
    name_matches = [(match[2].replace("Rerty", "Retry"), match) for match in matches if match]
    known_settings = [(name, match) for name, match in name_matches if name in _NAMES]
    if not known_settings:
        return None
    return EvologicsSettings(
        {name: int(entry[3]) for name, entry in known_settings}, tuple(name for name, item in known_settings if item[1])
    )


def fixes(replies: Sequence[Piece]) -> tuple[EvologicsFix, ...]:
    """Return every reported fix, framed or bare, in order."""
    result = (p for p in replies if p.command in {NOTIFICATION, None})
    return tuple(fix for fix in map(_fix, result) if fix)


def _fix(piece: Piece) -> EvologicsFix | None:
    keyword, *fields = piece.text.split(",")
    if (keyword, len(fields)) not in {("USBLLONG", 16), ("USBLANGLES", 13)}:
        return None
    try:
        values = [float(field) for field in fields]
    except ValueError:
        return None
    if not all(map(math.isfinite, values)) or not values[2].is_integer():
        return None
    whole = keyword == "USBLLONG"
    return EvologicsFix(
        remote=int(values[2]),
        clock_s=values[0],
        measured_s=values[1],
        position_m=(values[3], values[4], values[5]) if whole else None,
        propagation_us=values[12] if whole else None,
        rssi_db=values[-3],
        integrity=values[-2],
        accuracy=values[-1],
        end=piece.end,
    )


def reply_pattern(query: str) -> bytes:
    """Return a regular expression for the response to a query, framed or bare, also ERROR and BUSY."""
    if query == "AT&V":
        return rb"\+\+\+AT&V:\d+:(?:ERROR|BUSY)[^\n]*\n|(?:\A|\n)(?:ERROR|BUSY)[^\n]*\n|: [^\r\n]*\r?\n\r?\n"
    return rb"\+\+\+" + re.escape(query.encode()) + rb":\d+:[^\n]*\n|" + _BARE
