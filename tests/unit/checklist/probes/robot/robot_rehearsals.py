"""Robots' items asked of what a rehearsal has in place of robots, without its routers."""

import asyncio
from collections.abc import Callable, Sequence
from pathlib import Path

from atlantis_netcfg.checklist import Checklist, PlanEntry
from atlantis_netcfg.checklist.report import Item, ItemKind
from atlantis_netcfg.checklist.runner import RealTransport, examine
from atlantis_netcfg.checklist.runner.simulated import FAULTS
from atlantis_netcfg.checklist.runner.simulated._world import World, healthy
from atlantis_netcfg.checklist.runner.simulated.environment import RehearsedTransport
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.operations.common.request import Mode, Request

NOWHERE = Request(state=Path("/EXAMPLE"), mode=Mode.DRIFT, rehearsed=True)
OF_ROBOTS = [name for name in FAULTS if name.startswith("robot-")]
Seen = dict[str, tuple[Verdict, list[str]]]


def probed(listed: Checklist, endpoint: str) -> list[PlanEntry]:
    """What a program looks at."""
    return [
        entry
        for entry in listed.entries
        if entry.item.endpoint == endpoint and entry.item.kind is not ItemKind.PERSON and not entry.step.unless
    ]


def asked(
    declaration: Inventory, entries: Sequence[PlanEntry], spoil: Callable[[World], None] | None = None
) -> dict[str, Item]:
    world = healthy(declaration, "coastal")
    if spoil is not None:
        spoil(world)
    ears = RehearsedTransport(RealTransport(declaration, "coastal", NOWHERE), None, (), "coastal", {}, world.robots)
    return {item.id: item for item in asyncio.run(examine(entries, ears, lambda _: None))}


def told(items: dict[str, Item]) -> Seen:
    return {name: (item.verdict, [finding.code for finding in item.findings]) for name, item in items.items()}


def turned(items: dict[str, Item], well: dict[str, Item]) -> Seen:
    """What is otherwise than when all is well."""
    before = told(well)
    return {name: seen for name, seen in told(items).items() if seen != before[name]}
