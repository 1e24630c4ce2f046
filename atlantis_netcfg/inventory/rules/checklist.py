"""Rules for the pilot's own checklist items: ids are unique, and everything that an item names exists."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import _draft, findings, model

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

_Path = tuple[str | int, ...]
_ItemPlace = tuple[_draft.Part, _Path, model.CheckItem]
"""Part and path of an item, and the item."""


def _vehicle_items(draft: _draft.Draft) -> Iterator[_ItemPlace]:
    for key, vehicle in draft.vehicles.items():
        for index, item in enumerate(vehicle.checklist.items):
            yield _draft.Part("vehicle", key), ("checklist", "items", index), item


def _of_a_site(
    name: str, site: model.Site, only: int | None = None
) -> Iterator[tuple[_draft.Part, _Path, model.SiteCheckItem]]:
    """Yield a site's items: the permanent ones, then those of each mission or, with `only`, of one mission."""
    part = _draft.Part("site", name)
    for index, item in enumerate(site.checklist.items):
        yield part, ("checklist", "items", index), item
    for number, mission in enumerate(site.checklist.missions):
        for index, item in enumerate(mission.items if only in {None, number} else ()):
            yield part, ("checklist", "missions", number, "items", index), item


def unique(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require unique item ids in one checklist; two missions may share an id, as only one of them runs."""
    every = list(_vehicle_items(draft))
    yield from _twice(draft, every)
    for name, site in draft.sites.items():
        here = site.checklist.vehicles
        always = [entry for entry in every if here is None or entry[0].name in here]
        missions = range(len(site.checklist.missions))
        for mission in missions or (None,):
            yield from _twice(draft, [*always, *_of_a_site(name, site, mission)])


def _twice(draft: _draft.Draft, items: Iterable[_ItemPlace]) -> Iterator[findings.Finding]:
    """Report ids that occur twice among the items of one list."""
    first: dict[tuple[str | None, str], tuple[_draft.Part, _Path]] = {}
    for part, path, item in items:
        row = part.name if part.sort == "vehicle" else getattr(item, "vehicle", None)
        first_place = first.setdefault((row, item.id), (part, path))
        if first_place != (part, path):
            where = draft.where(first_place[0], *first_place[1], "id")
            yield draft.finding_at(
                part,
                (*path, "id"),
                msg(f"`{arg(item.id)}` is already the id of an item ({arg(where)})"),
                "choose another one",
            )


def vehicles(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require that an item's vehicle is one that the site tests."""
    vehicle_names = draft.names("vehicle")
    for name, site in draft.sites.items():
        here = site.checklist.vehicles
        for part, path, item in _of_a_site(name, site):
            if item.vehicle is None:
                continue
            if item.vehicle not in vehicle_names:
                hint = findings.suggest(item.vehicle, vehicle_names, none="add it to `vehicles`")
                yield draft.finding_at(
                    part, (*path, "vehicle"), msg(f"vehicle `{arg(item.vehicle)}` does not exist"), hint
                )
            elif here is not None and item.vehicle not in here:
                message = msg(f"`{arg(item.vehicle)}` is not tested at `{arg(name)}`, so nobody would be asked")
                hint = "add it to `checklist: vehicles:` of the site, or remove the item"
                yield draft.finding_at(part, (*path, "vehicle"), message, hint)


def people(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require that whoever may answer or sign is a role of the pilot or a named person."""
    if draft.pilot is None:
        return
    roles = [role.name for role in draft.pilot.roles]
    for part, path, words in _person_lists(draft):
        for index, word in enumerate(words):
            if findings.why_no_name(word) is None and word not in roles:
                none = msg(f"add it: `roles: [{{name: {arg(word)}, people: [A. Person]}}]` of `pilot`")
                hint = findings.suggest(
                    word, roles, none=msg(f"{arg(none)}; the name of a person has a capital letter or a space")
                )
                yield draft.finding_at(part, (*path, index), msg(f"role `{arg(word)}` does not exist"), hint)


def _person_lists(draft: _draft.Draft) -> Iterator[tuple[_draft.Part, _Path, tuple[str, ...]]]:
    for part, path, item in _vehicle_items(draft):
        yield part, (*path, "by"), item.by
    for name, site in draft.sites.items():
        yield _draft.Part("site", name), ("checklist", "signed_by"), site.checklist.signed_by
        for part, path, item in _of_a_site(name, site):
            yield part, (*path, "by"), item.by


def names(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require unique names for the missions of a site and the roles of the pilot."""
    for name, site in draft.sites.items():
        mission_names = [mission.name for mission in site.checklist.missions]
        for index, word in enumerate(mission_names):
            if word in mission_names[:index]:
                path = ("checklist", "missions", index, "name")
                yield draft.finding_at(
                    _draft.Part("site", name), path, msg(f"there are two missions `{arg(word)}`"), "rename one"
                )
    roles = [role.name for role in draft.pilot.roles] if draft.pilot is not None else []
    for index, word in enumerate(roles):
        if word in roles[:index]:
            yield draft.finding_at(
                _draft.Part("pilot"), ("roles", index, "name"), msg(f"there are two roles `{arg(word)}`"), "rename one"
            )


def gateways(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require a gateway at sites with gateway items; a vehicle's item is INCONCLUSIVE without one."""
    sites = {place for host, place in draft.layout.hosts.items() if draft.kind_of(host) == "gateway"}
    for name, site in draft.sites.items():
        for part, path, item in _of_a_site(name, site):
            if item.kind is model.ItemSort.COMMAND and item.seen_from is model.SeenFrom.GATEWAY and name not in sites:
                message = msg(f"`{arg(item.id)}` is run on the gateway, but `{arg(name)}` has none")
                yield draft.finding_at(
                    part, (*path, "command"), message, "write `seen_from: laptop`, or remove the item"
                )


RULES: tuple[_draft.Rule, ...] = (unique, vehicles, people, names, gateways)
