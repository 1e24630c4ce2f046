"""What is said into a stream, and what is heard there until it is enough; the way over TCP."""

from __future__ import annotations

import re
import select
import socket
import time
from typing import TYPE_CHECKING, Any, Callable

from atlantis_netcfg.checklist.probes.agent._shared import NoAnswer, no_answer

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.probes.agent._shared import Sound

__all__ = ["converse", "tcp"]

_AT_MOST = 65536


class _Line:
    """A stream with two ends, by what reads and writes it; it is closed by whoever opened it."""

    def __init__(self, number: int, read: Callable[[int], bytes], write: Callable[[bytes], int]) -> None:
        self._number, self._read, self._write = number, read, write

    def receive(self, wait_s: float) -> bytes | None:
        """What comes within the time: None is nothing, b"" that the other end has hung up."""
        if not select.select([self._number], [], [], max(wait_s, 0.0))[0]:
            return None
        try:
            return self._read(_AT_MOST)
        except BlockingIOError:
            return None
        except OSError:
            return b""

    def send(self, data: bytes, wait_s: float) -> None:
        """Send all of it; OSError where that takes longer than the time."""
        ends, rest = time.monotonic() + wait_s, data
        while rest:
            if not select.select([], [self._number], [], max(ends - time.monotonic(), 0.0))[1]:
                raise TimeoutError
            rest = rest[self._write(rest) :]


def tcp(question: dict[str, Any], sound: Sound) -> None:
    """Speak over TCP with a server. Raises NoAnswer."""
    where = f"{question['address']} port {question['port']}"
    try:
        wire = socket.create_connection((question["address"], question["port"]), timeout=question["connect_s"])
    except socket.timeout:
        raise NoAnswer("silent", f"{where}: no answer within {question['connect_s']:g} s") from None
    except socket.gaierror as error:
        raise NoAnswer("unreachable", f"{where}: {error.strerror}") from None
    except OSError as error:
        raise no_answer(error, where) from None
    with wire:
        wire.setblocking(False)
        converse(question, sound, wire.fileno(), wire.recv, wire.send)


def converse(
    question: dict[str, Any],
    sound: Sound,
    number: int,
    read: Callable[[int], bytes],
    write: Callable[[bytes], int],
) -> None:
    """Say what there is to be said, then listen; what is heard, and how it ended, is in `sound`."""
    line = _Line(number, read, write)
    answered = _say(question["say"], line, sound)
    ends = time.monotonic() + question["listen_s"]
    enough = re.compile(question["enough"].encode("latin-1")) if question["enough"] else None
    _listen(line, sound, ends, lambda: enough is not None and enough.search(sound.data) is not None)
    if sound.closed and not answered and (question["say"] or not sound.data):
        sound.trouble, sound.words = "closed", f"the other end hung up after {sound.seconds:.1f} s"
    elif sound.closed:
        sound.words = f"the other end hung up after {sound.seconds:.1f} s"


def _say(says: list[list[Any]], line: _Line, sound: Sound) -> bool:
    """Say one thing after the other until one is not answered; whether any was."""
    answered = False
    for reply, until, within_s in says:
        mark, pattern = len(sound.data), re.compile(until.encode("latin-1"))
        ends = time.monotonic() + within_s
        try:
            line.send(reply.encode("latin-1"), within_s)
        except OSError:
            sound.closed = sound.closed or line.receive(0.0) == b""
            break
        if not _listen(line, sound, ends, lambda at=mark, seek=pattern: seek.search(sound.data[at:]) is not None):  # type: ignore[misc]
            break
        answered = True
    return answered


def _listen(line: _Line, sound: Sound, ends: float, enough: Callable[[], bool]) -> bool:
    """Listen until it is enough; False if the time, the room or the stream ended before."""
    while not sound.closed and not sound.full:
        if enough():
            return True
        left = ends - time.monotonic()
        if left <= 0:
            return False
        received = line.receive(left)
        if received:
            sound.add(received)
        sound.closed = received == b""
    return enough()
