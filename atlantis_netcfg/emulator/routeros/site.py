"""All emulated routers of a site, from one specification in plain JSON."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

from atlantis_netcfg.emulator.routeros.radio import RadioLink
from atlantis_netcfg.emulator.routeros.router import EmulatedRouter

if TYPE_CHECKING:
    from pathlib import Path
    from types import TracebackType

    from atlantis_netcfg.emulator.routeros.spec import SiteSpec


class EmulatedSite:
    """The emulated routers of `spec`, each with a folder below `state_dir`; `async with` starts and stops them."""

    def __init__(self, spec: SiteSpec, state_dir: Path) -> None:
        self.spec = spec
        self.routers = {
            emulator.router.name: EmulatedRouter(
                emulator.router,
                state_dir=state_dir / emulator.router.name,
                link=emulator.link,
                knobs=emulator.knobs,
                ports=emulator.ports,
            )
            for emulator in spec.emulators
        }
        self.links = tuple(RadioLink(pair, self.routers[pair.near], self.routers[pair.far]) for pair in spec.pairs)
        self._running: list[EmulatedRouter] = []

    async def start(self) -> None:
        """Start all routers, or none."""
        try:
            for router in self.routers.values():
                await router.start()
                self._running.append(router)
            for link in self.links:
                link.start()
        except BaseException:
            await self.stop()
            raise

    async def stop(self) -> None:
        """Stop all routers; errors inside them are raised together."""
        failures: list[Exception] = []
        for link in self.links if len(self._running) == len(self.routers) else ():
            link.stop()
        while self._running:
            try:
                await self._running.pop().stop()
            except Exception as failure:  # noqa: BLE001 (the other emulators have to be stopped, too)
                failures.append(failure)
        if failures:
            raise ExceptionGroup(f"twins of {self.spec.name}", failures)

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.stop()

    def describe(self) -> dict[str, Any]:
        """Return the addresses of all routers, as JSON-able data."""
        return {name: describe(router) for name, router in self.routers.items()}


def describe(router: EmulatedRouter) -> dict[str, Any]:
    """Return the addresses of one router; a service that does not listen is null."""
    return {
        "host": router.host,
        "api": router.ports.get("api"),
        "api_ssl": router.ports.get("api-ssl"),
        "ssh": router.ports.get("ssh"),
        "host_key": router.host_key,
        "serial": router.serial,
        "ports": {str(service): loopback for service, loopback in router.port_map.items()},
        "pin": router.pin,
        "address": router.spec.management.local,
        "first_contact": None
        if router.spec.first_contact is None
        else {
            "address": router.spec.first_contact.local,
            "ports": {str(service): loopback for service, loopback in router.first_contact_ports.items()},
        },
    }
