"""`provision links use` while the sites of a rehearsal are joined: traffic follows the link, and returns by itself."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.core import events
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.operations.common.jobs import device_job
from atlantis_netcfg.operations.links.collect import collect_links
from atlantis_netcfg.operations.pilot_network import link_cuts, link_watch
from atlantis_netcfg.operations.use import SHORTEST_S, LinkNotFit, UseRequest
from atlantis_netcfg.routeros.apply import converge
from atlantis_netcfg.routeros.link_use import TICK_S
from atlantis_netcfg.runs import NoJournal

if TYPE_CHECKING:
    from atlantis_netcfg.inventory import Host, model
    from atlantis_netcfg.operations.pilot_network.rehearsal import PilotRehearsal


@dataclass(slots=True)
class LinkUses:
    """How one site's traffic followed the links that a person chose."""

    moves: list[link_cuts.LinkMove] = field(default_factory=list)
    differences: list[str] = field(default_factory=list)

    @property
    def words(self) -> str:
        """One line for people about the moves that were as requested."""
        return msg(f"moved on request, and back: {arg(join(', ', map(str, self.moves)))}")


def use_links(pilot: PilotRehearsal, host: Host) -> LinkUses:
    """Use each link but the first for a minute, after which the router has to return by itself. Raises MachineError.

    The last comes first: links that were cut before are behind the others until they have answered for long enough.
    """
    first, *others = pilot.inventory.sites[host.site].bearers
    result = LinkUses()
    for link in reversed(others):
        if problem := _begin_use(pilot, host, link):
            result.differences.append(msg(f"{arg(link.name)} chosen for a time: {arg(problem)}"))
            continue
        back = link_cuts.LinkMove(link.name, first.name, SHORTEST_S + TICK_S)
        for move, current in ((link_cuts.LinkMove(first.name, link.name, 0), link), (back, first)):
            result.moves.append(link_cuts.follow_traffic(pilot, host, move))
            if not _carries(pilot, host, current):
                result.differences.append(link_watch.no_probe(current))
    result.differences += [str(move) for move in result.moves if not move.is_in_time]
    return result


def _begin_use(pilot: PilotRehearsal, host: Host, link: model.Link) -> str:
    """Do what the command does; return why the link is not used, or an empty text."""
    use = UseRequest(host.site, link, SHORTEST_S, allow_unproved=link.kind.traits.allow_list)
    status = asyncio.run(collect_links(pilot.inventory, host.site, [host], pilot.request, events.ignore))
    try:
        request = pilot.request.model_copy(update={"use": use.order(status)})
    except LinkNotFit as error:
        return str(error)
    outcome = asyncio.run(converge(device_job(pilot.inventory, host, request, NoJournal(), events.ignore)))
    return "" if outcome.exit is ExitCode.DONE else outcome.message


def _carries(pilot: PilotRehearsal, host: Host, link: model.Link) -> bool:
    with link_watch.watch_link(pilot.network.links[host.site, link.name]) as watch:
        return link_watch.sees_probe(watch, pilot.network, host)
