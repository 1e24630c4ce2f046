"""From the declaration to the list: every X of Table 3, every row, every check of the site, narrowed to a scope."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import SITE, Cell
from atlantis_netcfg.checklist.probes.registry import TITLES, by_a_person, steps_of
from atlantis_netcfg.checklist.report import Item, Kind, LeftOut, Phase, Row
from atlantis_netcfg.core.errors import NothingMatched
from atlantis_netcfg.core.suggest import nearest
from atlantis_netcfg.core.verdicts import Verdict
from atlantis_netcfg.declaration.model import ETHERNET, Column

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from atlantis_netcfg.checklist.probes import Step
    from atlantis_netcfg.declaration import Declaration


@dataclass(frozen=True, slots=True)
class Scope:
    """What a checklist is narrowed to; empty: everything."""

    vehicles: tuple[str, ...] = ()
    """With a vehicle, the location's own items are left out."""
    endpoints: tuple[str, ...] = ()
    phases: tuple[Phase, ...] = ()

    def as_dict(self) -> dict[str, tuple[str, ...]]:
        """In the words of the command line; what is not narrowed is not in it."""
        words = {"vehicle": self.vehicles, "endpoint": self.endpoints, "phase": tuple(map(str, self.phases))}
        return {name: chosen for name, chosen in words.items() if chosen}


@dataclass(frozen=True, slots=True)
class Entry:
    """One line that is still open, and what settles it."""

    item: Item
    step: Step
    cell: Cell


@dataclass(frozen=True, slots=True)
class Checklist:
    """The list of a site."""

    site: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    entries: tuple[Entry, ...]
    left_out: tuple[LeftOut, ...]
    scope: Scope
    notes: tuple[str, ...] = ()
    """What holds at the site, whatever is found."""
    beyond: tuple[str, ...] = ()
    """Items that the scope takes away, by id."""


def plan(declaration: Declaration, site: str, scope: Scope | None = None) -> Checklist:
    """Work out the list. Raises NothingMatched for words that name nothing, and where nothing is left."""
    scope = scope or Scope()
    _refuse_unknown(declaration, site, scope)
    rows = tuple(_rows(declaration, site))
    entries = [entry for row in rows for entry in _entries(declaration, site, row)]
    chosen = tuple(entry for entry in entries if _inside(entry, scope))
    if not chosen:
        raise NothingMatched(
            "nothing is left of the checklist", hint=f"leave out a word: `provision check site={site}` lists all"
        )
    return Checklist(
        site=site,
        title=declaration.sites[site].title,
        columns=tuple(map(str, Column)),
        rows=rows,
        entries=chosen,
        left_out=tuple(_left_out(entries, scope)),
        scope=scope,
        notes=tuple(_notes(declaration, site)),
        beyond=tuple(entry.item.id for entry in entries if not _inside(entry, scope)),
    )


def _refuse_unknown(declaration: Declaration, site: str, scope: Scope) -> None:
    if site not in declaration.sites:
        raise _unknown("site", site, declaration.sites)
    here = declaration.sites[site].checklist.vehicles
    for vehicle in scope.vehicles:
        if vehicle not in declaration.vehicles:
            raise _unknown("vehicle", vehicle, declaration.vehicles)
        if here is not None and vehicle not in here:
            hint = f"its vehicles are: {', '.join(here) or 'none'}; `checklist.vehicles` of the site says so"
            raise NothingMatched(f"`{vehicle}` is not tested at {site}", hint=hint)
    for endpoint in scope.endpoints:
        if endpoint not in TITLES:
            raise _unknown("endpoint", endpoint, TITLES)


def _unknown(what: str, word: str, known: Iterable[str]) -> NothingMatched:
    every = list(known)
    near = nearest(word, every)
    listed = f"there are: {', '.join(every)}"
    return NothingMatched(f"there is no {what} `{word}`", hint=f"did you mean `{near}`? {listed}" if near else listed)


def _rows(declaration: Declaration, site: str) -> Iterator[Row]:
    here = declaration.sites[site].checklist.vehicles
    for key, vehicle in declaration.vehicles.items():
        if here is None or key in here:
            yield Row(
                key=key,
                name=vehicle.name,
                kind=str(vehicle.kind),
                aliases=vehicle.aliases,
                table3=tuple(str(column) for column in Column if column in vehicle.table3),
                deviation=vehicle.table3_deviation,
                beside=(ETHERNET,) if vehicle.ethernet else (),
            )
    declared = declaration.sites[site]
    marked = [str(column) for column in Column if column in declared.location.table3]
    carried = {str(bearer.kind.traits.column) for bearer in declared.bearers}
    if declared.location.ethernet:
        carried.add(ETHERNET)
    beside = [name for name in (*map(str, Column), ETHERNET) if name in carried and name not in marked]
    yield Row(key=site, name=declared.title, kind="location", table3=tuple(marked), beside=(*beside, SITE))


def _entries(declaration: Declaration, site: str, row: Row) -> Iterator[Entry]:
    vehicle = None if row.kind == "location" else row.key
    for endpoint in (*row.table3, *row.beside):
        cell = Cell(declaration, site, vehicle, endpoint)
        # A column that has nothing to say still has its line: somebody looks.
        for step in steps_of(cell) or (by_a_person(cell),):
            yield Entry(_item(cell, step, table3=endpoint in row.table3), step, cell)


def _item(cell: Cell, step: Step, *, table3: bool) -> Item:
    skipped = bool(step.unless)
    return Item(
        id="/".join(filter(None, (cell.row, cell.endpoint, step.name))),
        title=step.title,
        vehicle=cell.vehicle,
        location=cell.site,
        endpoint=cell.endpoint,
        table3=table3,
        kind=step.kind,
        phase=step.phase,
        open=not skipped,
        verdict=Verdict.SKIP if skipped else Verdict.INCONCLUSIVE,
        message=step.unless or _OPEN[step.kind],
    )


_OPEN = {
    Kind.AUTOMATIC: "not looked at yet",
    Kind.ACTIVE: "waits for a person's consent",
    Kind.PERSON: "waits for a person",
}


def _inside(entry: Entry, scope: Scope) -> bool:
    item = entry.item
    return (
        (not scope.vehicles or item.vehicle in scope.vehicles)
        and (not scope.endpoints or item.endpoint in scope.endpoints)
        and (not scope.phases or item.phase in scope.phases)
    )


def _left_out(entries: Sequence[Entry], scope: Scope) -> Iterator[LeftOut]:
    """Name what the scope takes away, cell by cell."""
    words = " ".join(f"{name}={','.join(chosen)}" for name, chosen in scope.as_dict().items())
    away = dict.fromkeys(
        (entry.cell.name, TITLES[entry.item.endpoint]) for entry in entries if not _inside(entry, scope)
    )
    for name, title in away:
        yield LeftOut(what=f"{name}: {title}", why=f"left out by `{words}`")


def _notes(declaration: Declaration, site: str) -> Iterator[str]:
    """Say where the policy cannot keep robots apart; a vehicle without a declared partner may be anybody's."""
    reserved = {row.name for row in declaration.sites[site].lan.reservations}
    robots = {key: vehicle for key, vehicle in declaration.vehicles.items() if key in reserved}
    if len({vehicle.partner or f"unknown: {key}" for key, vehicle in robots.items()}) > 1:
        names = ", ".join(f"{robot.name} ({robot.partner or 'partner not declared'})" for robot in robots.values())
        yield (
            f"neighbours in the LAN of {site} reach each other, whatever the policy says: what goes from port to port"
            f" of one switch, or through one access point, passes no filter. Robots with an address there: {names}."
            " One that has to be kept from the others is not plugged in, and comes by the VPN alone"
        )
