"""The files of the folder: their names, their copies, and the lock. One process at a time writes.

The kernel frees the lock when its process dies.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import time
from contextlib import suppress
from dataclasses import asdict
from typing import TYPE_CHECKING, Self

from atlantis_netcfg.journal import Holder, sync_directory
from atlantis_netcfg.vpn.authority.model import AuthorityBusy, os_errors_as

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path

    from atlantis_netcfg.vpn.ledger.records import Issued


CA = "ca.crt"
SEALED = {"age": "ca.key.age", "vault": "ca.key.vault"}
CRL = "crl.pem"
CERTS = "certs"
SERVER = "server"
SERVER_CERT = f"{SERVER}/server.crt"
SERVER_KEY = f"{SERVER}/server.key"
TLS_CRYPT_V2 = f"{SERVER}/tls-crypt-v2.key"
TLS_CRYPT = f"{SERVER}/tls-crypt.key"
_SCRATCH = re.compile(r"\..+\.[0-9]+")


def folders(folder: Path) -> None:
    """Make those that are missing, for their owner alone."""
    for name in (CERTS, SERVER, "hosts", "handouts"):
        (folder / name).mkdir(mode=0o700, exist_ok=True)


def copy_of(issued: Issued) -> bytes:
    """The certificate as `certs/` has it, PEM."""
    rows = "\n".join(issued.der[start : start + 64] for start in range(0, len(issued.der), 64))
    return f"-----BEGIN CERTIFICATE-----\n{rows}\n-----END CERTIFICATE-----\n".encode()


def restore_copies(folder: Path, issued: Iterable[Issued]) -> None:
    """Write the certificates of the record that `certs/` lacks, or has otherwise."""
    for item in issued:
        path = folder / CERTS / f"{item.common_name}.pem"
        data = copy_of(item)
        if _read(path) != data:
            _write_copy(path, data)


def sweep(folder: Path) -> None:
    """Remove what killed commands had not put in place: it may be half a file, or hold a key."""
    for path in folder.rglob(".*"):
        if _SCRATCH.fullmatch(path.name) and not path.is_dir():
            path.unlink(missing_ok=True)


def forget(path: Path) -> None:
    """Remove a file for good."""
    path.unlink(missing_ok=True)
    sync_directory(path.parent)


def _write_copy(path: Path, data: bytes) -> None:
    """Whole or not at all, but nothing waits for the disk: what a power cut takes is made again from the ledger."""
    scratch = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        descriptor = os.open(scratch, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
        scratch.replace(path)
    except OSError:
        scratch.unlink(missing_ok=True)
        raise


def _read(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None


LOCK_FILE = "lock"
PATIENCE_S = 60.0
"""Six people who onboard at once queue for some seconds; a minute is somebody who went to lunch."""
_PAUSE_S = 0.05


class Lock:
    """Held from `__enter__` to `__exit__`. Raises AuthorityBusy, naming the holder, when it is not free in time."""

    def __init__(self, folder: Path, who: str, waiting: Callable[[str], None] | None = None) -> None:
        self._path = folder / LOCK_FILE
        self._who = who
        self._waiting = waiting
        self._descriptor = -1
        self.left = False
        """Whether the one who held it before us was killed."""

    def __enter__(self) -> Self:
        with os_errors_as("the authority cannot be locked"):
            flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
            self._descriptor = os.open(self._path, flags, 0o600)
            try:
                self._wait()
                self.left = os.fstat(self._descriptor).st_size > 0
            except BaseException:
                os.close(self._descriptor)
                raise
        self._sign()
        return self

    def __exit__(self, *_: object) -> None:
        # The file stays: were it removed, a third process could lock a new file while a second holds the old one.
        # A name that cannot be taken out tells the next one to look closer, no more.
        try:
            with suppress(OSError):
                os.ftruncate(self._descriptor, 0)
        finally:
            os.close(self._descriptor)

    def _wait(self) -> None:
        until = time.monotonic() + PATIENCE_S
        is_reported = False
        while not _try(self._descriptor, fcntl.LOCK_EX):
            if time.monotonic() >= until:
                raise AuthorityBusy(
                    f"the authority is being worked on by {self._holder()}, and was not free within {PATIENCE_S:.0f} s",
                    hint="wait until that command has ended, then run the same command again",
                )
            if not is_reported and self._waiting is not None:
                self._waiting(f"waiting for {self._holder()}, who works on the authority")
            is_reported = True
            time.sleep(_PAUSE_S)

    def _sign(self) -> None:
        """Say who we are. The name is a courtesy to who waits: a full disk does not make the lock weaker."""
        data = json.dumps(asdict(Holder.me(f"as {self._who}"))).encode()
        with suppress(OSError):
            os.ftruncate(self._descriptor, 0)
            os.pwrite(self._descriptor, data, 0)

    def _holder(self) -> str:
        try:
            return str(Holder(**json.loads(self._path.read_bytes())))
        except (OSError, ValueError, TypeError):
            return "somebody who has just started"


def is_held(folder: Path) -> bool:
    """Whether somebody works on the authority now."""
    try:
        descriptor = os.open(folder / LOCK_FILE, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        return not _try(descriptor, fcntl.LOCK_SH)
    finally:
        os.close(descriptor)


def _try(descriptor: int, how: int) -> bool:
    try:
        fcntl.flock(descriptor, how | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
