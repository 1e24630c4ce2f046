"""How a talk with a RutOS unit can fail; every text is for a person, and none holds a password or a token."""

from __future__ import annotations

from atlantis_netcfg.core.errors import DeviceFailed

__all__ = [
    "CertificateChanged",
    "CertificateUnknown",
    "NotOffered",
    "RutosLoginFailed",
    "RutosRefused",
    "RutosUnreachable",
]


class RutosUnreachable(DeviceFailed):
    """Nobody answers, or the answer broke off; only reads were sent."""


class CertificateUnknown(DeviceFailed):
    """The unit was never met; it showed `fingerprint`, and no password was sent."""

    def __init__(self, message: str, *, fingerprint: str, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.fingerprint = fingerprint


class CertificateChanged(DeviceFailed):
    """The certificate is not the pinned one; no password was sent."""


class RutosLoginFailed(DeviceFailed):
    """The unit did not take name and password."""


class RutosRefused(DeviceFailed):
    """The unit refused a read, or answered in a way that we cannot read."""


class NotOffered(RutosRefused):
    """This firmware has no such page: HTTP 404, 405 or 501."""
