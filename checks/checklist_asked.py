"""The checklist's items for pytest: listed once, all asked at once; what people have answered is read from the book."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist import Scope, VehicleState, books, plan
from atlantis_netcfg.checklist.report import ItemKind
from atlantis_netcfg.checklist.runner import examine
from atlantis_netcfg.cli.base.session import session
from atlantis_netcfg.cli.base.syntax import Arguments
from atlantis_netcfg.cli.checklist import CHECK
from atlantis_netcfg.cli.checklist.check_run import folder_of, listening, taking_part
from atlantis_netcfg.core.events import Verdict, ignore
from atlantis_netcfg.core.paths import state_dir
from atlantis_netcfg.inventory import ALL
from atlantis_netcfg.runs import Store

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from pathlib import Path

    from atlantis_netcfg.checklist import Checklist, PlanEntry
    from atlantis_netcfg.checklist.report import Item
    from atlantis_netcfg.inventory import Inventory

__all__ = ["Asking", "How", "answer_lines", "waits"]


_VALID = frozenset({VehicleState.OPEN, VehicleState.SIGNED})


@dataclass(frozen=True, slots=True)
class How:
    """What was typed behind `pytest checks/`."""

    inventory: Path
    rehearse: bool
    accept_cost: bool
    via: str | None
    ssh_config: str | None

    def arguments(self, site: str) -> Arguments:
        """The same as words of `provision check`; nobody is asked anything while tests run."""
        words = {"site": (site,), "inventory": (str(self.inventory),), **({"via": (self.via,)} if self.via else {})}
        flags = {"json": True, "rehearse": self.rehearse, "accept-cost": self.accept_cost}
        return Arguments(CHECK, words, {name: None for name, given in flags.items() if given})


@dataclass(slots=True)
class Asking:
    """The items of the sites that are checked, each site asked when its first item is wanted."""

    declaration: Inventory
    how: How
    lists: Mapping[str, Checklist]
    selected: set[str] = field(default_factory=set)
    """Names of the tests that are selected: nothing else is asked."""
    _found: dict[str, Mapping[str, Item]] = field(default_factory=dict)
    _answered: dict[str, Mapping[str, Item]] = field(default_factory=dict)

    @classmethod
    def of(cls, declaration: Inventory, how: How, site: str, scope: Scope) -> Asking:
        """Work out the lists. Raises NothingMatched."""
        sites = declaration.sites if site == ALL else [site]
        return cls(declaration, how, {item: plan(declaration, item, scope) for item in sites})

    def entries(self) -> Iterable[PlanEntry]:
        """In the order of the lists."""
        return (entry for found in self.lists.values() for entry in found.entries)

    def name(self, entry: PlanEntry) -> str:
        """Of its test: the item's id; of several sites, where a vehicle has one item at each, with the site."""
        return entry.item.id if len(self.lists) == 1 else f"{entry.cell.site}:{entry.item.id}"

    def item(self, entry: PlanEntry) -> Item:
        """What is known of an item: measured now, or answered by a person before."""
        site = entry.cell.site
        if entry.step.unless:
            return entry.item
        if entry.item.kind is not ItemKind.AUTOMATIC:
            return self._people(site).get(entry.item.id, entry.item)
        if site not in self._found:
            self._found[site] = {item.id: item for item in self._ask(site)}
        return self._found[site][entry.item.id]

    def _ask(self, site: str) -> tuple[Item, ...]:
        """Ask all that is wanted of a site at once."""
        expected = [item for item in self.lists[site].entries if self.name(item) in self.selected]
        entries = [entry for entry in expected if entry.item.kind is ItemKind.AUTOMATIC and not entry.step.unless]
        rehearse, listed = self.how.rehearse, replace(self.lists[site], entries=tuple(entries))
        with (
            session(
                self.how.arguments(site),
                rehearse=rehearse,
                via=self.how.via,
                choose_hosts=lambda declaration: taking_part(declaration, listed, rehearse=rehearse),
            ) as opened,
            listening(opened, (), ignore, self.how.ssh_config) as ears,
        ):
            return asyncio.run(examine(entries, ears.free, lambda _item: None))

    def _people(self, site: str) -> Mapping[str, Item]:
        """What people have answered in the latest checklist of the site that is of this declaration."""
        if site not in self._answered:
            folder = folder_of(Store(state_dir(), is_rehearsal=self.how.rehearse), site)
            kept = [book.document for book in books(folder) if book.document is not None and book.state in _VALID]
            mine = [entry for entry in kept if entry.inventory == self.declaration.revision]
            # The newest answer counts; a later checklist may be narrowed to other vehicles.
            self._answered[site] = {item.id: item for document in mine for item in document.items if _settled(item)}
        return self._answered[site]


def _settled(item: Item) -> bool:
    return not item.open or item.override is not None


def answer_lines(item: Item) -> Iterator[tuple[str, str]]:
    """What JUnit has of an item besides its outcome."""
    yield "item", item.id
    yield "title", item.title
    yield "verdict", str(item.verdict)
    yield "table3", str(item.table3).lower()
    yield "kind", str(item.kind)
    yield "message", item.message
    if item.counts is Verdict.WARN:
        reason = f" (overridden by {item.override.by}: {item.override.reason})" if item.override is not None else ""
        yield "warning", f"{item.message}{reason}"
    for evidence in item.evidence:
        by = f", {evidence.by}" if evidence.by is not None else ""
        yield "evidence", f"{evidence.type}: {evidence.what}: {evidence.value}{by}"


def waits(item: Item) -> str:
    """Why a test is skipped."""
    if not item.open:
        return item.message
    return f"a person confirms this: provision check site={item.location}"
