"""How a console session can fail; every text is for a person, and none holds what was typed."""

from __future__ import annotations

from atlantis_netcfg.core.errors import DeviceFailed

__all__ = [
    "ConsoleLost",
    "ConsoleRefused",
    "ConsoleUnreachable",
    "HostKeyChanged",
    "LoginFailed",
    "SafeModeHeld",
    "UnknownHostKey",
]


class ConsoleUnreachable(DeviceFailed):
    """No console came about (no route, no serial line, no answer); nothing was typed."""


class UnknownHostKey(DeviceFailed):
    """The device was never met over SSH; it showed `fingerprint`, and no password was sent."""

    def __init__(self, message: str, *, fingerprint: str, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.fingerprint = fingerprint


class HostKeyChanged(DeviceFailed):
    """The SSH host key is not the pinned one; no password was sent."""

    def __init__(self, message: str, *, pinned: str, seen: str, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.pinned = pinned
        self.seen = seen


class LoginFailed(DeviceFailed):
    """The device did not take name and password."""


class ConsoleRefused(DeviceFailed):
    """The device refused one command; `words` are its own, the session lives on."""

    def __init__(self, message: str, *, words: str, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.words = words


class ConsoleLost(DeviceFailed):
    """The session is over, or silent for too long. `in_flight`: a command was typed and may have been done."""

    def __init__(self, message: str, *, in_flight: bool, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.in_flight = in_flight


class SafeModeHeld(DeviceFailed):
    """Another session holds safe mode; it was left alone."""
