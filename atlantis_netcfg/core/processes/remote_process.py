"""A process with one input and line-by-line output, run in a thread; it is killed on timeout or request."""

from __future__ import annotations

import asyncio
import subprocess
import tempfile
import threading
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import IO, TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

_MOST = 64 * 1024 * 1024
"""Maximum output of a process in bytes."""


@dataclass(frozen=True, slots=True)
class ProcessResult:
    """Exit code and output of a process."""

    rc: int
    out: bytes
    err: bytes
    overdue: bool


def ignore_line(_line: bytes) -> None:
    """Ignore an output line."""


@dataclass(slots=True)
class Carrier:
    """Runs one process with input, and reports each output line as it comes."""

    feed: bytes = b""
    line: Callable[[bytes], None] = ignore_line
    limit_s: float | None = None
    """Time limit in seconds, after which the process is killed; None: no limit."""
    _is_stopped: bool = False
    _process: subprocess.Popen[bytes] | None = None
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def run(self, argv: Sequence[str]) -> ProcessResult:
        """Run the process to its end. Raises OSError if there is no such program."""
        overdue = threading.Event()
        with tempfile.TemporaryFile() as errors, self._start(argv, errors) as process, self._watch(overdue):
            out = self._feed_and_read(process)
            process.wait()
            errors.seek(0)
            return ProcessResult(process.returncode, out, errors.read(_MOST), overdue.is_set())

    def _start(self, argv: Sequence[str], errors: IO[bytes]) -> subprocess.Popen[bytes]:
        pipe = subprocess.PIPE
        with self._lock:
            # A list and no shell: the words are of the inventory, quoted for the computer that they go to.
            self._process = subprocess.Popen(argv, stdin=pipe, stdout=pipe, stderr=errors)  # noqa: S603 - see above
            if self._is_stopped:
                self._process.kill()
        return self._process

    @contextmanager
    def _watch(self, overdue: threading.Event) -> Iterator[None]:
        clock = None if self.limit_s is None else threading.Timer(self.limit_s, self._stop_overdue, [overdue])
        if clock is not None:
            clock.start()
        try:
            yield
        finally:
            if clock is not None:
                clock.cancel()
                clock.join()

    def stop(self) -> None:
        """Kill the process, if it is running."""
        self._is_stopped = True
        with self._lock:
            if self._process is not None:
                self._process.kill()

    async def run_beside(self, work: Callable[[], object]) -> None:
        """Run blocking work that uses this carrier in a thread; cancelling it kills the process."""
        try:
            await asyncio.to_thread(work)
        except asyncio.CancelledError:
            self.stop()
            raise

    def _stop_overdue(self, overdue: threading.Event) -> None:
        overdue.set()
        self.stop()

    def _feed_and_read(self, process: subprocess.Popen[bytes]) -> bytes:
        assert process.stdin is not None  # noqa: S101 - both are pipes
        assert process.stdout is not None  # noqa: S101
        feeder = threading.Thread(target=_feed_all, args=(process.stdin, self.feed), daemon=True)
        feeder.start()
        lines, room = [], _MOST
        while line := process.stdout.readline(room):
            lines.append(line)
            room -= len(line)
            self.line(line)
        if room <= 0:
            self.stop()  # it sends without an end
        feeder.join()
        return b"".join(lines)


def _feed_all(pipe: IO[bytes], data: bytes) -> None:
    """Write all data and close the pipe; a process that has ended is ignored."""
    with suppress(OSError), pipe:
        pipe.write(data)
