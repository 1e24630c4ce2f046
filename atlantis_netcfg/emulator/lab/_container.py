"""systemd-nspawn with a machine's disk and network: what is running, or has been until its power was cut."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.lab._errors import MachineFailed
from atlantis_netcfg.emulator.lab.reaper import control_groups, remove, remove_group

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["Container", "entering", "wait"]

_PAUSE_S = 0.02
_END_S = 20.0
# The clock is not namespaced: with CAP_SYS_TIME a machine would set this computer's.
_OPTIONS = (
    *("--quiet", "--boot", "--register=no", "--keep-unit", "--settings=no", "--link-journal=no"),
    *("--console=read-only", "--resolv-conf=off", "--timezone=off"),
    *("--capability=CAP_NET_ADMIN,CAP_NET_RAW", "--drop-capability=CAP_SYS_TIME"),
)
_INTO_GROUPS = 'for group in $ATLANTIS_GROUPS; do echo $$ > "$group/cgroup.procs"; done; exec "$@"'


def wait(until: Callable[[], object], timeout_s: float, otherwise: Callable[[], str]) -> None:
    """Wait until something is so; MachineFailed with these words when it does not come."""
    end = time.monotonic() + timeout_s
    while not until():
        if time.monotonic() > end:
            raise MachineFailed(otherwise())
        time.sleep(_PAUSE_S)


class Container:
    """One power-on of a machine; `name` is its namespace and its control groups, too."""

    def __init__(self, name: str, hostname: str, root: Path, log: Path) -> None:
        self._name = name
        self._log = log
        # Two containers in one control group would stop each other's services: each gets its own.
        self._groups = [hierarchy / name for hierarchy in control_groups()]
        for group in self._groups:
            group.mkdir(exist_ok=True)
        tun = ("--bind=/dev/net/tun",) if Path("/dev/net/tun").exists() else ()
        place = (f"--directory={root}", f"--network-namespace-path=/run/netns/{name}")
        names = (f"--machine={name}", f"--hostname={hostname}")
        with log.open("ab") as console:
            self._nspawn = subprocess.Popen(  # noqa: S603 - a program of the system, and arguments that are ours
                ("/bin/sh", "-c", _INTO_GROUPS, "sh", "systemd-nspawn", *_OPTIONS, *place, *names, *tun),
                stdin=subprocess.DEVNULL,
                stdout=console,
                stderr=console,
                cwd="/",
                start_new_session=True,
                env={
                    "PATH": os.environ.get("PATH", os.defpath),
                    "ATLANTIS_GROUPS": " ".join(map(str, self._groups)),
                    "SYSTEMD_NSPAWN_API_VFS_WRITABLE": "network",
                },
            )

    @property
    def runs(self) -> bool:
        """Whether it has not ended, by itself or by us."""
        return self._nspawn.poll() is None

    def leader(self) -> int | None:
        """The systemd inside; None: not yet, or no more. Before it is there, inside is not separated from outside."""
        first = self._first()
        with suppress(OSError):
            if first is not None and not _same_program(first, self._nspawn.pid):
                return first
        return None

    def _first(self) -> int | None:
        """The process that is number 1 inside, whatever it does."""
        tasks = Path("/proc", str(self._nspawn.pid), "task", str(self._nspawn.pid), "children")
        with suppress(OSError):
            for child in tasks.read_text(encoding="ascii").split():
                if _first_inside(child):
                    return int(child)
        return None

    def kill(self) -> None:
        """End it as a power cut does, and everything in it."""
        while self.runs and (first := self._first()) is not None:
            with suppress(ProcessLookupError):
                os.kill(first, signal.SIGKILL)
            with suppress(subprocess.TimeoutExpired):
                self._nspawn.wait(_PAUSE_S)
        if self.runs:
            self._nspawn.kill()
        self._nspawn.wait(_END_S)
        for group in self._groups:
            remove_group(group)
        remove(Path("/run/systemd/nspawn/propagate", self._name))

    def last_words(self) -> str:
        """The end of its console."""
        lines = self._log.read_text(encoding="utf-8", errors="replace").splitlines()[-5:]
        return "\n".join(f"  {line}" for line in lines)


def entering(leader: int) -> tuple[str, ...]:
    """What to write before a program's words so that it runs inside, and may do what root may do there.

    Without the bounding set of the one inside it would keep this computer's powers, the one over its clock among them.
    """
    status = Path("/proc", str(leader), "status").read_text(encoding="utf-8")
    mask = int(next(line.split()[1] for line in status.splitlines() if line.startswith("CapBnd:")), 16)
    current = ",".join(["-all", *(f"+cap_{number}" for number in range(mask.bit_length()) if mask >> number & 1)])
    confined = ("setpriv", f"--bounding-set={current}", "--inh-caps=-all")
    return (*confined, "nsenter", "--target", str(leader), "--all", "--")


def _same_program(item: int, other: int) -> bool:
    return Path(f"/proc/{item}/exe").samefile(f"/proc/{other}/exe")


def _first_inside(process: str) -> bool:
    with suppress(OSError):
        for line in Path("/proc", process, "status").read_text(encoding="utf-8").splitlines():
            if line.startswith("NSpid:"):
                return line.split()[-1] == "1"
    return False
