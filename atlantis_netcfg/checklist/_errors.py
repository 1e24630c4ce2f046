"""What can go wrong with a kept checklist, in words for the person who keeps it."""

from __future__ import annotations

from atlantis_netcfg.core.errors import ExitCode, NetcfgError, UsageError


class Refused(UsageError):
    """What a person asks of the checklist does not fit it; nothing was written down."""


class NotSigned(NetcfgError):
    """Something is open, so that nobody can vouch for the whole; the book stays open."""

    exit = ExitCode.CHECKS_FAILED


class KeyDamaged(NetcfgError):
    """The key with which this computer signs cannot be used."""

    exit = ExitCode.FAILED
