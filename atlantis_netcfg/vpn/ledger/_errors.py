"""What can be wrong with the ledger."""

from __future__ import annotations

from atlantis_netcfg.core.errors import ExitCode, NetcfgError

__all__ = ["LedgerDamaged", "LedgerFailed"]


class LedgerDamaged(NetcfgError):
    """A line is not what was written: nothing may be signed before a person has looked."""

    exit = ExitCode.FAILED


class LedgerFailed(NetcfgError):
    """The ledger cannot be written: nothing may leave that is not recorded."""

    exit = ExitCode.FAILED
