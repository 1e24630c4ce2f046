"""The ways to a device's console: over SSH at an address, or over a serial line; and who the device is."""

from __future__ import annotations

import asyncio
import socket
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.console.serial_line import open_serial
from atlantis_netcfg.console.ssh import host_key_of, open_ssh
from atlantis_netcfg.console.types import ConsoleUnreachable
from atlantis_netcfg.routeros.api import Endpoint, Session, Unreachable

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.bootstrap import Way, Wish
    from atlantis_netcfg.console.types import Console
    from atlantis_netcfg.core.secret import Secret

__all__ = ["SSH_PORT", "HostKey", "SerialWay", "SshWay", "Ways"]

SSH_PORT = 22
"""Of service `ssh`; neither the factory nor the site's template moves it."""
_KNOCK_S = 5.0
"""On a cable a device that is there answers at once."""
_CABLE_S = 60.0


@dataclass(slots=True)
class HostKey:
    """The host key that the device must show; the first one that it shows, where none is known."""

    known: str | None


@dataclass(slots=True)
class SshWay:
    """An address; `locate` tells where a service port of it really is (a twin's is on loopback)."""

    shown: str
    wish: Wish
    key: HostKey
    locate: Callable[[int], tuple[str, int]]
    serial: bool = False

    def open(self, user: str, password: Secret) -> Console:
        """Log in; a host key that nobody knows yet is taken from the first session, which sends no password."""
        self.meet()
        address, port = self.locate(SSH_PORT)
        return open_ssh(address, port, user, password, pin=self.key.known, timeout_s=_CABLE_S)

    def meet(self) -> None:
        """See who is there, and remember the host key if none is known; nothing is logged in to."""
        address, port = self._knock()
        if self.key.known is not None:
            return
        self.key.known = host_key_of(address, port, _CABLE_S)

    def prove(self, pin: str) -> None:
        """Log in by api-ssl as our user under this certificate."""
        try:
            asyncio.run(self._log_in(pin))
        except Unreachable as nobody:
            raise ConsoleUnreachable(str(nobody), hint=nobody.hint) from nobody

    async def _log_in(self, pin: str) -> None:
        host, port = self.locate(self.wish.api_port)
        endpoint = Endpoint(host, port, self.wish.user, self.wish.password, pin, connect_timeout_s=_KNOCK_S)
        session = await Session.open(endpoint)
        await session.close()

    def _knock(self) -> tuple[str, int]:
        """Find out soon whether anybody is there: an SSH server says its name at once."""
        address, port = self.locate(SSH_PORT)
        try:
            with socket.create_connection((address, port), timeout=_KNOCK_S) as knock:
                if not knock.recv(1):
                    raise ConnectionResetError("closed at once")
        except OSError as error:
            raise ConsoleUnreachable(
                f"{self.shown}: nobody answers on the SSH port ({error.strerror or error})",
                hint="is the laptop plugged into the right port of the device, with an address of that network "
                f"(for {self.shown}: another address that begins with {self.shown.rpartition('.')[0]}.)?",
            ) from error
        return address, port


@dataclass(slots=True)
class SerialWay:
    """A serial line; it proves nothing about api-ssl."""

    shown: str
    serial: bool = True

    def open(self, user: str, password: Secret) -> Console:
        """Log in."""
        return open_serial(self.shown, user, password, timeout_s=_CABLE_S)

    def prove(self, pin: str) -> None:
        """Refuse: there is no TLS on a serial line."""
        raise ConsoleUnreachable(f"certificate {pin[:16]}… cannot be tried over {self.shown}")

    def meet(self) -> None:
        """Nothing: a serial line has no host key, and RouterOS does not print its own."""


@dataclass(slots=True)
class Ways:
    """Where the technician has plugged in, and the management address."""

    first: Way
    final: Way
    key: HostKey

    @property
    def host_key(self) -> str | None:
        """The host key of the device, once known."""
        return self.key.known
