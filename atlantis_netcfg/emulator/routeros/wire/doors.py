"""The listening sockets: one on loopback for each emulated service, moving as `/ip/service` says."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from atlantis_netcfg.emulator.routeros.device import Service

__all__ = ["HOST", "SERVICES", "Doors"]

HOST = "127.0.0.1"
SERVICES = ("api", "api-ssl", "ssh")


class Doors:
    """`ports` wishes a loopback port for a service's port (8728, 8729, ...); without a wish the kernel chooses one.

    A service's port that comes back finds the loopback port it had before.
    """

    def __init__(self, visitor: Callable[[str], asyncio.Protocol], ports: Mapping[int, int]) -> None:
        self._visitor = visitor
        self._loopback = dict(ports)
        self._open: dict[tuple[str, int], asyncio.Server] = {}

    async def align(self, services: Mapping[str, Service]) -> None:
        """Open and close sockets until they are as `services` says."""
        wanted = {(name, services[name].port) for name in SERVICES if name in services and services[name].enabled}
        for key in set(self._open) - wanted:
            self._open.pop(key).close()
        for key in sorted(wanted - set(self._open)):
            await self._listen(key)

    async def _listen(self, key: tuple[str, int]) -> None:
        name, port = key
        loop = asyncio.get_running_loop()
        server = await loop.create_server(lambda: self._visitor(name), HOST, self._loopback.get(port, 0))
        self._loopback[port] = server.sockets[0].getsockname()[1]
        self._open[key] = server

    @property
    def ports(self) -> dict[str, int]:
        """Loopback port of each service that listens."""
        return {name: self._loopback[port] for name, port in sorted(self._open)}

    @property
    def port_map(self) -> dict[int, int]:
        """Loopback port by the port that `/ip/service` shows."""
        return {port: self._loopback[port] for _, port in sorted(self._open)}

    def close(self) -> None:
        """Stop listening; connections live on."""
        for server in self._open.values():
            server.close()
        self._open.clear()
