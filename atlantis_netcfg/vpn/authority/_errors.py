"""What can go wrong with the authority's folder, in words for the person whose disk it is."""

from __future__ import annotations

from atlantis_netcfg.errors import ExitCode, NetcfgError, UsageError

__all__ = [
    "AuthorityBusy",
    "AuthorityDamaged",
    "AuthorityFailed",
    "ClockBehind",
    "NameTaken",
    "NoAuthority",
    "NoSuchMember",
    "PoolFull",
]


class NoAuthority(UsageError):
    """There is no authority in the folder."""


class NoSuchMember(UsageError, LookupError):
    """The roll has no member of this name."""


class NameTaken(UsageError):
    """The name is somebody else's, or was: names never return."""


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
