"""Readings of the 4G unit, by the driver of `provision links`, and the link that carries the traffic.

Both are requested over the site's network: nothing goes over the surveyed link. No probe target is pinged.
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core import errors
from atlantis_netcfg.core.events import ignore
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.links.policy import ROUTE_PROPERTIES, active_link
from atlantis_netcfg.operations.common.costs import ways_of
from atlantis_netcfg.operations.links.collect import session_to
from atlantis_netcfg.operations.links.session import rows
from atlantis_netcfg.operations.links.status import read_by_driver, read_routeros
from atlantis_netcfg.operations.lte.units import LteUnit
from atlantis_netcfg.records.survey.measure import RadioSample
from atlantis_netcfg.routeros.api import Command

if TYPE_CHECKING:
    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.links.lte import LteReading
    from atlantis_netcfg.operations import Request
    from atlantis_netcfg.runs import Store

_ROUTES = Command("/ip/route/print", ((".proplist", ",".join(ROUTE_PROPERTIES)),), ("?dst-address=0.0.0.0/0",))
_ROUTER_S = 5.0
BY_HAND = "`driver: manual`: check its own web page"


def find_survey_link(inventory: Inventory, site: str, name: str | None) -> model.Link:
    """Return the site's 4G link of that name, or its only one. Raises UsageError."""
    links = {link.name: link for link in inventory.sites[site].bearers if link.kind is model.LinkKind.LTE}
    choices = msg(f"its 4G links: {arg(join(', ', links))}" if links else "it has no 4G link")
    if name is None and len(links) == 1:
        return next(iter(links.values()))
    if name in links:
        return links[name]
    if name is None:
        raise errors.UsageError(
            f"`{arg(site)}` does not have exactly one 4G link: {arg(choices)}", hint="say which one: `link=4g`"
        )
    near = errors.nearest(name, links)
    raise errors.UsageError(
        f"`link={arg(name)}` is not a 4G link of `{arg(site)}`: {arg(choices)}",
        hint=f"did you mean `link={arg(near)}`?" if near else "a survey reads a 4G unit",
    )


def find_lte_unit(inventory: Inventory, link: model.Link) -> Host:
    """Return the device of a 4G link. Raises UsageError if the inventory has none."""
    host = inventory.hosts.get(link.device or "")
    if host is None or not isinstance(host.device, model.LteRouter):
        raise errors.UsageError(
            f"link `{arg(link.name)}` has no 4G unit that can be read",
            hint="add its 4G unit to the inventory, and set `device:` of the link (docs/4g.md)",
        )
    return host


@dataclass(slots=True)
class UnitRadio:
    """Reads the 4G unit, and the active routes from the router of its site."""

    inventory: Inventory
    host: Host
    request: Request
    store: Store
    router: Host | None = None
    """None: the active link is not queried."""

    def read(self) -> RadioSample:
        """See `RadioReader.read`."""
        return asyncio.run(self._radio())

    def carried_by(self) -> str | None:
        """See `RadioReader.carried_by`; sends one request to the router in a separate session."""
        return None if self.router is None else asyncio.run(self._carried_by(self.router))

    async def _radio(self) -> RadioSample:
        device = self.host.device
        assert isinstance(device, model.LteRouter)  # noqa: S101 - `find_lte_unit` checks it
        if device.driver is model.LteDriver.MANUAL:
            return RadioSample(no_radio=BY_HAND)
        target = self.request.targets.get(self.host.name)
        unit = LteUnit(self.host, device, self.store, ignore, self.request.rehearsed, target)
        try:
            if device.driver is model.LteDriver.ROUTEROS:
                door = session_to(self.inventory, self.host.site, self.host, self.request)
                return sample_of((await read_routeros(door, unit)).reading)
            return sample_of((await read_by_driver(unit)).reading)
        except errors.NetcfgError as error:
            return RadioSample(no_radio=str(error))

    async def _carried_by(self, router: Host) -> str | None:
        with suppress(errors.NetcfgError, TimeoutError):
            door = session_to(self.inventory, router.site, router, self.request)
            async with asyncio.timeout(_ROUTER_S), door.open_session() as session:
                answers = rows(await session.command(_ROUTES))
            return None if answers is None else active_link(answers, ways_of(self.inventory, router))
        return None


def facts_of(sample: RadioSample) -> dict[str, str]:
    """Return the values reported by the unit as text, by label."""
    levels = (("RSRP", sample.rsrp_dbm, "dBm"), ("RSRQ", sample.rsrq_db, "dB"), ("SINR", sample.sinr_db, "dB"))
    words = {
        "4G unit": msg(f"not read: {arg(sample.no_radio)}") if sample.no_radio else None,
        "4G registration": None if sample.registration is None else msg(sample.registration.replace("_", " ")),
        "4G technology": sample.technology,
        "4G operator": sample.operator,
        "4G band": sample.band,
        "4G cell": sample.cell,
        **{name: None if value is None else f"{value:g} {unit}" for name, value, unit in levels},
    }
    return {label: value for label, value in words.items() if value is not None}


def sample_of(reading: LteReading) -> RadioSample:
    """Convert a reading to the sample that a survey stores."""
    return RadioSample(
        registration=reading.state.value,
        technology=reading.access_tech,
        operator=reading.operator,
        band=reading.band,
        cell=reading.cell,
        rsrp_dbm=reading.rsrp_dbm,
        rsrq_db=reading.rsrq_db,
        sinr_db=reading.sinr_db,
    )
