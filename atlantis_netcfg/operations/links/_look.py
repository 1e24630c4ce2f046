"""One look at every bearer of a site: all boxes at once, nothing changed, and what each of them said put together."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.bearers.policy import active_bearers
from atlantis_netcfg.bearers.satellite import judge_names
from atlantis_netcfg.core.errors import NetcfgError, NothingMatched
from atlantis_netcfg.declaration.model import BearerKind, Cpe, LteDriver, LteRouter, Router
from atlantis_netcfg.journal import MonthBytes, Store
from atlantis_netcfg.operations.allow_list_test import named_targets, resolve
from atlantis_netcfg.operations.bearers import PATIENCE_S
from atlantis_netcfg.operations.costs import ways_of
from atlantis_netcfg.operations.links._ask import Round, boxes
from atlantis_netcfg.operations.links._bearer import Seen, ranked, told, twice
from atlantis_netcfg.operations.links._counted import bills, months, ping_bytes
from atlantis_netcfg.operations.links._looked import Looked
from atlantis_netcfg.operations.links._own import Own, Silent, of_bridge
from atlantis_netcfg.operations.links._router import RouterReading
from atlantis_netcfg.operations.links._terminal import kept_off, of_terminal
from atlantis_netcfg.operations.links._unit import UnitLook, of_unit

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from atlantis_netcfg.bearers import BearerStatus, Finding
    from atlantis_netcfg.bearers.policy import Way
    from atlantis_netcfg.core.events import Subscriber
    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.declaration.model import Bearer
    from atlantis_netcfg.operations.request import Request

__all__ = ["Looked", "look"]


async def look(  # noqa: PLR0913, PLR0917 - all that a command line says
    declaration: Declaration,
    site: str,
    chosen: Sequence[Host],
    request: Request,
    notify: Subscriber,
    patience_s: float = PATIENCE_S,
) -> Looked:
    """Look at a site; of its boxes only those `chosen` are asked, and of a bridge with one end the other one, too.

    What does not answer is a finding and no error; `patience_s`: for a connection to a device over a fast link. Raises
    NothingMatched for a site without a router.
    """
    router = next((one for one in declaration.site_hosts(site) if isinstance(one.device, Router)), None)
    if router is None:
        raise NothingMatched(f"site `{site}` has no router, and only a router knows its links")
    ways = ways_of(declaration, router)
    began = datetime.now(UTC)
    turn = Round(declaration, router, request, notify, patience_s)
    await turn.ask(tuple(boxes(declaration, router)), _with_far_ends(declaration, chosen), ways)
    moved = {} if request.rehearsed else await _names(declaration, site)
    return _Site(declaration, router, ways, turn, request, began, datetime.now(UTC), moved).put_together()


async def _names(declaration: Declaration, site: str) -> dict[str, tuple[Finding, ...]]:
    """Ask this computer whether the names of each satellite's allow-list are still where it says."""
    found = {}
    for bearer in declaration.sites[site].bearers:
        targets = named_targets(declaration, site, bearer)
        resolved = await resolve(target.dns_name for target in targets)
        found[bearer.name] = judge_names(targets, resolved, "this computer")
    return found


def _with_far_ends(declaration: Declaration, chosen: Sequence[Host]) -> list[Host]:
    peers = [declaration.hosts.get(one.device.ptp.peer) for one in chosen if isinstance(one.device, Cpe)]
    return [*chosen, *(one for one in peers if one is not None)]


def _told(seen: Sequence[Seen]) -> list[BearerStatus]:
    shared = twice(seen)
    return [_with(told(one), [finding for name, finding in shared if name == one.way.name]) for one in seen]


def _with(status: BearerStatus, more: list[Finding]) -> BearerStatus:
    return replace(status, findings=(*status.findings, *more))


@dataclass(slots=True)
class _Site:
    declaration: Declaration
    router: Host
    ways: tuple[Way, ...]
    turn: Round
    request: Request
    began: datetime
    now: datetime
    moved: Mapping[str, tuple[Finding, ...]]
    """Bearer to what is to be said of the names in its allow-list."""
    notes: list[str] = field(default_factory=list)

    def put_together(self) -> Looked:
        """Judge what was heard, and keep the counters."""
        site = self.declaration.sites[self.router.site]
        month = self._months()
        active = self._active()
        seen = [
            Seen(
                way=way,
                router=self._answer(self.router),
                own=self._own(way, bearer),
                active=None if active is None else way.name in active,
                month_bytes=month[way.name].bytes,
                box=bearer.device,
                next_hop=str(bearer.gateway),
                network=bearer.network,
                powered=self._powered(bearer),
            )
            for way, bearer in zip(self.ways, site.bearers, strict=True)
        ]
        return Looked(
            bearers=ranked(_told(seen), site.failover.fail_back_s),
            boxes={bearer.name: self._boxes(bearer) for bearer in site.bearers},
            months=month,
            probe_bytes={one.way.name: ping_bytes(self.ways)[one.way.name] for one in seen if one.echoes},
            unreachable=self.turn.silent,
            not_asked=dict(self.turn.not_asked),
            round_trips={name: door.round_trips for name, door in self.turn.doors.items()},
            asked=tuple(self.turn.answers),
            bills=bills(self.turn, active, (self.now - self.began).total_seconds()),
            notes=tuple(self.notes),
        )

    @property
    def _reading(self) -> RouterReading | None:
        answer = self._answer(self.router)
        return answer if isinstance(answer, RouterReading) else None

    def _answer(self, host: Host | None) -> Any:  # noqa: ANN401 - a reading of the host's kind, Silent or None
        return None if host is None else self.turn.answers.get(host.name)

    def _active(self) -> tuple[str, ...] | None:
        reading = self._reading
        return None if reading is None or reading.routes is None else active_bearers(reading.routes, self.ways)

    def _own(self, way: Way, bearer: Bearer) -> Own:
        box = self.declaration.hosts.get(bearer.device or "")
        if bearer.kind is BearerKind.SATELLITE:
            own = self._terminal(box)
            findings = (*own.findings, *self.moved.get(bearer.name, ()))
            return replace(own, quality=kept_off(bearer, way.port, self._reading) | own.quality, findings=findings)
        if box is not None and isinstance(box.device, Cpe):
            far = self.declaration.hosts.get(box.device.ptp.peer)
            return of_bridge((box, self._answer(box)), None if far is None else (far, self._answer(far)))
        if box is not None and isinstance(box.device, LteRouter):
            return self._unit(box, box.device)
        return Own()

    def _unit(self, box: Host, device: LteRouter) -> Own:
        """Of a unit that only a person can look at its driver says so without being asked."""
        answer = self._answer(box)
        if isinstance(answer, Silent):
            return Own(silent=(answer,))
        if device.driver is LteDriver.MANUAL:
            found = self.turn.unit(box, device).look()
            answer = UnitLook(found.reading, found.findings)
        return Own() if answer is None else of_unit(box.name, answer, device.driver, forwards=self._forwards)

    @property
    def _forwards(self) -> bool:
        return isinstance(self.router.device, Router) and bool(self.router.device.forwards)

    def _terminal(self, box: Host | None) -> Own:
        store = Store(self.request.state, rehearsed=self.request.rehearsed)
        try:
            return of_terminal(self.declaration, box, store, self.now.astimezone().date())
        except NetcfgError as error:
            self.notes.append(str(error))
            return Own()

    def _boxes(self, bearer: Bearer) -> str:
        box = self.declaration.hosts.get(bearer.device or "")
        if box is not None and isinstance(box.device, Cpe):
            return f"{box.name} to {box.device.ptp.peer}"
        if box is not None and isinstance(box.device, LteRouter):
            return f"{box.name} ({box.device.driver.value})"
        return bearer.device or ""

    def _powered(self, bearer: Bearer) -> str | None:
        box = self.declaration.hosts.get(bearer.device or "")
        source = getattr(box.device, "powered_by", None) if box is not None else None
        return source.port if source is not None and source.device == self.router.name else None

    def _months(self) -> dict[str, MonthBytes]:
        usage = Store(self.request.state, rehearsed=self.request.rehearsed).usage(self.router.site)
        try:
            return months(usage, self.router.name, self._reading, self.ways, self.now)
        except NetcfgError as error:
            self.notes.append(f"the bytes of this month are not known: {error}")
            return dict.fromkeys((way.name for way in self.ways), MonthBytes())
