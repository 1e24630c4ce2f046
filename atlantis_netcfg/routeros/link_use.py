"""A link that carries its site's traffic for a time (`provision links use`): its routes, and the job that ends it.

While a link is in use its default routes have the smallest distances: 4 after the run has written them, 5 once the job
has cut the connections opened over other links, and 6 for the route that keeps the link in use. netwatch still acts
when the link fails: the link's routes go behind all others, and the next link of the inventory takes over.

The job `atlantis-use` runs every ten seconds. It is the only sign that a link is in use: without it, the distances are
drift like any other. It ends the use by the router's uptime, which no clock change affects. An uptime below that of the
beginning means that the router was restarted, which also ends the use. Its start date is in 1970, so that it also runs
while the clock of a router without battery is wrong.

Assumption: use-job-from-1970
Assumption: use-uptime-compares
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.routeros import _items
from atlantis_netcfg.routeros.menus import MARK
from atlantis_netcfg.routeros.scheduler_jobs import MENU as SCHEDULER
from atlantis_netcfg.routeros.scheduler_jobs import USE

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from atlantis_netcfg.routeros._types import Observation, Row

ROUTES = "/ip/route"
TICK_S = 10
"""Interval of the job in seconds; the use ends at most this much earlier."""
SETTLED_S = 120
"""A router with less uptime has not judged its links yet, and a second start looks like the first."""
_STARTING, _IN_USE, _HOLDING = "4", "5", "6"
_OVERRIDES = frozenset({_STARTING, _IN_USE, _HOLDING})
_DEFAULT = "0.0.0.0/0"
_JOB_STEP = _items.RunTime(ROUTES, "distance", _STARTING, _IN_USE)
"""The value that the first run of the job changes."""
_NOT_PROBED = ", not probed"
_STAMP = "%Y-%m-%d %H:%M"
_COMMENT = re.compile(rf"{MARK}: (\S+) in use until (\d{{4}}-\d\d-\d\d \d\d:\d\d) UTC, uptime (\d+)s")


@dataclass(frozen=True, slots=True)
class LinkUse:
    """One link in use, as described by the comment of its job."""

    link: str
    until: datetime
    """End of the use by the clock of the computer that started it, in UTC."""
    until_uptime_s: int
    """Uptime of the router at the end of the use."""

    @property
    def comment(self) -> str:
        """Comment of the job, for people on the router, and parsed by every run."""
        return msg(
            f"{arg(MARK)}: {arg(self.link)} in use until {arg(self.until):{_STAMP}} UTC, uptime "
            f"{arg(self.until_uptime_s)}s"
        )

    def left_s(self, uptime_s: float | None) -> float | None:
        """Return the remaining time in seconds; None if the router's uptime is unknown."""
        return None if uptime_s is None else max(0.0, self.until_uptime_s - uptime_s)

    def words(self, uptime_s: float | None) -> str:
        """Return the text that every run reports about the use."""
        remaining_s = self.left_s(uptime_s)
        more = msg("" if remaining_s is None else f" ({arg(_minutes(remaining_s))} left)")
        return msg(
            f"{arg(self.link)} is in use instead of the inventory's order until {arg(self.until):{_STAMP}} "
            f"UTC{arg(more)}, set by `provision links use`: after that time, or after a restart, the router restores "
            "the order by itself"
        )


def _minutes(seconds: float) -> str:
    return msg(f"{arg(round(seconds / 60))} min" if seconds >= 60 else f"{arg(round(seconds))} s")  # noqa: PLR2004 - seconds of a minute


def in_use(rows: Iterable[Row]) -> LinkUse | None:
    """Return the link use among the jobs of a router, or None. A comment that cannot be parsed is not ours."""
    for row in rows:
        match = _COMMENT.fullmatch(row.get("comment", ""))
        if row.get("name") == USE and match is not None:
            link, until, uptime_s = match.groups()
            return LinkUse(link, datetime.strptime(until, _STAMP).replace(tzinfo=UTC), int(uptime_s))
    return None


def allow_link_use(desired_state: _items.DesiredState, observation: Observation) -> _items.DesiredState:
    """Return the desired state with the distances that an active job gives to the link in use.

    Without the job these distances are drift, which a run corrects. `start_use` and `end_use` set the routes
    themselves.
    """
    lasting = tuple(each for each in desired_state.run_time if not each.temporary)
    use = in_use(observation.jobs)
    if use is None or ROUTES in desired_state.partial:
        return replace(desired_state, run_time=lasting)
    return replace(desired_state, run_time=(*lasting, *dict.fromkeys(_run_time(desired_state, use.link))))


def _run_time(desired_state: _items.DesiredState, link: str) -> Iterator[_items.RunTime]:
    for item in _routes(desired_state, link):
        for distance in _distances(item):
            yield _items.RunTime(ROUTES, "distance", item.defined_values["distance"], distance, temporary=True)
        if _is_unwatched(item):
            yield _items.RunTime(ROUTES, "check-gateway", "none", "arp", temporary=True)


def without_use(saved_state: _items.DesiredState, desired_state: _items.DesiredState) -> _items.DesiredState:
    """Return a saved state without the distances of a link use active at that time, as its job no longer exists."""
    distances = {item.identity: item.defined_values.get("distance") for item in _routes(desired_state)}

    def reset_distance(item: _items.RowItem) -> _items.RowItem:
        distance = distances.get(item.identity)
        overridden = distance is not None and item.values.get("distance") in _OVERRIDES
        return replace(item, values={**item.values, "distance": distance}) if overridden else item

    return replace(
        saved_state, items={**saved_state.items, ROUTES: tuple(map(reset_distance, saved_state.items.get(ROUTES, ())))}
    )


def start_use(
    desired_state: _items.DesiredState, use: LinkUse, since_uptime_s: int, addresses: Mapping[str, str]
) -> _items.DesiredState:
    """Return routes and job of a link to use; a link used before gets the distances of the inventory.

    `addresses`: link to the router's own address on it, for all links of the site.
    """
    routes = tuple(_build_route_item(item, in_use=_link(item) == use.link) for item in _routes(desired_state))
    values = {
        "name": USE,
        "comment": use.comment,
        "interval": f"{TICK_S}s",
        "on-event": _script(desired_state, use, since_uptime_s, addresses),
        "start-date": "1970-01-01",
        "start-time": "00:00:00",
    }
    return replace(
        desired_state,
        source=f"the use of {use.link}",
        items={SCHEDULER: (_items.RowItem(SCHEDULER, dict(values)),), ROUTES: routes},
        entire=frozenset(),
        undeclared_values={},
        partial=frozenset({SCHEDULER, ROUTES}),
        run_time=(*desired_state.run_time, *dict.fromkeys(_run_time_begun(desired_state, use.link))),
        remarks=(),
    )


def _run_time_begun(desired_state: _items.DesiredState, link: str) -> Iterator[_items.RunTime]:
    """Yield the values that netwatch and the job give to the routes of a link in use."""
    yield _JOB_STEP
    for item in _routes(desired_state, link):
        for each in desired_state.run_time:
            if (each.menu, each.name, each.declared_value) == (ROUTES, "distance", item.defined_values["distance"]):
                yield replace(each, declared_value=_distances(item)[0])


def end_use(desired_state: _items.DesiredState) -> _items.DesiredState:
    """Return the distances of the inventory for all links, and no job, so that the job is removed."""
    return replace(
        desired_state,
        source="the declared order",
        items={SCHEDULER: (), ROUTES: tuple(_build_route_item(item, in_use=False) for item in _routes(desired_state))},
        entire=frozenset(),
        undeclared_values={},
        partial=frozenset({ROUTES}),
        run_time=(*desired_state.run_time, _JOB_STEP),
        remarks=(),
    )


def is_order(desired_state: _items.DesiredState) -> bool:
    """Return True if a desired state contains only routes and jobs, as those of `start_use` and `end_use`."""
    return {ROUTES, SCHEDULER}.issuperset(desired_state.menus)


def links_of(desired_state: _items.DesiredState) -> tuple[str, ...]:
    """Return the links that have default routes, in their order."""
    return tuple(dict.fromkeys(map(_link, _routes(desired_state))))


def _routes(desired_state: _items.DesiredState, link: str | None = None) -> tuple[_items.RowItem, ...]:
    """Return the default routes of the main table that select the link."""
    return tuple(
        item
        for item in desired_state.items.get(ROUTES, ())
        if item.is_marked
        and item.defined_values.get("dst-address") == _DEFAULT
        and "routing-table" not in item.defined_values
        and link in {None, _link(item)}
    )


def _link(item: _items.RowItem) -> str:
    """Return the link name in the comment of such a route: `atlantis: LINK, …`."""
    return item.defined_values["comment"].removeprefix(f"{MARK}: ").partition(",")[0]


def _is_unprobed(item: _items.RowItem) -> bool:
    return item.defined_values["comment"].endswith(_NOT_PROBED)


def _is_unwatched(item: _items.RowItem) -> bool:
    """Return True if nothing in the inventory detects that the link's device at this end is dead."""
    return _is_unprobed(item) and "check-gateway" not in item.defined_values


def _is_holding(item: _items.RowItem) -> bool:
    return int(item.defined_values["distance"]) % 10 == 1


def _distances(item: _items.RowItem) -> tuple[str, ...]:
    """Return the distances of a route while its link is in use: the first one, and the later one."""
    return (_HOLDING,) if _is_holding(item) else (_STARTING, _IN_USE)


def _build_route_item(item: _items.RowItem, *, in_use: bool) -> _items.RowItem:
    """Return the route item to write; the row exists already, and its other values are not compared.

    A link that netwatch does not monitor is checked by ARP while in use, which reaches only its device at this end.
    """
    check = "arp" if in_use and _is_unprobed(item) else item.defined_values.get("check-gateway")
    distance = _distances(item)[0] if in_use else item.defined_values["distance"]
    values = {**{name: item.values[name] for name in ("dst-address", "gateway")}, "distance": distance}
    return _items.RowItem(ROUTES, {**values, "check-gateway": check}, item.line, exists=True)


def _script(desired_state: _items.DesiredState, use: LinkUse, since_uptime_s: int, addresses: Mapping[str, str]) -> str:
    """Return the job's script: end the use, or make sure that the link comes first.

    A link that failed and has recovered gets its inventory distance from netwatch, and then the first place from the
    job.
    """
    items = _routes(desired_state, use.link)
    usual = next(item.defined_values["distance"] for item in items if not _is_holding(item))
    holding = next((item.defined_values["distance"] for item in items if _is_holding(item)), None)
    routes = msg(f'comment~"^{arg(MARK)}: {arg(use.link)}, "')
    set_check, clear_check = ("check-gateway=arp ", "!check-gateway ") if any(map(_is_unwatched, items)) else ("", "")
    others = "|".join(address for name, address in addresses.items() if name != use.link)

    def move(old: str, new: str, more: str = "") -> str:
        rows = f"{routes} distance={old}"
        return f":if ([:len [/ip route find {rows}]] > 0) do={{/ip route set [find {rows}] {more}distance={new}}}"

    over = join(
        "; ",
        (
            *(move(distance, usual, clear_check) for distance in (_STARTING, _IN_USE)),
            *((move(_HOLDING, holding),) if holding is not None else ()),
            _cut(addresses[use.link]),
            f'/log info message="atlantis: {use.link} is not in use any more, the declared order is back"',
            f"/system scheduler remove [find name={USE}]",
        ),
    )
    first = f"{routes} distance={_STARTING}"
    on = join(
        "; ",
        (
            move(usual, _STARTING, set_check),
            *((move(holding, _HOLDING),) if holding is not None else ()),
            f":if ([:len [/ip route find {first} active]] > 0) do={{{_cut(others)}; {move(_STARTING, _IN_USE)}}}",
        ),
    )
    uptime = "[/system resource get uptime]"
    last = use.until_uptime_s - TICK_S
    return (
        f":if ({uptime} < {since_uptime_s}s) do={{{over}}} else={{"
        f":if ({uptime} >= {last}s) do={{{over}}} else={{{on}}}}}"
    )


def _cut(addresses: str) -> str:
    """Drop connections opened over these links, so that they re-establish over the new one."""
    # With its port behind the address. Assumption: connection-reply-address
    return f':do {{/ip firewall connection remove [find reply-dst-address~"^({addresses}):"]}} on-error={{}}'
