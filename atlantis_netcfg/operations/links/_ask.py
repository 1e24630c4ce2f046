"""Whom a look at the links of a site asks, and how; whoever is not asked is named, with the reason."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.errors import NetcfgError, complete
from atlantis_netcfg.core.events import Event, Stage
from atlantis_netcfg.declaration.model import Cpe, LteDriver, LteRouter, Router, SatelliteTerminal
from atlantis_netcfg.journal import Store
from atlantis_netcfg.operations.bearers import FAST_S, PATIENCE_S, bearer_of
from atlantis_netcfg.operations.jobs import endpoint_of
from atlantis_netcfg.operations.kinds import handled, managed
from atlantis_netcfg.operations.links._door import Door
from atlantis_netcfg.operations.links._own import Silent
from atlantis_netcfg.operations.links._radio import read_radio
from atlantis_netcfg.operations.links._router import read_router
from atlantis_netcfg.operations.links._unit import UnitLook, read_by_driver, read_routeros
from atlantis_netcfg.operations.lte import Unit

if TYPE_CHECKING:
    from collections.abc import Awaitable, Iterator, Sequence

    from atlantis_netcfg.bearers.policy import Way
    from atlantis_netcfg.core.events import Subscriber
    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.operations.request import Request
    from atlantis_netcfg.routeros.estimate import Bearer

__all__ = ["Round", "boxes", "door_to"]


@dataclass(slots=True)
class Round:
    """All questions of one look; `ask` sends them to all devices at once."""

    declaration: Declaration
    router: Host
    """Of the site that is looked at."""
    request: Request
    notify: Subscriber
    patience_s: float = PATIENCE_S
    answers: dict[str, Any] = field(default_factory=dict)
    """Host name to its reading, or to Silent."""
    not_asked: dict[str, str] = field(default_factory=dict)
    """Host name to the reason."""
    doors: dict[str, Door] = field(default_factory=dict)
    """Host name to what was spent on it; RouterOS devices only."""

    async def ask(self, hosts: Sequence[Host], chosen: Sequence[Host], ways: Sequence[Way]) -> None:
        """Ask every host that is `chosen` and can be asked, all at the same time."""
        names = {host.name for host in chosen}
        work = []
        for host in hosts:
            reason = self._why_not(host) if host.name in names else "left out by `only=`"
            if reason is None:
                work.append(self._one(host, ways))
            else:
                self.not_asked[host.name] = reason
        await asyncio.gather(*work)

    @property
    def silent(self) -> tuple[Silent, ...]:
        """Who was asked and did not answer."""
        return tuple(answer for answer in self.answers.values() if isinstance(answer, Silent))

    def _why_not(self, host: Host) -> str | None:
        """Why a host is not to be asked; None if it is."""
        device = host.device
        if isinstance(device, SatelliteTerminal):
            return "no machine interface of it is documented: a person looks at its pages"
        if isinstance(device, LteRouter) and device.driver is LteDriver.MANUAL:
            return "`driver: manual`: a person looks at its own page"
        if not handled(host) and not isinstance(device, LteRouter):
            return f"nobody reads a {device.kind.replace('_', ' ')} yet"
        missing = self.request.rehearsed and host.name not in self.request.targets
        return "it is not emulated in this rehearsal" if missing else None

    async def _one(self, host: Host, ways: Sequence[Way]) -> None:
        self.notify(Event(host.name, Stage.CONNECTING, "to be read, not changed"))
        try:
            self.answers[host.name] = await self._reading(host, ways)
        except NetcfgError as error:
            self.answers[host.name] = Silent(
                host.name, str(error), error.hint and complete(error.hint, site=host.site, device=host.name)
            )
            self.notify(Event(host.name, Stage.FAILED, str(error)))
        else:
            self.notify(Event(host.name, Stage.DONE, self._spent(host.name)))

    def _reading(self, host: Host, ways: Sequence[Way]) -> Awaitable[Any]:
        if isinstance(host.device, Router):
            return read_router(self._door(host), ways)
        if isinstance(host.device, Cpe):
            return read_radio(self._door(host))
        assert isinstance(host.device, LteRouter)  # noqa: S101 - `boxes` yields no other kind that can be asked
        unit = self.unit(host, host.device)
        if host.device.driver is LteDriver.ROUTEROS:
            return read_routeros(self._door(host), unit)
        return read_by_driver(unit)

    def carrier(self, host: Host) -> Bearer:
        """What a session to a host goes over; to the far end of a bridge, what leads to the site that is looked at.

        Raises UsageError for a link that its site does not have.
        """
        return _carrier(self.declaration, self.router, host, self.request)

    def unit(self, host: Host, device: LteRouter) -> Unit:
        """A 4G unit as its driver wants it."""
        store = Store(self.request.state, rehearsed=self.request.rehearsed)
        target = self.request.targets.get(host.name)
        return Unit(host, device, store, self.notify, self.request.rehearsed, target)

    def _door(self, host: Host) -> Door:
        """Raises UsageError for a link that its site does not have."""
        made = door_to(self.declaration, self.router.site, host, self.request, self.patience_s)
        self.doors[host.name] = made
        return made

    def _spent(self, name: str) -> str:
        answer = self.answers[name]
        if name in self.doors:
            door = self.doors[name]
            return f"read in {door.round_trips} round trips, {door.bytes / 1000:.1f} kB"
        return f"read in {answer.requests} requests" if isinstance(answer, UnitLook) else "read"


def door_to(declaration: Declaration, site: str, host: Host, request: Request, patience_s: float = PATIENCE_S) -> Door:
    """The way to a RouterOS device for one who is at a site, or looks at it from afar; nothing is opened yet.

    `patience_s`: for a connection over a fast link. Raises NothingMatched for a device of another kind, UsageError for
    a link that its site does not have, and for one that a rehearsal has no twin of.
    """
    endpoint = endpoint_of(host, managed(declaration, host).access, request)
    router = next((one for one in declaration.site_hosts(site) if isinstance(one.device, Router)), host)
    if _carrier(declaration, router, host, request).rtt_s < FAST_S:
        endpoint = replace(endpoint, connect_timeout_s=patience_s)
    return Door(host.name, endpoint)


def _carrier(declaration: Declaration, router: Host, host: Host, request: Request) -> Bearer:
    here = host if host.site == router.site else router
    return bearer_of(declaration, here, request.via.get(here.name))


def boxes(declaration: Declaration, router: Host) -> Iterator[Host]:
    """Yield the router and the boxes of its site's bearers, each once, both ends of a bridge among them."""
    yield router
    seen = {router.name}
    for bearer in declaration.sites[router.site].bearers:
        box = declaration.hosts.get(bearer.device or "")
        far = declaration.hosts.get(box.device.ptp.peer) if box and isinstance(box.device, Cpe) else None
        for host in (box, far):
            if host is not None and host.name not in seen:
                seen.add(host.name)
                yield host
