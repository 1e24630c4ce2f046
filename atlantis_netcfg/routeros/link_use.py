"""A link that carries the traffic of its site for a time (`provision use`): its routes, and the job that ends it.

While a link is in use its default routes have the smallest distances of all: 4 when the run has just written them, 5
once the job has cut the connections that began on other links, and 6 for the route that holds it. What netwatch does
when the link falls silent stays as it is: its routes go behind all others, and the next link as declared takes over.

The job `atlantis-use` runs every ten seconds. It alone says that a link is in use: once it is gone, the distances are a
difference from the declaration like any other. It ends the use by the uptime of the router, which no clock moves. An
uptime below that of the beginning means that the router was started anew: that ends the use too. Its start lies in
1970, so that it also runs while the clock of a router without battery is wrong.

Assumption: use-job-from-1970
Assumption: use-uptime-compares
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from atlantis_netcfg.routeros._items import Desired, RowItem, RunTime
from atlantis_netcfg.routeros.menus import MARK
from atlantis_netcfg.routeros.scheduler_jobs import MENU as SCHEDULER
from atlantis_netcfg.routeros.scheduler_jobs import USE

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from atlantis_netcfg.routeros._types import Observed, Row

ROUTES = "/ip/route"
TICK_S = 10
"""The job looks so often; the use ends so much earlier at most."""
SETTLED_S = 120
"""A router that was started later has not judged its links yet, and a second start could not be told from the first."""
_BEGUN, _IN_USE, _HOLDING = "4", "5", "6"
_OVERRIDES = frozenset({_BEGUN, _IN_USE, _HOLDING})
_DEFAULT = "0.0.0.0/0"
_JOB_STEP = RunTime(ROUTES, "distance", _BEGUN, _IN_USE)
"""What the first run of the job changes."""
_UNJUDGED = ", not probed"
_STAMP = "%Y-%m-%d %H:%M"
_COMMENT = re.compile(rf"{MARK}: (\S+) in use until (\d{{4}}-\d\d-\d\d \d\d:\d\d) UTC, uptime (\d+)s")


@dataclass(frozen=True, slots=True)
class LinkUse:
    """One link in use, as the comment of its job says it."""

    link: str
    until: datetime
    """By the clock of the computer that began it, in UTC."""
    until_uptime_s: int
    """Of the router."""

    @property
    def comment(self) -> str:
        """What a person reads on the router, and what every run reads back."""
        return f"{MARK}: {self.link} in use until {self.until:{_STAMP}} UTC, uptime {self.until_uptime_s}s"

    def left_s(self, uptime_s: float | None) -> float | None:
        """How long it still lasts; None: the router has not said its uptime."""
        return None if uptime_s is None else max(0.0, self.until_uptime_s - uptime_s)

    def words(self, uptime_s: float | None) -> str:
        """What every run says of it."""
        left = self.left_s(uptime_s)
        more = "" if left is None else f" ({_minutes(left)} left)"
        return (
            f"{self.link} is in use instead of the declared order until {self.until:{_STAMP}} UTC{more}, by "
            "`provision use`: then, or when the router is started anew, the router puts its order back by itself"
        )


def _minutes(seconds: float) -> str:
    return f"{round(seconds / 60)} min" if seconds >= 60 else f"{round(seconds)} s"  # noqa: PLR2004 - seconds of a minute


def in_use(rows: Iterable[Row]) -> LinkUse | None:
    """Return the use among the jobs of a router, or None. A comment that nobody can read is none of ours."""
    for row in rows:
        match = _COMMENT.fullmatch(row.get("comment", ""))
        if row.get("name") == USE and match is not None:
            link, until, uptime_s = match.groups()
            return LinkUse(link, datetime.strptime(until, _STAMP).replace(tzinfo=UTC), int(uptime_s))
    return None


def tolerated(desired: Desired, observed: Observed) -> Desired:
    """Return what is declared, and that the routes of a link in use are where its job has put them.

    Without the job they are not: then their distances are a difference that a run puts right. What `begun` and `ended`
    make says itself what the routes shall be.
    """
    lasting = tuple(each for each in desired.run_time if not each.temporary)
    use = in_use(observed.jobs)
    if use is None or ROUTES in desired.partial:
        return replace(desired, run_time=lasting)
    return replace(desired, run_time=(*lasting, *dict.fromkeys(_run_time(desired, use.link))))


def _run_time(desired: Desired, link: str) -> Iterator[RunTime]:
    for item in _routes(desired, link):
        for distance in _distances(item):
            yield RunTime(ROUTES, "distance", item.given["distance"], distance, temporary=True)
        if _is_unwatched(item):
            yield RunTime(ROUTES, "check-gateway", "none", "arp", temporary=True)


def without_use(saved: Desired, declared: Desired) -> Desired:
    """Return a saved state without the distances of a use that was in force when it was saved: its job is long gone."""
    known = {item.identity: item.given.get("distance") for item in _routes(declared)}

    def settled(item: RowItem) -> RowItem:
        distance = known.get(item.identity)
        overridden = distance is not None and item.values.get("distance") in _OVERRIDES
        return replace(item, values={**item.values, "distance": distance}) if overridden else item

    return replace(saved, items={**saved.items, ROUTES: tuple(map(settled, saved.items.get(ROUTES, ())))})


def begun(declared: Desired, use: LinkUse, since_uptime_s: int, addresses: Mapping[str, str]) -> Desired:
    """Return the routes and the job of a link in use; of another link that was in use, its declared distances.

    `addresses`: link to the router's own address on it, for all links of the site.
    """
    routes = tuple(_moved(item, in_use=_link(item) == use.link) for item in _routes(declared))
    values = {
        "name": USE,
        "comment": use.comment,
        "interval": f"{TICK_S}s",
        "on-event": _script(declared, use, since_uptime_s, addresses),
        "start-date": "1970-01-01",
        "start-time": "00:00:00",
    }
    return replace(
        declared,
        source=f"the use of {use.link}",
        items={SCHEDULER: (RowItem(SCHEDULER, dict(values)),), ROUTES: routes},
        entire=frozenset(),
        undeclared={},
        partial=frozenset({SCHEDULER, ROUTES}),
        run_time=(*declared.run_time, *dict.fromkeys(_run_time_begun(declared, use.link))),
        remarks=(),
    )


def _run_time_begun(declared: Desired, link: str) -> Iterator[RunTime]:
    """What netwatch and the job make of the routes of a link in use."""
    yield _JOB_STEP
    for item in _routes(declared, link):
        for each in declared.run_time:
            if (each.menu, each.name, each.declared) == (ROUTES, "distance", item.given["distance"]):
                yield replace(each, declared=_distances(item)[0])


def ended(declared: Desired) -> Desired:
    """Return the declared distances of all links, and no job: it is removed with them."""
    return replace(
        declared,
        source="the declared order",
        items={SCHEDULER: (), ROUTES: tuple(_moved(item, in_use=False) for item in _routes(declared))},
        entire=frozenset(),
        undeclared={},
        partial=frozenset({ROUTES}),
        run_time=(*declared.run_time, _JOB_STEP),
        remarks=(),
    )


def is_order(desired: Desired) -> bool:
    """Tell whether a text is about routes and jobs alone, as those of `begun` and `ended` are."""
    return {ROUTES, SCHEDULER}.issuperset(desired.menus)


def links_of(declared: Desired) -> tuple[str, ...]:
    """Return the links that have default routes, in their order."""
    return tuple(dict.fromkeys(map(_link, _routes(declared))))


def _routes(desired: Desired, link: str | None = None) -> tuple[RowItem, ...]:
    """Return the default routes of the main table by which links are chosen."""
    return tuple(
        item
        for item in desired.items.get(ROUTES, ())
        if item.is_marked
        and item.given.get("dst-address") == _DEFAULT
        and "routing-table" not in item.given
        and link in {None, _link(item)}
    )


def _link(item: RowItem) -> str:
    """The comment of such a route is `atlantis: LINK, …`."""
    return item.given["comment"].removeprefix(f"{MARK}: ").partition(",")[0]


def _is_unjudged(item: RowItem) -> bool:
    return item.given["comment"].endswith(_UNJUDGED)


def _is_unwatched(item: RowItem) -> bool:
    """Tell whether nothing is declared that would notice a dead box at this end."""
    return _is_unjudged(item) and "check-gateway" not in item.given


def _is_holding(item: RowItem) -> bool:
    return int(item.given["distance"]) % 10 == 1


def _distances(item: RowItem) -> tuple[str, ...]:
    """What a route of a link in use has instead of its declared distance: at first, and later."""
    return (_HOLDING,) if _is_holding(item) else (_BEGUN, _IN_USE)


def _moved(item: RowItem, *, in_use: bool) -> RowItem:
    """Return the row as it has to be: it is there already, and nothing else of it is looked at.

    A link that netwatch does not judge is watched by ARP while it is in use, which asks its box at this end alone.
    """
    check = "arp" if in_use and _is_unjudged(item) else item.given.get("check-gateway")
    distance = _distances(item)[0] if in_use else item.given["distance"]
    values = {**{name: item.values[name] for name in ("dst-address", "gateway")}, "distance": distance}
    return RowItem(ROUTES, {**values, "check-gateway": check}, item.line, exists=True)


def _script(declared: Desired, use: LinkUse, since_uptime_s: int, addresses: Mapping[str, str]) -> str:
    """Return what the job does each time: end the use, or see that the link has the first place.

    A link that was left and is good again has its declared distance from netwatch, and gets the first place back.
    """
    items = _routes(declared, use.link)
    usual = next(item.given["distance"] for item in items if not _is_holding(item))
    holding = next((item.given["distance"] for item in items if _is_holding(item)), None)
    routes = f'comment~"^{MARK}: {use.link}, "'
    watched, unwatched = ("check-gateway=arp ", "!check-gateway ") if any(map(_is_unwatched, items)) else ("", "")
    others = "|".join(address for name, address in addresses.items() if name != use.link)

    def move(old: str, new: str, more: str = "") -> str:
        rows = f"{routes} distance={old}"
        return f":if ([:len [/ip route find {rows}]] > 0) do={{/ip route set [find {rows}] {more}distance={new}}}"

    over = "; ".join(
        (
            *(move(distance, usual, unwatched) for distance in (_BEGUN, _IN_USE)),
            *((move(_HOLDING, holding),) if holding is not None else ()),
            _cut(addresses[use.link]),
            f'/log info message="atlantis: {use.link} is not in use any more, the declared order is back"',
            f"/system scheduler remove [find name={USE}]",
        )
    )
    first = f"{routes} distance={_BEGUN}"
    on = "; ".join(
        (
            move(usual, _BEGUN, watched),
            *((move(holding, _HOLDING),) if holding is not None else ()),
            f":if ([:len [/ip route find {first} active]] > 0) do={{{_cut(others)}; {move(_BEGUN, _IN_USE)}}}",
        )
    )
    uptime = "[/system resource get uptime]"
    last = use.until_uptime_s - TICK_S
    return (
        f":if ({uptime} < {since_uptime_s}s) do={{{over}}} else={{"
        f":if ({uptime} >= {last}s) do={{{over}}} else={{{on}}}}}"
    )


def _cut(addresses: str) -> str:
    """Connections keep the address under which they began: those that began on these links begin anew."""
    # With its port behind the address. Assumption: connection-reply-address
    return f':do {{/ip firewall connection remove [find reply-dst-address~"^({addresses}):"]}} on-error={{}}'
