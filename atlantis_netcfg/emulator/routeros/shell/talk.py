"""What a console session needs of the device behind it, and the plainest one: a device with nothing in between."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.answers import Caller
    from atlantis_netcfg.emulator.routeros.device import Device, Printed


class ConsoleDevice(Protocol):
    """One caller's console. A method may never return: the connection under it has gone silent."""

    caller: Caller
    device: Device

    async def type(self, line: str, width: int | None) -> Printed:
        """Run a line."""

    async def safe_key(self, choice: str) -> Printed:
        """Press Ctrl+X, or answer its question."""

    async def confirm(self, line: str) -> Printed:
        """Run a line whose question was answered with yes."""

    async def set_password(self, password: str) -> str:
        """Give the caller a new password; the refusal, or nothing."""

    async def remove_defaults(self) -> None:
        """Take the default configuration away."""


class DirectTalk:
    """No link, no faults."""

    def __init__(self, device: Device, caller: Caller) -> None:
        self.device = device
        self.caller = caller

    async def type(self, line: str, width: int | None) -> Printed:
        """Run a line."""
        return self.device.type(self.caller, line, width=width)

    async def safe_key(self, choice: str) -> Printed:
        """Press Ctrl+X, or answer its question."""
        return self.device.safe_key(self.caller, choice)

    async def confirm(self, line: str) -> Printed:
        """Run a line whose question was answered with yes."""
        return self.device.type(self.caller, line, confirmed=True)

    async def set_password(self, password: str) -> str:
        """Give the caller a new password; the refusal, or nothing."""
        return self.device.set_password(self.caller, password)

    async def remove_defaults(self) -> None:
        """Take the default configuration away."""
        self.device.remove_defaults(self.caller)
