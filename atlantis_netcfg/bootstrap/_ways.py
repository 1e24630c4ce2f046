"""What the executor asks of the ways to a device; `operations` has the real ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from atlantis_netcfg.console.types import Console
    from atlantis_netcfg.core.secret import Secret

__all__ = ["Doorway", "Way"]


class Way(Protocol):
    """A way to a device's console."""

    shown: str
    """As a person would say it: an address, or a serial line."""
    serial: bool

    def open(self, user: str, password: Secret) -> Console:
        """Log in. Raises ConsoleUnreachable, LoginFailed, HostKeyChanged, ConsoleLost."""

    def prove(self, pin: str) -> None:
        """Log in by api-ssl as our user, under this certificate alone. Raises ConsoleUnreachable, NetcfgError."""

    def meet(self) -> None:
        """Learn the SSH host key, without a login, if it is not known yet. Raises NetcfgError."""


class Doorway(Protocol):
    """The two ways, and what is known of the device."""

    first: Way
    """Where the technician has plugged in."""
    final: Way
    """The management address."""

    @property
    def host_key(self) -> str | None:
        """The host key that the device has shown; None as long as nobody came by SSH."""
