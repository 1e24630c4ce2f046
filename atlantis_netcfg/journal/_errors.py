"""What can go wrong with the state directory, in words for the person whose disk it is."""

from __future__ import annotations

from atlantis_netcfg.core.errors import ExitCode, NetcfgError, NothingMatched

__all__ = ["JournalFailed", "NoSuchRun", "PinsDamaged", "SiteBusy", "StateDamaged"]


class JournalFailed(NetcfgError):
    """The journal cannot be written: nothing more may be changed, because nobody could go on after a break."""

    exit = ExitCode.FAILED


class PinsDamaged(NetcfgError):
    """The file of pinned certificates cannot be read: no device may be trusted until a person has looked."""

    exit = ExitCode.FAILED


class StateDamaged(NetcfgError):
    """A saved state is not what was written: it must not be put on a device."""

    exit = ExitCode.FAILED


class SiteBusy(NetcfgError):
    """Somebody else works on the site now; the message says who. Nothing was contacted."""

    exit = ExitCode.FAILED


class NoSuchRun(NothingMatched):
    """A run that is not in the journal of the site."""
