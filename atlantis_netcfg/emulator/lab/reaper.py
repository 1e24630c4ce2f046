"""Remove a lab when its owner ends, in whatever way; uses only the standard library.

    python reaper.py YARD OWNER  waits for the end of its standard input, which the owner holds open, or of the owner:
                                a surviving fork of it would hold the input open, too

Everything of a lab has its name: network namespaces, control groups, mounts. Removing what is already gone is no error,
so that the owner's keeper and the sweep of a later lab may run at the same time.
"""

from __future__ import annotations

import fcntl
import os
import re
import select
import signal
import subprocess
import sys
import time
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

YARDS = Path("/run/atlantis/yards")
"""One folder for each yard: the file `owner`, locked while the owner process lives, and what its machines mount."""
PREFIX = "yd"
"""Prefix of yard names: `yd<pid of the owner>-<number>`."""
_NAMESPACES = Path("/run/netns")
_PROPAGATE = Path("/run/systemd/nspawn/propagate")
_PATIENCE_S = 20.0
_PAUSE_S = 0.01


def sweep() -> None:
    """Remove the labs whose owners are dead."""
    for folder in sorted(YARDS.glob(f"{PREFIX}*")):
        with suppress(FileNotFoundError, BlockingIOError), (folder / "owner").open("rb") as owner:
            fcntl.flock(owner, fcntl.LOCK_EX | fcntl.LOCK_NB)
            take_down(folder.name)


def take_down(lab: str) -> None:
    """Kill all processes of a lab, then remove its mounts, namespaces and control groups."""
    for name in _namespaces(lab):
        kill_all(partial(_list_processes, name))
    for group in _find_control_groups(lab):
        remove_group(group)
    unmount(YARDS / lab)
    for name in _namespaces(lab):
        _run_quietly("ip", "netns", "delete", name)
    for path in _PROPAGATE.glob(f"{lab}*"):
        remove(path)
    remove(YARDS / lab)


def _namespaces(lab: str) -> list[str]:
    """Return the network namespaces of a lab, those of its machines first."""
    names = [lab, *(path.name for path in _NAMESPACES.glob(f"{lab}-*"))]
    return sorted((name for name in names if (_NAMESPACES / name).exists()), key=len, reverse=True)


def _list_processes(name: str) -> list[int]:
    process = subprocess.run(["ip", "netns", "pids", name], capture_output=True, text=True, check=False)  # noqa: S603, S607
    return [int(word) for word in process.stdout.split() if int(word) != os.getpid()]


def kill_all(inhabitants: Callable[[], list[int]], patience_s: float = _PATIENCE_S) -> None:
    """Kill processes until none is left, or the time is over."""
    end = time.monotonic() + patience_s
    while (processes := inhabitants()) and time.monotonic() < end:
        for process in processes:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        time.sleep(_PAUSE_S)


def control_groups() -> list[Path]:
    """Return the mount points of the control group hierarchies that systemd uses."""
    result = []
    for line in Path("/proc/self/mountinfo").read_text(encoding="utf-8").splitlines():
        place, _, kind = line.partition(" - ")
        words = kind.split()
        if words[0] == "cgroup2" or (words[0] == "cgroup" and "name=systemd" in words[2].split(",")):
            result.append(Path(place.split()[4]))
    return result


def _find_control_groups(lab: str) -> Iterator[Path]:
    for hierarchy in control_groups():
        yield from hierarchy.glob(f"{lab}-*")


def remove_group(group: Path) -> None:
    """Kill the processes of a control group and its children, and remove the groups."""
    kill_all(partial(_list_group_processes, group))
    for below, _, _ in os.walk(group, topdown=False):
        with suppress(OSError):
            Path(below).rmdir()


def _list_group_processes(group: Path) -> list[int]:
    result = []
    for below, _, _ in os.walk(group):
        with suppress(OSError):
            result += [int(word) for word in Path(below, "cgroup.procs").read_text(encoding="ascii").split()]
    return result


def mount_points() -> list[str]:
    """Return all mount points, in mount order."""
    lines = Path("/proc/self/mountinfo").read_text(encoding="utf-8").splitlines()
    return [re.sub(r"\\([0-7]{3})", lambda code: chr(int(code[1], 8)), line.split()[4]) for line in lines]


def unmount(folder: Path) -> None:
    """Unmount everything below a folder, in reverse order."""
    for place in reversed(mount_points()):
        if Path(place).is_relative_to(folder):
            _run_quietly("umount", "--lazy", place)


def remove(folder: Path) -> None:
    """Delete a folder, but nothing that is still mounted in it."""
    _run_quietly("rm", "-rf", "--one-file-system", str(folder))


def _run_quietly(*words: str) -> None:
    subprocess.run(words, capture_output=True, check=False)  # noqa: S603 - a program of the system


def _wait_and_take_down(lab: str, owner: int) -> None:
    ends = select.poll()
    ends.register(sys.stdin, select.POLLIN)
    with suppress(ProcessLookupError):
        ends.register(os.pidfd_open(owner), select.POLLIN)
        if os.getppid() == owner:  # else it is dead, and its number another's
            ends.poll()
    take_down(lab)


if __name__ == "__main__":
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    _wait_and_take_down(sys.argv[1], int(sys.argv[2]))
