"""The 4G unit of a site, read by its driver; every driver gives the same record."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers.lte import Registration, judge, routeros
from atlantis_netcfg.bearers.satellite import judge_carrier_nat
from atlantis_netcfg.declaration.model import LteDriver
from atlantis_netcfg.operations.links._door import command, rows
from atlantis_netcfg.operations.links._own import Own

if TYPE_CHECKING:
    from atlantis_netcfg.bearers import Finding
    from atlantis_netcfg.bearers.lte import LteReading
    from atlantis_netcfg.operations.links._door import Door
    from atlantis_netcfg.operations.lte import Unit
    from atlantis_netcfg.routeros._types import Row
    from atlantis_netcfg.routeros.api import Reply, Session

__all__ = ["UnitLook", "modem_reading", "of_unit", "read_by_driver", "read_routeros"]

_INTERFACE = "lte1"
"""RouterOS' factory name of the one modem that a unit has."""


@dataclass(frozen=True, slots=True)
class UnitLook:
    """What a unit said, and what its driver says of it."""

    reading: LteReading
    findings: tuple[Finding, ...]
    requests: int | None = None
    """Sent to it by a driver that counts requests."""


async def read_routeros(door: Door, unit: Unit) -> UnitLook:
    """Read in one session. Raises DeviceFailed.

    Where a run has tried the declared PIN and the SIM still asks for one, the PIN is wrong, whatever the device says.
    """
    async with door.opened() as session:
        reading = await modem_reading(session)
    if reading.state is Registration.SIM_PIN_REQUIRED and unit.pin_tried:
        reading = replace(reading, pin_refused=True)
    return UnitLook(reading, judge.judge(reading, unit.wanted))


async def modem_reading(session: Session) -> LteReading:
    """Read in one round trip; one more where only the log tells of the SIM, and one for a modem with another name."""
    replies = await session.flight([command(query) for query in routeros.queries(_INTERFACE)])
    name = routeros.modem_name(rows(replies[1]), _INTERFACE)
    if name != _INTERFACE:
        replies[0] = await session.command(command(routeros.monitor_query(name)))
    reading = _reading(replies)
    if reading.state is Registration.UNKNOWN:
        reading = _reading(replies, rows(await session.command(command(routeros.log_query()))))
    return reading


def _reading(replies: list[Reply], log: tuple[Row, ...] | None = None) -> LteReading:
    monitor, interfaces, profiles, addresses = (rows(reply) for reply in replies)
    return routeros.read(monitor[0] if monitor else None, interfaces, profiles, addresses, log, _INTERFACE)


async def read_by_driver(unit: Unit) -> UnitLook:
    """Read a unit of another make, in a thread: its driver waits for answers. Raises NetcfgError."""
    found = await asyncio.to_thread(unit.look)
    return UnitLook(found.reading, found.findings, found.requests)


def of_unit(name: str, told: UnitLook, driver: LteDriver, *, forwards: bool) -> Own:
    """Put into the words of its bearer. `forwards`: ports of the site's outer addresses are declared to lead inside."""
    reading = told.reading
    if driver is LteDriver.MANUAL:
        return Own(findings=told.findings)
    hidden = judge_carrier_nat(name, reading.address, forwards=forwards)
    nat = None if reading.address is None else "yes" if hidden else "no"
    found = (replace(finding, message=f"{name}: {finding.message}") for finding in told.findings)
    state = judge.link_state(reading)
    return Own(state, judge.quality(reading) | {"carrier_nat": nat}, (*found, *(hidden if forwards else ())))
