"""A serial port, by termios; one that another program holds is never opened.

Opening alone may reset what hangs on the port, and two readers steal each other's bytes. Who holds it is seen in
/proc; where that may not be looked into, and the port is not our own, nothing is opened either.
"""

from __future__ import annotations

import fcntl
import os
import re
import stat
import termios
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Iterator

from atlantis_netcfg.checklist.probes.agent._shared import NoAnswer, no_answer
from atlantis_netcfg.checklist.probes.agent._streams import converse

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.probes.agent._shared import Sound

__all__ = ["serial"]

_PTMX = os.makedev(5, 2)
_PTS = range(136, 144)
"""Major numbers of pseudo-terminals (Documentation/admin-guide/devices.txt)."""
_LOCKS = ("/run/lock", "/var/lock", "/var/spool/lock")
"""Where programs leave LCK..ttyUSB0 with their number (Filesystem Hierarchy Standard, 5.9)."""


def serial(question: dict[str, Any], sound: Sound) -> None:
    """Speak over a serial port, 8N1. Raises NoAnswer: busy, missing, denied."""
    path = question["device"]
    speed = getattr(termios, f"B{question['baud']}", None)
    if speed is None:
        raise NoAnswer("missing", f"{path}: no serial port does {question['baud']} baud")
    port = _opened(path)
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


def _opened(path: str) -> int:
    try:
        there = os.stat(path)  # noqa: PTH116 - the number of the device, under any name
    except OSError as error:
        raise no_answer(error, path) from None
    if not stat.S_ISCHR(there.st_mode):
        raise NoAnswer("missing", f"{path} is no serial port")
    _refuse_held(path, there)
    try:
        port = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError as error:
        raise no_answer(error, path) from None
    try:
        fcntl.flock(port, fcntl.LOCK_EX | fcntl.LOCK_NB)
        fcntl.ioctl(port, termios.TIOCEXCL)
        _refuse_held(path, there)  # whoever came in meanwhile was first
    except BlockingIOError:
        os.close(port)
        raise NoAnswer("busy", f"{path} is locked by another program") from None
    except (NoAnswer, OSError) as error:
        os.close(port)
        raise error if isinstance(error, NoAnswer) else no_answer(error, path) from None
    return port


def _refuse_held(path: str, there: os.stat_result) -> None:
    """Raise NoAnswer if another process has it, or if nobody can tell."""
    for holder in (*_lock_files(path), *_kernel_locks(there)):
        raise NoAnswer("busy", f"{path} is locked by process {holder}")
    hidden = False
    for process in Path("/proc").iterdir():
        if not process.name.isdigit() or int(process.name) == os.getpid():
            continue
        try:
            if _holds(process, there):
                raise NoAnswer("busy", f"{path} is held by {_named(process)}")
        except PermissionError:
            hidden = True
        except OSError:  # it has ended
            continue
    if hidden and there.st_uid != os.getuid():
        raise NoAnswer("denied", f"only root sees whether another program holds {path}, so it was not opened")


def _holds(process: Path, there: os.stat_result) -> bool:
    """Whether a process has the device open; who has the other end of a pseudo-terminal is the device itself."""
    opened = dict(_devices(process))
    if not any(_same(item, there) for item in opened.values()):
        return False
    masters = [name for name, entry in opened.items() if entry.st_rdev == _PTMX and os.major(there.st_rdev) in _PTS]
    return not any(_leads_to(process / "fdinfo" / name, os.minor(there.st_rdev)) for name in masters)


def _same(item: os.stat_result, there: os.stat_result) -> bool:
    """A pseudo-terminal's number says which it is in its own instance of devpts only: containers have others."""
    pseudo = os.major(there.st_rdev) in _PTS
    return item.st_rdev == there.st_rdev and (item.st_dev == there.st_dev or not pseudo)


def _devices(process: Path) -> Iterator[tuple[str, os.stat_result]]:
    for item in (process / "fd").iterdir():
        with suppress(FileNotFoundError):
            yield item.name, item.stat()


def _leads_to(master: Path, number: int) -> bool:
    """Whether this end of a pseudo-terminal is that of /dev/pts/<number> (proc(5), fdinfo: `tty-index`)."""
    with suppress(FileNotFoundError):
        return re.search(rf"^tty-index:\s*{number}$", master.read_text(), re.MULTILINE) is not None
    return False


def _named(process: Path) -> str:
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
    """Eight bits, no parity, nothing translated, no line but the data needed (termios(3), cfmakeraw)."""
    cc = list(before[6])
    cc[termios.VMIN], cc[termios.VTIME] = b"\x01", b"\x00"
    return [0, 0, termios.CS8 | termios.CREAD | termios.CLOCAL, 0, speed, speed, cc]


def _put_back(port: int, before: list[Any]) -> None:
    try:
        termios.tcsetattr(port, termios.TCSANOW, before)
    except termios.error:  # it was unplugged meanwhile
        return
