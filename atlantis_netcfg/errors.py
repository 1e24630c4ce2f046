"""The one exception root and the exit codes, so that every door (command line, Ansible) ends a run in the same way."""

from __future__ import annotations

from enum import IntEnum

__all__ = [
    "DeviceFailed",
    "ExitCode",
    "NetcfgError",
    "NothingMatched",
    "OutcomeUnknown",
    "UsageError",
]


class ExitCode(IntEnum):
    """How a command ends; the table that technicians read is docs/exit-codes.md."""

    DONE = 0
    OUR_FAULT = 1
    CHANGES = 2
    USAGE = 3
    FAILED = 4
    UNKNOWN = 5
    CHECKS_FAILED = 6
    NOTHING = 7


class NetcfgError(Exception):
    """Root of every error that a person may see: `str()` says what is wrong, `hint` what to type next."""

    exit: ExitCode = ExitCode.OUR_FAULT

    def __init__(self, message: str, *, hint: str | None = None) -> None:
        super().__init__(message)
        self.hint = hint


class UsageError(NetcfgError):
    """The command line, or a file it names, cannot be understood; nothing was contacted."""

    exit = ExitCode.USAGE


class NothingMatched(NetcfgError, LookupError):
    """A site, host or run that does not exist: never a green nothing."""

    exit = ExitCode.NOTHING


class DeviceFailed(NetcfgError):
    """The device is as it was before: refused, rolled back, or never touched."""

    exit = ExitCode.FAILED


class OutcomeUnknown(NetcfgError):
    """The link was lost before the outcome could be read back."""

    exit = ExitCode.UNKNOWN
