"""Whether somebody has the serial port: then it is left alone (devices.md, section 2, rule 9)."""

from __future__ import annotations

import os
from pathlib import Path

from atlantis_netcfg.core.errors import DeviceFailed

__all__ = ["PortOwned", "require_free"]

_PTY = "/dev/pts/"
_UNIX98 = range(136, 144)
"""Major numbers of pseudo-terminals (Linux, Documentation/admin-guide/devices.txt)."""
_LOCKS = (Path("/var/lock"), Path("/run/lock"))


class PortOwned(DeviceFailed):
    """Another program has the port; nothing was sent to it."""


def require_free(port: str, *, proc: Path = Path("/proc"), locks: tuple[Path, ...] = _LOCKS) -> None:
    """Raise PortOwned if a program has the port open or locked, or ModemManager runs, which owns every modem.

    Of other users' processes an ordinary user sees no open files: then the lock file and the exclusive flag, which is
    tried when the port is opened, are all that is left. A pseudo-terminal is no modem to ModemManager.
    """
    if not port.startswith(_PTY) and (pid := _manager(proc)) is not None:
        raise PortOwned(
            f"{port}: ModemManager runs on this computer (process {pid}) and owns its modems",
            hint="write `driver: modemmanager` (and no `serial`), or stop ModemManager while the port is read",
        )
    if (holder := _holder(port, proc) or _locked(port, proc, locks)) is not None:
        raise PortOwned(
            f"{port}: another program has this port ({holder}), and is not disturbed",
            hint="end that program, or read the modem in the way that it offers",
        )


def _manager(proc: Path) -> int | None:
    return next((pid for pid in _processes(proc) if _name(proc, pid) == "ModemManager"), None)


def _holder(port: str, proc: Path) -> str | None:
    try:
        device = _identity(Path(port))
    except OSError:
        return None
    for pid in _processes(proc):
        if pid != os.getpid() and _has_open(proc / str(pid) / "fd", device):
            return f"{_name(proc, pid)}, process {pid}"
    return None


def _identity(path: Path) -> tuple[int, int]:
    """The device behind a path; each container numbers its pseudo-terminals anew, in a file system of its own."""
    found = path.stat()
    return found.st_rdev, found.st_dev if os.major(found.st_rdev) in _UNIX98 else 0


def _has_open(files: Path, device: tuple[int, int]) -> bool:
    try:
        links = list(files.iterdir())
    except OSError:
        return False
    for link in links:
        try:
            # A link that does not lead into /dev is not opened: a stat of a dead network share would hang.
            if str(link.readlink()).startswith("/dev/") and _identity(link) == device:
                return True
        except OSError:
            continue
    return False


def _locked(port: str, proc: Path, locks: tuple[Path, ...]) -> str | None:
    """A lock file of the old kind, which holds the number of a process that lives (pppd, minicom)."""
    for folder in locks:
        path = folder / f"LCK..{Path(port).name}"
        try:
            pid = int(path.read_text(encoding="ascii").split()[0])
        except (OSError, ValueError, IndexError):
            continue
        if (proc / str(pid)).is_dir():
            return f"{_name(proc, pid)}, process {pid}, by {path}"
    return None


def _processes(proc: Path) -> list[int]:
    return sorted(int(path.name) for path in proc.iterdir() if path.name.isdigit())


def _name(proc: Path, pid: int) -> str:
    try:
        return (proc / str(pid) / "comm").read_text(encoding="utf-8").strip()
    except OSError:
        return "unknown"
