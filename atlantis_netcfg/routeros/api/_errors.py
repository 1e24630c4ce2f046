"""How a session can fail; every text is for a person and names the device, none holds an argument or a row."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceFailed

if TYPE_CHECKING:
    from atlantis_netcfg.routeros.api._values import Trap


class Unreachable(DeviceFailed):
    """No TLS session came about; nothing was sent to the device."""


class CertificateUnknown(DeviceFailed):
    """The device has a certificate, but we have no pin to compare it with; no login was sent."""

    def __init__(self, message: str, *, fingerprint: str, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.fingerprint = fingerprint


class CertificateChanged(DeviceFailed):
    """The certificate is not the pinned one (another device, a renewal, somebody in between); no login was sent."""

    def __init__(self, message: str, *, pinned: str, seen: str, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.pinned = pinned
        self.seen = seen


class LoginRefused(DeviceFailed):
    """The device refused name and password, or more sessions; the text ends with its words."""


class Refused(DeviceFailed):
    """The device refused one command; the session lives on."""

    def __init__(self, message: str, *, trap: Trap, path: str) -> None:
        super().__init__(message)
        self.trap = trap
        self.path = path


class SessionLost(DeviceFailed):
    """The session is over. `in_flight`: commands were sent and not answered, so that the device may have done them."""

    def __init__(self, message: str, *, in_flight: bool, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.in_flight = in_flight


class FellSilent(SessionLost):
    """The device owes an answer, and was waited for as long as was agreed; the session was dropped."""


class ProtocolError(SessionLost):
    """What came is not the API, or was cut off in the middle of a word; the session was dropped."""
