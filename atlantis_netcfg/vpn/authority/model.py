"""Requests and results of the authority, its errors, and the files of its folder.

The files: their names, their copies, and the lock. One process at a time writes. The kernel releases the lock when its
process dies.
"""

from __future__ import annotations

import fcntl
import json
import os
import time
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Self

from atlantis_netcfg.core import atomic_files, errors
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.runs import LockHolder
from atlantis_netcfg.vpn import identity

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from ipaddress import IPv4Address, IPv4Network
    from pathlib import Path

    from atlantis_netcfg.inventory.model import RosDistribution
    from atlantis_netcfg.vpn.ledger.records import IssueRecord


CLIENT_DAYS = 397
"""A year, plus a month for renewal."""


@dataclass(frozen=True, slots=True)
class ServerNames:
    """Names in the server's certificate; clients compare them with the address they connect to."""

    common_name: str
    dns: tuple[str, ...]
    addresses: tuple[IPv4Address, ...]


@dataclass(frozen=True, slots=True)
class EnrolmentRequest:
    """A request to make a device a member."""

    name: str
    """`names.member_name(partner, device)`, or the name of a declared host (then `partner` is None)."""
    kind: identity.MemberKind
    partner: str | None
    device: str
    address: IPv4Address | None = None
    """Declared address; None: the next free one of `pool`."""
    pool: IPv4Network | None = None
    """Network that must contain the address; None: no restriction."""
    link: identity.MemberLink = identity.MemberLink.FIBRE
    vehicle: str | None = None
    wrap: identity.Wrap = identity.Wrap.TLS_CRYPT_V2
    key: identity.KeyType = identity.KeyType.EC
    days: int = CLIENT_DAYS
    """Validity of the certificate in days."""
    system: identity.ClientSystem | None = None
    distribution: RosDistribution | None = None
    request_id: str = ""
    """Id of the request, recorded with the certificate."""


@dataclass(frozen=True, slots=True)
class RenewalRequest:
    """Changes made by a renewal; None: as in the newest certificate."""

    days: int | None = None
    """Validity of the successor in days; None: a year and a month."""
    wrap: identity.Wrap | None = None
    key: identity.KeyType | None = None
    link: identity.MemberLink | None = None
    system: identity.ClientSystem | None = None
    distribution: RosDistribution | None = None
    request_id: str = ""


@dataclass(frozen=True, slots=True)
class EnrolmentFile:
    """The single file for a member: on disk, complete, mode 0600."""

    path: str
    sha256: str


@dataclass(frozen=True, slots=True)
class IssueResult:
    """A member with its newest certificate."""

    member: identity.Member
    certificate: identity.Certificate
    file: EnrolmentFile
    already: bool = False
    """The certificate already existed: nothing new was created."""
    replaced_names: tuple[str, ...] = ()
    """Common names replaced by this certificate, revoked because they were never seen in use."""


@dataclass(frozen=True, slots=True)
class RevocationResult:
    """Certificates that must no longer be accepted."""

    common_names: tuple[str, ...]
    """All delivered certificates of these members: none of them may have a session."""
    members: tuple[str, ...]
    crl: bytes
    """The published revocation list, PEM."""
    already: tuple[str, ...] = ()
    """The `members` that had already been revoked."""


@dataclass(frozen=True, slots=True)
class SessionObservation:
    """Consequences of the server's sessions for the record."""

    superseded_names: tuple[str, ...]
    """Common names that are no longer accepted, because a successor was seen."""
    strangers: tuple[str, ...]
    """Common names that are not in the ledger."""
    withdrawn: tuple[str, ...]
    """Common names that were seen after they were revoked or superseded."""


class NoAuthority(errors.UsageError):
    """The folder contains no authority."""


class NoSuchMember(errors.UsageError, LookupError):
    """There is no member with this name."""


class OtherMember(errors.UsageError):
    """A member of this name exists and differs from the request."""


class AddressTaken(errors.UsageError):
    """The address is in use, or not allowed for a member."""


class PoolFull(errors.UsageError):
    """Every address of the pool is in use."""


class AuthorityBusy(errors.NetcfgError):
    """Another process uses the authority, and did not finish in time. Nothing was changed."""

    exit = errors.ExitCode.FAILED


class AuthorityError(errors.NetcfgError):
    """A file could not be written; what is recorded stays, and the same command continues from there."""

    exit = errors.ExitCode.FAILED


class CorruptAuthorityError(errors.NetcfgError):
    """The folder contradicts its record: nothing is signed until the user has checked it."""

    exit = errors.ExitCode.FAILED


class ClockBehind(errors.NetcfgError):
    """This computer's clock is before the last record: new signatures might be invalid, or expire too early."""

    exit = errors.ExitCode.FAILED


@contextmanager
def os_errors_as(what: str) -> Iterator[None]:
    """Convert an OSError to AuthorityError, with a message for the user."""
    try:
        yield
    except OSError as error:
        where = msg(f" ({arg(error.filename)})" if error.filename else "")
        raise AuthorityError(
            f"{arg(what)}: {arg(error.strerror or error)}{arg(where)}",
            hint="free disk space or correct the permissions, then run the same command again",
        ) from error


CA = "ca.crt"
SEALED_KEY_FILES = {"age": "ca.key.age", "vault": "ca.key.vault"}
CRL = "crl.pem"
CERTS = "certs"
SERVER = "server"
SERVER_CERT = f"{SERVER}/server.crt"
SERVER_KEY = f"{SERVER}/server.key"
TLS_CRYPT_V2 = f"{SERVER}/tls-crypt-v2.key"
TLS_CRYPT = f"{SERVER}/tls-crypt.key"


def folders(folder: Path) -> None:
    """Create missing subfolders, accessible by the owner only."""
    for name in (CERTS, SERVER, "hosts", "handouts"):
        (folder / name).mkdir(mode=0o700, exist_ok=True)


def copy_of(record: IssueRecord) -> bytes:
    """Return the certificate as stored in `certs/`, PEM."""
    rows = "\n".join(record.der[start : start + 64] for start in range(0, len(record.der), 64))
    return f"-----BEGIN CERTIFICATE-----\n{rows}\n-----END CERTIFICATE-----\n".encode()


def restore_copies(folder: Path, records: Iterable[IssueRecord]) -> None:
    """Write recorded certificates that are missing in `certs/` or differ there."""
    for item in records:
        path = folder / CERTS / f"{item.common_name}.pem"
        data = copy_of(item)
        if _read(path) != data:
            # Nothing waits for the disk: what a power cut takes is made again from the ledger.
            atomic_files.write_atomically(path, data, durable=False)


def sweep(folder: Path) -> None:
    """Remove temporary files of killed commands, which may be incomplete or contain a key."""
    for path in folder.rglob(".*"):
        if atomic_files.DRAFT.fullmatch(path.name) and not path.is_dir():
            path.unlink(missing_ok=True)


def forget(path: Path) -> None:
    """Delete a file and sync the directory."""
    path.unlink(missing_ok=True)
    atomic_files.sync_directory(path.parent)


def _read(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None


LOCK_FILE = "lock"
PATIENCE_S = 60.0
"""Wait for the lock: six people who onboard at once queue for some seconds; a minute means an unattended session."""
_PAUSE_S = 0.05


class Lock:
    """Held from `__enter__` to `__exit__`. Raises AuthorityBusy, naming the holder, when it is not free in time."""

    def __init__(self, folder: Path, who: str, waiting: Callable[[str], None] | None = None) -> None:
        self._path = folder / LOCK_FILE
        self._who = who
        self._waiting = waiting
        self._descriptor = -1
        self.left = False
        """Whether the previous holder was killed."""

    def __enter__(self) -> Self:
        with os_errors_as("the authority cannot be locked"):
            self._descriptor = atomic_files.open_lock(self._path)
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
        while not _try_lock(self._descriptor, fcntl.LOCK_EX):
            if time.monotonic() >= until:
                raise AuthorityBusy(
                    f"the authority is locked by {arg(self._holder())}, and was not released within "
                    f"{arg(PATIENCE_S):.0f} s",
                    hint="wait until that command has ended, then run the same command again",
                )
            if not is_reported and self._waiting is not None:
                self._waiting(msg(f"waiting for {arg(self._holder())}, who is working on the authority"))
            is_reported = True
            time.sleep(_PAUSE_S)

    def _sign(self) -> None:
        """Write our name into the lock file. It is for information only: on a full disk the lock still works."""
        data = json.dumps(asdict(LockHolder.me(msg(f"as {arg(self._who)}")))).encode()
        with suppress(OSError):
            os.ftruncate(self._descriptor, 0)
            os.pwrite(self._descriptor, data, 0)

    def _holder(self) -> str:
        try:
            return str(LockHolder(**json.loads(self._path.read_bytes())))
        except (OSError, ValueError, TypeError):
            return "somebody who has just started"


def is_held(folder: Path) -> bool:
    """Return True if a process holds the lock of the authority."""
    try:
        descriptor = os.open(folder / LOCK_FILE, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        return not _try_lock(descriptor, fcntl.LOCK_SH)
    finally:
        os.close(descriptor)


def _try_lock(descriptor: int, how: int) -> bool:
    try:
        fcntl.flock(descriptor, how | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
