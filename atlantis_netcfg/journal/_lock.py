"""One run per site at a time, across processes; the kernel frees the lock when its process dies."""

from __future__ import annotations

import fcntl
import getpass
import json
import os
import socket
import time
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Self

from atlantis_netcfg.core.eventlog import write_all
from atlantis_netcfg.journal._errors import SiteBusy
from atlantis_netcfg.journal._files import make_private, translated
from atlantis_netcfg.journal._writer import utc_now

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["Holder", "SiteLock"]

_ATTEMPTS = 10
_PAUSE_S = 0.02


@dataclass(frozen=True, slots=True)
class Holder:
    """Who works on a site."""

    user: str
    host: str
    pid: int
    since: str
    command: str

    @classmethod
    def me(cls, command: str) -> Self:
        """This process."""
        try:
            user = getpass.getuser()
        except (KeyError, OSError):
            user = f"user {os.getuid()}"
        return cls(user, socket.gethostname(), os.getpid(), utc_now().isoformat(timespec="seconds"), command)

    def __str__(self) -> str:
        return f"{self.user} on {self.host} (process {self.pid}) since {self.since}: {self.command}"


class SiteLock:
    """Held from `__enter__` to `__exit__`. Raises SiteBusy, naming the holder, when somebody else has it."""

    def __init__(self, path: Path, site: str, command: str) -> None:
        self._path = path
        self._site = site
        self._command = command
        self._descriptor = -1

    def __enter__(self) -> Self:
        with translated("the site lock", self._path):
            make_private(self._path.parent)
            self._descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            busy = self._busy()
            self._close()
            raise busy from error
        self._sign()
        return self

    def __exit__(self, *_: object) -> None:
        # The file stays: were it removed, a third process could lock a new file while a second holds the old one.
        try:
            os.ftruncate(self._descriptor, 0)
        finally:
            # Closing is not enough: a child that was forked meanwhile, and that is about to end, has it open as well.
            fcntl.flock(self._descriptor, fcntl.LOCK_UN)
            self._close()

    def _sign(self) -> None:
        """Say who we are. The name is a courtesy to the loser: a full disk does not make the lock weaker."""
        data = json.dumps(asdict(Holder.me(self._command))).encode()
        try:
            os.ftruncate(self._descriptor, 0)
            os.lseek(self._descriptor, 0, os.SEEK_SET)
            write_all(self._descriptor, data)
        except OSError:
            return

    def _close(self) -> None:
        os.close(self._descriptor)
        self._descriptor = -1

    def _busy(self) -> SiteBusy:
        holder = self._holder()
        who = str(holder) if holder is not None else "somebody who has just started"
        return SiteBusy(
            f"{self._site} is being worked on by {who}",
            hint="wait until that run has ended, then run the same command again",
        )

    def _holder(self) -> Holder | None:
        """Read who has it. Between lock and signature the file still names the one before, who may be dead."""
        for _ in range(_ATTEMPTS):
            holder = _read(self._path)
            if holder is not None and _may_live(holder):
                return holder
            time.sleep(_PAUSE_S)
        return None


def _read(path: Path) -> Holder | None:
    try:
        return Holder(**json.loads(path.read_bytes()))
    except (OSError, ValueError, TypeError):
        return None


def _may_live(holder: Holder) -> bool:
    if holder.host != socket.gethostname():
        return True
    try:
        os.kill(holder.pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
