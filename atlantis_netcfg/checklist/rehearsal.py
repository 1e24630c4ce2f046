"""The checklist of a site over a running rehearsal, without a person: every item that a program can check."""

from __future__ import annotations

import asyncio
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from atlantis_netcfg.checklist import report
from atlantis_netcfg.checklist.plan import plan
from atlantis_netcfg.checklist.probes import Place
from atlantis_netcfg.checklist.runner import examine
from atlantis_netcfg.checklist.runner.simulated import machine_requests, robots
from atlantis_netcfg.checklist.runner.simulated.environment import machine_of, rehearsed_ears
from atlantis_netcfg.core import events
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.emulator import acoustic, gnss, linux, mavlink

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.checklist import PlanEntry
    from atlantis_netcfg.checklist.probes import Question
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


def check_site(
    inventory: Inventory,
    site: str,
    rehearsal: Rehearsal,
    notify: events.Subscriber = events.ignore,
    *,
    has_real_tunnels: bool = False,
) -> CheckOutcome:
    """Check all items of a site that need no person, recovery and missions excepted; the routers are configured.

    `has_real_tunnels`: the routers' tunnels are real, so their state is left as it is. Raises NoMatchError.
    """
    entries = plan(inventory, site).entries
    todo = [entry for entry in entries if entry.step.probe is not None and not entry.step.unless]

    def settle(item: report.Item) -> None:
        notify(events.Event(item.id, events.Stage.DONE, msg(f"{arg(item.verdict)}: {arg(item.message)}")))

    with rehearsed_ears(inventory, site, rehearsal, has_real_tunnels=has_real_tunnels) as ears:
        items = asyncio.run(examine(todo, ears, settle))
    machine = machine_of(inventory, site, rehearsal) is not None
    return CheckOutcome(
        site,
        items,
        sum(entry.item.kind is report.ItemKind.PERSON and not entry.step.unless for entry in entries),
        tuple(_machine_items(inventory, todo)) if machine else (),
        (*limits(inventory, todo, has_machine=machine), *rehearsal.not_rehearsed),
    )


def _machine_items(inventory: Inventory, entries: Sequence[PlanEntry]) -> Iterator[str]:
    for entry in entries:
        reasons = [machine_requests.limit_of(each, inventory.pilot.vpn.network) for each in _gateway_requests([entry])]
        if reasons and not any(reasons):
            yield entry.item.id


def _gateway_requests(entries: Sequence[PlanEntry]) -> Iterator[Question]:
    for entry in entries:
        if entry.step.probe is not None:
            yield from (each for each in entry.step.probe.asks() if each.place is Place.GATEWAY)


def limits(inventory: Inventory, entries: Sequence[PlanEntry], *, has_machine: bool) -> tuple[str, ...]:
    """Return the limits of the emulators for these entries; `has_machine`: the gateway is a real machine."""
    endpoints = {entry.item.endpoint for entry in entries if entry.step.probe is not None}
    values = {"gps": gnss, "rc_rf": mavlink, "acoustic": acoustic, "usbl": acoustic}
    values |= {"robot": robots, "integration": robots}
    lines = [line for endpoint, emulator in values.items() if endpoint in endpoints for line in emulator.NOT_REHEARSED]
    if has_machine:
        vpn = inventory.pilot.vpn.network
        lines += filter(None, (machine_requests.limit_of(each, vpn) for each in _gateway_requests(entries)))
    else:
        lines += linux.NOT_REHEARSED
    return tuple(dict.fromkeys(lines))
