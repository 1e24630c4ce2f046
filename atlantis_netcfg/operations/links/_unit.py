"""The 4G unit of a site, read by its driver; every driver gives the same record."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers.lte import LteReading, Registration, at, modemmanager, routeros, rutos
from atlantis_netcfg.errors import UsageError
from atlantis_netcfg.journal import Store
from atlantis_netcfg.operations.links._door import command, rows
from atlantis_netcfg.site.model import LteDriver

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping

    from atlantis_netcfg.bearers import Finding
    from atlantis_netcfg.operations.links._door import Door
    from atlantis_netcfg.operations.request import Request
    from atlantis_netcfg.routeros._types import Row
    from atlantis_netcfg.routeros.api import Reply
    from atlantis_netcfg.site import Host
    from atlantis_netcfg.site.model import LteRouter

__all__ = ["Unit", "UnitLook", "read_unit"]

_INTERFACE = "lte1"
"""RouterOS' factory name of the one modem that a unit has."""
_HTTPS = 443


@dataclass(frozen=True, slots=True)
class Unit:
    """A 4G unit and the way to it."""

    host: Host
    device: LteRouter
    request: Request
    door: Door | None
    """Driver `routeros`."""
    requests: dict[str, int]
    """Where to note how many were sent, by host name."""


@dataclass(frozen=True, slots=True)
class UnitLook:
    """What a unit said."""

    reading: LteReading
    findings: tuple[Finding, ...] = ()
    """What its driver has to say besides."""


async def read_unit(unit: Unit) -> UnitLook:
    """Read it, changing nothing. Raises NetcfgError."""
    return await _DRIVERS[unit.device.driver](unit)


async def _routeros(unit: Unit) -> UnitLook:
    """One session of two round trips, three where only the log tells of the SIM."""
    assert unit.door is not None  # noqa: S101 - every unit of this driver has one
    async with unit.door.opened() as session:
        replies = await session.flight([command(query) for query in routeros.queries(_INTERFACE)])
        reading = _reading(replies)
        if reading.state is Registration.UNKNOWN:
            reading = _reading(replies, rows(await session.command(command(routeros.log_query()))))
    return UnitLook(reading)


def _reading(replies: list[Reply], log: tuple[Row, ...] | None = None) -> LteReading:
    monitor, interfaces, profiles, addresses = (rows(reply) for reply in replies)
    return routeros.read(monitor[0] if monitor else None, interfaces, profiles, addresses, log, _INTERFACE)


async def _rutos(unit: Unit) -> UnitLook:
    """Over HTTPS, in a thread: its reader waits for answers."""
    pins = Store(unit.request.state, rehearsed=unit.request.rehearsed).pins
    endpoint = _rutos_endpoint(unit, pins.get(unit.host.name))
    try:
        found = await asyncio.to_thread(rutos.read, endpoint)
    except rutos.CertificateUnknown as unknown:
        pins.pin(unit.host.name, unknown.fingerprint)
        found = await asyncio.to_thread(rutos.read, replace(endpoint, pin=unknown.fingerprint))
    unit.requests[unit.host.name] = found.requests
    return UnitLook(found.reading)


def _rutos_endpoint(unit: Unit, pin: str | None) -> rutos.RutosEndpoint:
    access = unit.device.access
    assert access is not None  # noqa: S101 - without it the unit is not asked
    if unit.request.rehearsed:
        target = unit.request.targets[unit.host.name]
        return rutos.RutosEndpoint(target.host, target.port, access.user, access.password, target.pin)
    return rutos.RutosEndpoint(str(unit.device.address), access.port or _HTTPS, access.user, access.password, pin)


async def _at(unit: Unit) -> UnitLook:
    """On a serial port of this computer; a modem in another host is read there."""
    _require_here(unit)
    assert unit.device.serial is not None  # noqa: S101 - site/rules/lte.py
    found = await asyncio.to_thread(at.read, unit.device.serial)
    unit.requests[unit.host.name] = found.commands
    return UnitLook(found.reading)


async def _modemmanager(unit: Unit) -> UnitLook:
    """The only modem of this computer's ModemManager."""
    _require_here(unit)
    found = await asyncio.to_thread(modemmanager.read)
    unit.requests[unit.host.name] = found.calls
    return UnitLook(found.reading, found.findings)


def _require_here(unit: Unit) -> None:
    if unit.device.host is not None:
        raise UsageError(
            f"{unit.host.name}: its modem is in {unit.device.host}, and is not read from here",
            hint="run `provision links` on the computer that has the modem, with `host` left out",
        )


_DRIVERS: Mapping[LteDriver, Callable[[Unit], Awaitable[UnitLook]]] = {
    LteDriver.ROUTEROS: _routeros,
    LteDriver.RUTOS: _rutos,
    LteDriver.AT: _at,
    LteDriver.MODEMMANAGER: _modemmanager,
}
