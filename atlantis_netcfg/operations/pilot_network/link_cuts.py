"""Cut the links of a site one after the other: its traffic has to move on, and back, within the inventory's times.

Frames are lost on the cut link, so that only the router's own probes can notice. Their schedule is on the emulated
router's clock, which is moved forward; each answer is a packet.
"""

from __future__ import annotations

import itertools
import json
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.operations.pilot_network import link_watch
from atlantis_netcfg.routeros.render import view
from atlantis_netcfg.routeros.render._links import WATCH_S

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.inventory import Host, model
    from atlantis_netcfg.operations.pilot_network.rehearsal import PilotRehearsal

_STEP_S: Final = 1.0
"""Emulated seconds between two looks at the route in use."""
_MARGIN_S: Final = 11.0
"""What docs/links.md adds to the declared time: the interval of the probes, and the wait for the last answer."""
_GATEWAY_CHECK_S: Final = 10.0
"""After the cut of an unmetered link its next hop counts as alive at the next `check-gateway`, then probes are sent."""


@dataclass(frozen=True, slots=True)
class LinkMove:
    """How the traffic of a site moved from one link to another, after a cut or its end."""

    before: str
    after: str
    limit_s: float
    active: str | None = None
    """The link in use when the time was over; None: none."""
    took_s: float = 0.0
    """Of the router's clock."""

    @property
    def is_in_time(self) -> bool:
        """Whether the right link was in use within the declared time."""
        return self.active == self.after

    def __str__(self) -> str:
        way = msg(f"{arg(self.before)} to {arg(self.after)}")
        if self.is_in_time:
            return msg(f"{arg(way)} in {arg(self.took_s):.0f} s")
        active = self.active or msg("no link")
        return msg(f"{arg(way)}: after {arg(self.limit_s):.0f} s {arg(active)} carries the traffic")


@dataclass(slots=True)
class LinkCuts:
    """The moves of one site's traffic, and what its satellites carried meanwhile."""

    moves: list[LinkMove] = field(default_factory=list)
    satellites: list[str] = field(default_factory=list)
    """Those that have carried only what their allow-lists have, one line each."""
    problems: list[str] = field(default_factory=list)
    """What satellites have carried besides, or have not carried, one line each."""

    @property
    def differences(self) -> list[str]:
        """What was not as declared, one line each."""
        return [*(str(move) for move in self.moves if not move.is_in_time), *self.problems]

    @property
    def words(self) -> str:
        """One line for people about what was as declared."""
        moves = msg(f"traffic moved by itself when links were cut: {arg(join(', ', map(str, self.moves)))}")
        return join("; ", (moves, *self.satellites))


def cut_links(pilot: PilotRehearsal, host: Host, visit: Callable[[str], None]) -> LinkCuts:
    """Cut a router's links in order of preference, then mend all; `visit` is called with each link while it is used."""
    links = pilot.inventory.sites[host.site].bearers
    result = LinkCuts()
    first = links[0]
    start = follow_traffic(pilot, host, LinkMove(msg("start"), first.name, _return_s(pilot, host, first)))
    if not start.is_in_time:
        result.moves.append(start)
    _visit(pilot, host, first, visit, result)
    for link, following in itertools.pairwise(links):
        pilot.network.links[host.site, link.name].is_up = False
        result.moves.append(
            follow_traffic(pilot, host, LinkMove(link.name, following.name, _leave_s(pilot, host, link)))
        )
        _visit(pilot, host, following, visit, result)
    for link in links:
        pilot.network.links[host.site, link.name].is_up = True
    if len(links) > 1:
        back = LinkMove(links[-1].name, first.name, _return_s(pilot, host, first))
        result.moves.append(follow_traffic(pilot, host, back))
    return result


def _visit(pilot: PilotRehearsal, host: Host, link: model.Link, visit: Callable[[str], None], result: LinkCuts) -> None:
    """Visit a link; of a satellite all packets are compared with its allow-list, among them attempts to break it."""
    if not link.kind.traits.allow_list:
        visit(link.name)
        return
    with link_watch.watch_link(pilot.network.links[host.site, link.name]) as watch:
        attempts = link_watch.send_strangers(pilot.network, host, link)
        visit(link.name)
        is_carried = link_watch.sees_probe(watch, pilot.network, host)
    problems = [*watch.strangers(pilot.inventory.pilot, link), *([] if is_carried else [link_watch.no_probe(link)])]
    result.problems += problems
    if not problems:
        summary = msg(f"{arg(link.name)} carried {arg(watch.counts.total())} packets, all of them allowed")
        result.satellites.append(msg(f"{arg(summary)}, and let none of {arg(attempts)} forbidden ones through"))


def link_in_use(pilot: PilotRehearsal, host: Host) -> str | None:
    """Return the link over which a router's default route leads now."""
    namespace = pilot.network.routers[host.name]
    routes = json.loads(pilot.network.run(namespace, "ip", "-j", "route", "show", "default"))
    ports = {port.name: port.link for port in view.router_of(host).ports}
    best = min(routes, key=lambda route: route.get("metric", 0), default=None)
    return None if best is None else ports.get(best["dev"])


def follow_traffic(pilot: PilotRehearsal, host: Host, move: LinkMove) -> LinkMove:
    """Move the router's clock forward until the right link is in use, or the time is over."""
    wait = partial(pilot.rehearsal.emulators.do, host.name, "wait")
    begin_s, took_s = wait(seconds=0.0), 0.0
    while (active := link_in_use(pilot, host)) != move.after and took_s < move.limit_s:
        took_s = wait(seconds=_STEP_S) - begin_s
    return replace(move, active=active, took_s=took_s)


def _leave_s(pilot: PilotRehearsal, host: Host, link: model.Link) -> float:
    times = pilot.inventory.sites[host.site].failover
    return times.hold_down_s + (times.metered_probe_s if link.metered else 0) + _MARGIN_S


def _return_s(pilot: PilotRehearsal, host: Host, link: model.Link) -> float:
    times = pilot.inventory.sites[host.site].failover
    return times.fail_back_s + (times.metered_probe_s if link.metered else WATCH_S + _GATEWAY_CHECK_S) + _MARGIN_S
