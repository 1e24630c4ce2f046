"""What keys, certificates and seals are refused for, in words for the operator of the authority."""

from __future__ import annotations

from atlantis_netcfg.core.errors import ExitCode, NetcfgError, UsageError

__all__ = [
    "CertificateRefused",
    "CrlRefused",
    "KeyDamaged",
    "RecipientRefused",
    "SealDamaged",
    "SealTooLarge",
    "WeakPassphrase",
    "WrongPassphrase",
]


class CertificateRefused(UsageError):
    """A certificate that would not be worth what it says; nothing was signed."""


class CrlRefused(NetcfgError):
    """A revocation list that must not come before a server: it would admit the revoked, or lock everybody out."""

    exit = ExitCode.FAILED


class KeyDamaged(NetcfgError):
    """A key file that holds no such key, or not the one that belongs to the certificate beside it."""

    exit = ExitCode.FAILED


class WrongPassphrase(UsageError):
    """What was typed does not open it. No text of this error holds what was typed."""


class WeakPassphrase(UsageError):
    """Too easy to guess to seal anything with; nothing was written."""


class SealDamaged(NetcfgError):
    """A sealed file that is cut, changed, or nothing of the kind: no passphrase would open it."""

    exit = ExitCode.FAILED


class SealTooLarge(NetcfgError):
    """Opening it takes more than this computer has; nothing is wrong with the file."""

    exit = ExitCode.FAILED


class RecipientRefused(UsageError):
    """A text that is no key which files can be encrypted to."""
