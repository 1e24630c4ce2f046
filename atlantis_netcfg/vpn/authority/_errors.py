"""What can go wrong with the authority's folder, in words for the person whose disk it is."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import ExitCode, NetcfgError, UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = [
    "AddressTaken",
    "AuthorityBusy",
    "AuthorityDamaged",
    "AuthorityFailed",
    "ClockBehind",
    "NoAuthority",
    "NoSuchMember",
    "OtherMember",
    "PoolFull",
    "os_errors_as",
]


class NoAuthority(UsageError):
    """There is no authority in the folder."""


class NoSuchMember(UsageError, LookupError):
    """The roll has no member of this name."""


class OtherMember(UsageError):
    """A member of this name is there, and is not the one that was wished for."""


class AddressTaken(UsageError):
    """The address is in use, or cannot be given to a member."""


class PoolFull(UsageError):
    """Every address of the pool is in use."""


class AuthorityBusy(NetcfgError):
    """Somebody else works on the authority, and did not end in time. Nothing was changed."""

    exit = ExitCode.FAILED


class AuthorityFailed(NetcfgError):
    """A file could not be written: what is recorded stands, and the same command again goes on from there."""

    exit = ExitCode.FAILED


class AuthorityDamaged(NetcfgError):
    """The folder is not what its record says: nothing is signed before a person has looked."""

    exit = ExitCode.FAILED


class ClockBehind(NetcfgError):
    """This computer's clock stands before the last record: what it would sign might not be valid, or end too early."""

    exit = ExitCode.FAILED


@contextmanager
def os_errors_as(what: str) -> Iterator[None]:
    """Say in words that a file of the authority could not be read or written."""
    try:
        yield
    except OSError as error:
        where = f" ({error.filename})" if error.filename else ""
        raise AuthorityFailed(
            f"{what}: {error.strerror or error}{where}",
            hint="make room on the disk or correct its permissions, then run the same command again",
        ) from error
