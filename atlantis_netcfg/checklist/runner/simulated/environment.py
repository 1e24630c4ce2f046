"""A rehearsal's ears, with everything behind them started and, if asked for, broken."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from datetime import datetime
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

from atlantis_netcfg.checklist.runner._real import RealEars
from atlantis_netcfg.checklist.runner.simulated._ears import RehearsedEars
from atlantis_netcfg.checklist.runner.simulated._faults import FAULTS
from atlantis_netcfg.checklist.runner.simulated._routers import clock_words
from atlantis_netcfg.checklist.runner.simulated._world import healthy
from atlantis_netcfg.checklist.runner.simulated.endpoints import standing
from atlantis_netcfg.core.events import ignore
from atlantis_netcfg.core.paths import state_dir
from atlantis_netcfg.emulator.linux import Computer
from atlantis_netcfg.operations.request import Mode, Request

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.checklist.runner.simulated._world import World
    from atlantis_netcfg.declaration import Declaration
    from atlantis_netcfg.operations.rehearsal import Rehearsal

__all__ = ["rehearsed_ears"]


@contextmanager
def rehearsed_ears(
    declaration: Declaration, site: str, rehearsal: Rehearsal, broken: Sequence[str] = ()
) -> Iterator[RehearsedEars]:
    """Give ears whose site is well but for what is `broken` (names of `FAULTS`); its routers are configured already."""
    world = healthy(declaration, site)
    for name in broken:
        FAULTS[name].spoil(world)
    request = Request(state=state_dir(), mode=Mode.DRIFT, rehearsed=True, targets=rehearsal.targets, accept_cost=True)
    with _routers(declaration, world, rehearsal), standing(world) as stands:
        computer = None if world.computer is None else Computer(world.computer)
        yield RehearsedEars(RealEars(declaration, site, request, ignore), computer, stands)


@contextmanager
def _routers(declaration: Declaration, world: World, rehearsal: Rehearsal) -> Iterator[None]:
    """Put the routers into their place, and do to them what faults ask for; taken back at the end."""
    zone = ZoneInfo(declaration.pilot.time_zone)
    emulated = [name for name in world.routers if name in rehearsal.targets]
    for name in emulated:
        rehearsal.twins.do(name, "around", **world.routers[name])
        rehearsal.twins.do(name, "console", words=clock_words(datetime.now(zone)))
    with ExitStack() as back:
        for act in world.acts:
            back.callback(act(rehearsal.twins.do))
        yield
