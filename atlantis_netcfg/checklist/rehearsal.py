"""The checklist of a site over a running rehearsal, without a person: every item that a program can check."""

from __future__ import annotations

import asyncio
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from atlantis_netcfg.checklist import report
from atlantis_netcfg.checklist.plan import plan
from atlantis_netcfg.checklist.runner import examine, machine_requests
from atlantis_netcfg.checklist.runner.simulated import robots
from atlantis_netcfg.checklist.runner.simulated.environment import machine_of, rehearsed_ears
from atlantis_netcfg.core import events
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.emulator import acoustic, gnss, linux, mavlink
from atlantis_netcfg.operations.allow_list_test.site import try_out

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.checklist import PlanEntry
    from atlantis_netcfg.checklist.runner._real import RunProof
    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.operations.common.rehearsal import Rehearsal

_GOOD: Final = frozenset({Verdict.PASS, Verdict.WARN})


@dataclass(frozen=True, slots=True)
class CheckOutcome:
    """Result of the rehearsed checklist of a site."""

    site: str
    items: tuple[report.Item, ...]
    """Items that a program has checked; active ones as well, because nothing but emulated devices is triggered."""
    person_items: int
    """Number of items that only a person can confirm."""
    by_machine: tuple[str, ...] = ()
    """Ids of items whose requests to the gateway all go to its real machine."""
    not_rehearsed: tuple[str, ...] = ()
    """What was emulated."""

    @property
    def counts(self) -> dict[str, int]:
        """Number of checked items by verdict."""
        return dict(Counter(str(item.verdict) for item in self.items))

    @property
    def problems(self) -> tuple[report.Item, ...]:
        """Items that have failed, that are unknown, or whose probe has crashed."""
        return tuple(item for item in self.items if item.verdict not in _GOOD | {Verdict.SKIP})

    @property
    def words(self) -> str:
        """One line for people; skipped items are not counted."""
        verdicts = [item.verdict for item in self.items if item.verdict is not Verdict.SKIP]
        good = sum(verdict in _GOOD for verdict in verdicts)
        return msg(
            f"checklist: {arg(good)} of {arg(len(verdicts))} automatic items pass; {arg(self.person_items)} items need "
            "a person"
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the outcome as JSON data."""
        fields = {"id", "verdict", "message", "hint"}
        return {
            "site": self.site,
            "words": self.words,
            "counts": self.counts,
            "person_items": self.person_items,
            "problems": [item.model_dump(mode="json", include=fields) for item in self.problems],
            "by_machine": list(self.by_machine),
            "not_rehearsed": list(self.not_rehearsed),
        }


def check_site(  # noqa: PLR0913 - what is checked, and how much of it is real
    inventory: Inventory,
    site: str,
    rehearsal: Rehearsal,
    notify: events.Subscriber = events.ignore,
    *,
    has_real_tunnels: bool = False,
    prove: RunProof = try_out,
    step: str | None = None,
) -> CheckOutcome:
    """Check all items of a site with configured routers that need no person, except recovery and missions.

    `has_real_tunnels`: the routers' tunnels are real, so their state is left as it is. `step`: only items of this name.
    `prove`: runs the test of a satellite's allow-list. Raises NoMatchError.
    """
    entries = [entry for entry in plan(inventory, site).entries if step in {None, entry.step.name}]
    todo = [entry for entry in entries if entry.step.probe is not None and not entry.step.unless]

    def settle(item: report.Item) -> None:
        notify(events.Event(item.id, events.Stage.DONE, msg(f"{arg(item.verdict)}: {arg(item.message)}")))

    with rehearsed_ears(inventory, site, rehearsal, has_real_tunnels=has_real_tunnels, prove=prove) as ears:
        items = asyncio.run(examine(todo, ears, settle))
    by_item: dict[str, tuple[str, ...]] = {}
    if machine_of(inventory, site, rehearsal) is not None:
        for entry in todo:
            assert entry.step.probe is not None  # noqa: S101 - chosen so above
            by_item[entry.item.id] = machine_requests.gateway_limits(entry.step.probe, inventory.pilot.vpn.network)
    gateway = [line for item in by_item.values() for line in item] or linux.NOT_REHEARSED
    return CheckOutcome(
        site,
        items,
        sum(entry.item.kind is report.ItemKind.PERSON and not entry.step.unless for entry in entries),
        tuple(name for name, item in by_item.items() if item and not any(item)),
        (*limits(todo, gateway), *rehearsal.not_rehearsed),
    )


def limits(entries: Sequence[PlanEntry], gateway: Sequence[str] = linux.NOT_REHEARSED) -> tuple[str, ...]:
    """Return the limits of the emulators for these entries; `gateway`: those of the gateway computer."""
    endpoints = {entry.item.endpoint for entry in entries if entry.step.probe is not None}
    values = {"gps": gnss, "rc_rf": mavlink, "acoustic": acoustic, "usbl": acoustic}
    values |= {"robot": robots, "integration": robots}
    lines = [line for endpoint, emulator in values.items() if endpoint in endpoints for line in emulator.NOT_REHEARSED]
    return tuple(filter(None, dict.fromkeys([*lines, *gateway])))
