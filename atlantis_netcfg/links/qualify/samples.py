"""Raw samples as JSON Lines: appended as they arrive, never rewritten; every figure is computed from them.

Times named `_at_ns` are on the sender's monotonic clock since the beginning of the run; those named `_ns` are since
1970 on the clock of the computer that recorded them. If the last line of a file was cut off, it is ignored.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Final, TextIO

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

VERSION: Final = 1


class SamplesUnreadable(UsageError, ValueError):
    """A line of a sample file was not written by this version."""


@dataclass(frozen=True, slots=True)
class TrainBegan:
    """The beginning of a train of test packets; its samples have the same `stream`."""

    stream: str
    begin_at_ns: int
    begin_ns: int
    size: int
    """UDP payload of each packet."""
    interval_s: float
    duration_s: float
    timeout_s: float
    """Timeout in seconds; a later response counts as late."""
    headers: int
    authenticated: bool
    synchronised: bool
    """Whether this computer's clock is synchronised."""
    version: int = VERSION


@dataclass(frozen=True, slots=True)
class PacketSent:
    """A test packet was sent; `error`: it was not, for this reason."""

    stream: str
    sequence: int
    sent_at_ns: int
    error: str = ""


@dataclass(frozen=True, slots=True)
class ReplySample:
    """A response arrived; a second one for the same packet is a duplicate."""

    stream: str
    sequence: int
    arrived_at_ns: int
    reflector_sequence: int
    received_ns: int
    """Time at which the reflector received the request, on its clock."""
    replied_ns: int
    size: int
    ttl: int
    """TTL of the response on arrival."""
    reflector_error: int
    """Error estimate of the reflector's clock, as 16 bits."""


@dataclass(frozen=True, slots=True)
class CounterSample:
    """The reflector's counters for a train, read after its end."""

    stream: str
    received: int
    duplicates: int
    limited: int
    answered: int


class MessageDirection(StrEnum):
    """The direction of a message."""

    UP = "up"
    """From this computer to the far end."""
    DOWN = "down"


@dataclass(frozen=True, slots=True)
class MessageResult:
    """The result of sending one message in chunks; for direction down, the receiver is this computer."""

    stream: str
    message: int
    size: int
    chunks: int
    chunks_sent: int
    """Number of sent chunks, including repetitions and status requests. Down: number of requested chunks."""
    sent_at_ns: int
    """Time of sending. Down: when the request was sent."""
    acknowledged_at_ns: int | None
    """When the receiver acknowledged the whole message; None: never. Down: when the last octet arrived."""
    received_size: int | None
    """Octets that the receiver reported last; None: no report. Down: None if nothing arrived for an unknown reason."""
    first_ns: int | None
    last_ns: int | None
    in_flight: bool
    """The run ended before the message's timeout: it counts neither as received nor as lost."""
    direction: str = MessageDirection.UP
    chunk_size: int | None = None
    """Octets of each chunk but the last; None: written by a version without this field."""
    far_rate_bps: float | None = None
    """Down: maximum rate of the far end to this computer; no link can show more."""
    due_ns: int | None = None
    """Interval to the next message by rate and pace of the plan; None: written by a version without this field."""
    far_sent_ns: int | None = None
    """Down: time at which the far end sent its first octet, on the far end's clock."""


@dataclass(frozen=True, slots=True)
class StreamEnd:
    """The end of a stream, and why: `done`, `stopped`, or the limit of the budget."""

    stream: str
    ended_at_ns: int
    reason: str


Sample = TrainBegan | PacketSent | ReplySample | CounterSample | MessageResult | StreamEnd
_KINDS: Final[dict[str, type[Sample]]] = {
    "train": TrainBegan,
    "sent": PacketSent,
    "reply": ReplySample,
    "counted": CounterSample,
    "message": MessageResult,
    "end": StreamEnd,
}
_NAMES: Final = {kind: name for name, kind in _KINDS.items()}


class SampleWriter:
    """A writer that appends samples to an open file."""

    def __init__(self, file: TextIO) -> None:
        self._file = file

    def __call__(self, sample: Sample) -> None:
        """Write a sample and flush it."""
        line: dict[str, Any] = {"kind": _NAMES[type(sample)], **asdict(sample)}
        self._file.write(json.dumps(line, separators=(",", ":")) + "\n")
        self._file.flush()


def read(lines: Iterable[str], name: str = "samples") -> Iterator[Sample]:
    """Read lines of a sample file; raise SamplesUnreadable, with the line number, if a line is invalid."""
    for number, line in enumerate(lines, start=1):
        if not line.endswith("\n"):
            return
        try:
            data = json.loads(line)
            kind = data.pop("kind")
            yield _KINDS[kind](**data)
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise SamplesUnreadable(
                f"{arg(name)}:{arg(number)}: this line is not a measurement sample",
                hint="use the original file: it must not be edited",
            ) from error
