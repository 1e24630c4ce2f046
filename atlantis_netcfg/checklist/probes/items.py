"""Checklist items from the inventory: items for a person, and allow-listed programs whose output is compared.

Texts are the pilot's own and are shown as in the inventory, in every language. The report contains only the expected
line of a program's output, or the most similar one. It contains nothing of a file, which may hold a password.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.checklist.report import Evidence, ItemKind
from atlantis_netcfg.core.errors import nearest
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.links import LinkFinding

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from atlantis_netcfg.inventory import Inventory

_PLACES = {model.SeenFrom.GATEWAY: base.Place.GATEWAY, model.SeenFrom.LAPTOP: base.Place.LAPTOP}
_LONGEST = 200
"""Most characters of a line that are shown."""


def items_of(cell: base.Cell) -> Iterator[model.CheckItem]:
    """Yield the inventory items of a row: the vehicle's own first, then the site's, then the mission's."""
    settings = cell.site_config.checklist
    if cell.vehicle is not None:
        yield from cell.inventory.vehicles[cell.vehicle].checklist.items
    lists = (settings.items, *(mission.items for mission in settings.missions if mission.name == cell.mission))
    yield from (item for items in lists for item in items if item.vehicle == cell.vehicle)


def steps(cell: base.Cell) -> tuple[base.Step, ...]:
    """Return a step for each item."""
    return tuple(_step(cell.inventory, item) for item in items_of(cell))


def _step(inventory: Inventory, item: model.CheckItem) -> base.Step:
    if item.kind is model.ItemSort.COMMAND:
        probe = ExpectedLine(_PLACES[item.seen_from], item.command or "", item.expect or "")
        return base.Step(name=item.id, title=item.text, kind=ItemKind.AUTOMATIC, phase=item.phase, probe=probe)
    return base.Step(
        name=item.id,
        title=item.text,
        kind=ItemKind.PERSON,
        phase=item.phase,
        look_for=item.look_for or "",
        by=people(inventory, item.by),
        evidence=base.EvidenceRequest(item.evidence, item.unit or "", item.min, item.max),
    )


def people(inventory: Inventory, words: Iterable[str]) -> tuple[str, ...]:
    """Resolve names and roles to the names of people in the inventory."""
    roles = {role.name: role.people for role in inventory.pilot.roles}
    return tuple(dict.fromkeys(name for word in words for name in roles.get(word, (word,))))


@dataclass(frozen=True, slots=True)
class ExpectedLine:
    """Check that a program prints an expected line."""

    place: base.Place
    command: str
    expect: str

    def asks(self) -> tuple[base.Question, ...]:
        """Run the program."""
        return (base.RunProgram("output", self.place, tuple(self.command.split())),)

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        """Look for the line; a program that failed never passes, whatever it printed."""
        ran = results["output"]
        program, where = self.command.partition(" ")[0], base.PLACES[self.place]
        not_there = tuple(base.not_run(self.place, program, ran))
        evidence = (
            base.declared_evidence(msg(f"line expected from `{arg(self.command)}` on {arg(where)}"), self.expect),
        )
        if not_there or not isinstance(ran, base.CommandResult):
            return base.ProbeResult(not_there, evidence)
        every = [line.strip() for line in ran.out.splitlines() if line.strip()]
        pattern = re.compile(".*".join(map(re.escape, self.expect.strip().split("*"))))
        line = next((line for line in every if pattern.fullmatch(line)), None)
        if line is None:
            return base.ProbeResult(
                (self._missing_line_finding(where, ran),),
                (*evidence, *self._line_evidence(nearest(self.expect, every))),
            )
        if ran.rc != 0:
            return base.ProbeResult((self._exit_finding(where, ran),), (*evidence, *self._line_evidence(line)))
        message = msg(f"`{arg(self.command)}` prints the expected line on {arg(where)}")
        return base.ProbeResult(
            (LinkFinding(Verdict.PASS, "line-found", message),), (*evidence, *self._line_evidence(line))
        )

    def _line_evidence(self, line: str | None) -> tuple[Evidence, ...]:
        if line is None or self.command.startswith("cat "):
            return ()
        return (base.read(msg(f"line of `{arg(self.command)}`"), line[:_LONGEST]),)

    def _missing_line_finding(self, where: str, ran: base.CommandResult) -> LinkFinding:
        message = msg(f"`{arg(self.command)}` does not print on {arg(where)} the line `{arg(self.expect)}`")
        if ran.rc != 0:
            message += msg(f"; exit code {arg(ran.rc)}")
        hint = msg(f"run `{arg(self.command)}` on {arg(where)}; fix the cause, or correct `expect:` of the item")
        return LinkFinding(Verdict.FAIL, "line-missing", message, hint)

    def _exit_finding(self, where: str, ran: base.CommandResult) -> LinkFinding:
        message = msg(
            f"`{arg(self.command)}` prints the expected line on {arg(where)}, but its exit code is {arg(ran.rc)}"
        )
        return LinkFinding(
            Verdict.INCONCLUSIVE, "program-failed", message, msg(f"run it on {arg(where)} and check the output")
        )
