"""Streams that the agent reads: TCP, UDP datagrams and serial ports, and code shared by all its requests.

UDP: nothing is sent, and no port is taken from another program. A serial port that another program holds is never
opened: opening alone may reset the attached device, and two readers steal each other's bytes. /proc shows who holds it.
If that may not be read, and the port is not our own, it is not opened either.
"""

from __future__ import annotations

import errno
import fcntl
import os
import re
import select
import socket
import stat
import termios
import time
from base64 import b64encode
from contextlib import suppress
from pathlib import Path
from typing import Any, Callable, Iterator

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
"""Error number of the system -> value of `Trouble`."""
_PLAIN = frozenset(range(0x20, 0x7F)) - {*b'"\\'}
"""Bytes that JSON encodes as one byte."""


class ProbeError(Exception):
    """There is no response; `trouble` is a value of `Trouble`."""

    def __init__(self, trouble: str, words: str) -> None:
        super().__init__(words)
        self.trouble = trouble
        self.words = words


def no_answer(error: OSError, what: str) -> ProbeError:
    """Translate an OS error into a `ProbeError`; an unknown error proves nothing and counts as unreachable."""
    words = error.strerror or str(error) or type(error).__name__
    return ProbeError(_BY_NUMBER.get(error.errno or 0, "unreachable"), f"{what}: {words}")


def encode_bytes(data: bytes) -> Any:  # noqa: ANN401 - JSON: a text, or a list of one
    """Encode bytes for JSON, the shorter form: text in Latin-1, which SSH compresses best, or `[base64]`."""
    text = data.decode("latin-1")
    escape_count = sum(byte not in _PLAIN for byte in data)
    return text if escape_count * 4 <= len(data) else [b64encode(data).decode()]


class ReceiveBuffer:
    """Data received on a stream, available even if the request is stopped before its end."""

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
        """Seconds since the start."""
        return time.monotonic() - self._zero

    @property
    def full(self) -> bool:
        """Whether the buffer is full."""
        return self._left <= 0

    def add(self, data: bytes, sender: str = "") -> None:
        """Store received data, as far as there is room; `sender`: source address of a datagram."""
        chunk = data[: self._left]
        self._left -= len(chunk)
        if chunk:
            self.chunks.append((round(self.seconds, 3), chunk))
            self.senders += [sender] if sender else []
            self.data += chunk
        if self.full:
            self.words = f"cut after {len(self.data)} bytes"

    def as_answer(self) -> dict[str, Any]:
        """Return the fields of `Transcript`."""
        return {
            "trouble": self.trouble,
            "words": self.words,
            "chunks": [[at, encode_bytes(data)] for at, data in self.chunks],
            **({"senders": self.senders} if self.senders else {}),
            "began": self.began,
            "ended_s": round(self.seconds, 3),
        }


_AT_MOST = 65536


class _SerialStream:
    """A bidirectional stream over a file descriptor, read and written by given functions; its opener closes it."""

    def __init__(self, number: int, read: Callable[[int], bytes], write: Callable[[bytes], int]) -> None:
        self._number, self._read, self._write = number, read, write

    def receive(self, wait_s: float) -> bytes | None:
        """Return received data; None after the timeout, b"" if the other end has closed."""
        if not select.select([self._number], [], [], max(wait_s, 0.0))[0]:
            return None
        try:
            return self._read(_AT_MOST)
        except BlockingIOError:
            return None
        except OSError:
            return b""

    def send(self, data: bytes, wait_s: float) -> None:
        """Send all data; raises OSError on timeout."""
        ends, rest = time.monotonic() + wait_s, data
        while rest:
            if not select.select([], [self._number], [], max(ends - time.monotonic(), 0.0))[1]:
                raise TimeoutError
            rest = rest[self._write(rest) :]


def tcp(question: dict[str, Any], sound: ReceiveBuffer) -> None:
    """Connect to a TCP server, send, and listen. Raises ProbeError."""
    where = f"{question['address']} port {question['port']}"
    try:
        wire = socket.create_connection((question["address"], question["port"]), timeout=question["connect_s"])
    except socket.timeout:
        raise ProbeError("silent", f"{where}: no response within {question['connect_s']:g} s") from None
    except socket.gaierror as error:
        raise ProbeError("unreachable", f"{where}: {error.strerror}") from None
    except OSError as error:
        raise no_answer(error, where) from None
    with wire:
        wire.setblocking(False)
        converse(question, sound, wire.fileno(), wire.recv, wire.send)


def converse(
    question: dict[str, Any],
    sound: ReceiveBuffer,
    number: int,
    read: Callable[[int], bytes],
    write: Callable[[bytes], int],
) -> None:
    """Send the messages, then listen; `sound` gets the received data, and how the stream ended."""
    line = _SerialStream(number, read, write)
    is_answered = _say(question["say"], line, sound)
    ends = time.monotonic() + question["listen_s"]
    enough = re.compile(question["enough"].encode("latin-1")) if question["enough"] else None
    _listen(line, sound, ends, lambda: enough is not None and enough.search(sound.data) is not None)
    if sound.closed and not is_answered and (question["say"] or not sound.data):
        sound.trouble, sound.words = "closed", f"the other end hung up after {sound.seconds:.1f} s"
    elif sound.closed:
        sound.words = f"the other end hung up after {sound.seconds:.1f} s"


def _say(says: list[list[Any]], line: _SerialStream, sound: ReceiveBuffer) -> bool:
    """Send the messages in order until one gets no response; return whether any got one."""
    is_answered = False
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
        is_answered = True
    return is_answered


def _listen(line: _SerialStream, sound: ReceiveBuffer, ends: float, enough: Callable[[], bool]) -> bool:
    """Listen until there is enough; return False if the time, the buffer or the stream ended before."""
    while not sound.closed and not sound.full:
        if enough():
            return True
        remaining_s = ends - time.monotonic()
        if remaining_s <= 0:
            return False
        data = line.receive(remaining_s)
        if data:
            sound.add(data)
        sound.closed = data == b""
    return enough()


_LONGEST = 65535


def udp(question: dict[str, Any], sound: ReceiveBuffer) -> None:
    """Receive datagrams at a port. Raises ProbeError: busy if another program has the port."""
    ends = time.monotonic() + question["listen_s"]
    enough = re.compile(question["enough"].encode("latin-1")) if question["enough"] else None
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        try:
            # Without SO_REUSEADDR: beside a program that has it, either of the two would lose datagrams.
            port.bind((question["address"], question["port"]))
        except OSError as error:
            raise no_answer(error, f"UDP port {question['port']}") from None
        while not sound.full and (enough is None or not enough.search(sound.data)):
            remaining_s = ends - time.monotonic()
            if remaining_s <= 0:
                return
            port.settimeout(remaining_s)
            try:
                data, source = port.recvfrom(_LONGEST)
                sound.add(data, source[0])
            except socket.timeout:
                return


_PTMX = os.makedev(5, 2)
_PTS = range(136, 144)
"""Major numbers of pseudo-terminals (Documentation/admin-guide/devices.txt)."""
_LOCKS = ("/run/lock", "/var/lock", "/var/spool/lock")
"""Folders in which programs leave LCK..ttyUSB0 with their process number (Filesystem Hierarchy Standard, 5.9)."""


def serial(question: dict[str, Any], sound: ReceiveBuffer) -> None:
    """Send and listen on a serial port, 8N1. Raises ProbeError: busy, missing, denied."""
    path = question["device"]
    speed = getattr(termios, f"B{question['baud']}", None)
    if speed is None:
        raise ProbeError("missing", f"{path}: no serial port does {question['baud']} baud")
    port = _open_port(path)
    try:
        before = termios.tcgetattr(port)
        termios.tcsetattr(port, termios.TCSANOW, _raw(before, speed))
        try:
            converse(question, sound, port, lambda most: os.read(port, most), lambda data: os.write(port, data))
        finally:
            _put_back(port, before)
            with suppress(OSError):  # it has been pulled out
                fcntl.ioctl(port, termios.TIOCNXCL)  # else it stays as long as anybody has the port open
    except termios.error as error:
        raise no_answer(OSError(*error.args), path) from None
    finally:
        os.close(port)


def _open_port(path: str) -> int:
    try:
        there = os.stat(path)  # noqa: PTH116 - the number of the device, under any name
    except OSError as error:
        raise no_answer(error, path) from None
    if not stat.S_ISCHR(there.st_mode):
        raise ProbeError("missing", f"{path} is no serial port")
    _require_free_port(path, there)
    try:
        port = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError as error:
        raise no_answer(error, path) from None
    try:
        fcntl.flock(port, fcntl.LOCK_EX | fcntl.LOCK_NB)
        fcntl.ioctl(port, termios.TIOCEXCL)
        _require_free_port(path, there)  # whoever came in meanwhile was first
    except BlockingIOError:
        os.close(port)
        raise ProbeError("busy", f"{path} is locked by another program") from None
    except (ProbeError, OSError) as error:
        os.close(port)
        raise error if isinstance(error, ProbeError) else no_answer(error, path) from None
    return port


def _require_free_port(path: str, there: os.stat_result) -> None:
    """Raise ProbeError if another process holds the port, or if this cannot be determined."""
    for holder in (*_lock_files(path), *_kernel_locks(there)):
        raise ProbeError("busy", f"{path} is locked by process {holder}")
    has_hidden = False
    for process in Path("/proc").iterdir():
        if not process.name.isdigit() or int(process.name) == os.getpid():
            continue
        try:
            if _holds(process, there):
                raise ProbeError("busy", f"{path} is held by {_describe_process(process)}")
        except PermissionError:
            has_hidden = True
        except OSError:  # it has ended
            continue
    if has_hidden and there.st_uid != os.getuid():
        raise ProbeError("denied", f"only root sees whether another program holds {path}, so it was not opened")


def _holds(process: Path, there: os.stat_result) -> bool:
    """Return whether a process has the device open; the master side of a pseudo-terminal does not count."""
    devices = dict(_devices(process))
    if not any(_same(item, there) for item in devices.values()):
        return False
    masters = [name for name, entry in devices.items() if entry.st_rdev == _PTMX and os.major(there.st_rdev) in _PTS]
    return not any(_leads_to(process / "fdinfo" / name, os.minor(there.st_rdev)) for name in masters)


def _same(item: os.stat_result, there: os.stat_result) -> bool:
    """Compare devices; a pseudo-terminal's number is unique only within its devpts: containers have others."""
    pseudo = os.major(there.st_rdev) in _PTS
    return item.st_rdev == there.st_rdev and (item.st_dev == there.st_dev or not pseudo)


def _devices(process: Path) -> Iterator[tuple[str, os.stat_result]]:
    for item in (process / "fd").iterdir():
        with suppress(FileNotFoundError):
            yield item.name, item.stat()


def _leads_to(master: Path, number: int) -> bool:
    """Return whether this pseudo-terminal master belongs to /dev/pts/<number> (proc(5), fdinfo: `tty-index`)."""
    with suppress(FileNotFoundError):
        return re.search(rf"^tty-index:\s*{number}$", master.read_text(), re.MULTILINE) is not None
    return False


def _describe_process(process: Path) -> str:
    try:
        return f"{(process / 'comm').read_text().strip()} (process {process.name})"
    except OSError:
        return f"process {process.name}"


def _lock_files(path: str) -> Iterator[str]:
    names = {Path(path).name, Path(os.path.realpath(path)).name}
    for file in (Path(folder, f"LCK..{name}") for folder in _LOCKS for name in names):
        try:
            holder = file.read_text(errors="replace").split()
        except OSError:
            continue
        if holder and holder[0].isdigit() and Path("/proc", holder[0]).exists():
            yield holder[0]


def _kernel_locks(there: os.stat_result) -> Iterator[str]:
    file = f"{os.major(there.st_dev):02x}:{os.minor(there.st_dev):02x}:{there.st_ino}"
    try:
        lines = Path("/proc/locks").read_text().splitlines()
    except OSError:
        return
    for words in map(str.split, lines):
        if file in words and str(os.getpid()) not in words:
            yield words[words.index(file) - 1]


def _raw(before: list[Any], speed: int) -> list[Any]:
    """Return raw settings: 8 bits, no parity, no translation, only the data lines (termios(3), cfmakeraw)."""
    cc = list(before[6])
    cc[termios.VMIN], cc[termios.VTIME] = b"\x01", b"\x00"
    return [0, 0, termios.CS8 | termios.CREAD | termios.CLOCAL, 0, speed, speed, cc]


def _put_back(port: int, before: list[Any]) -> None:
    try:
        termios.tcsetattr(port, termios.TCSANOW, before)
    except termios.error:  # it was unplugged meanwhile
        return
