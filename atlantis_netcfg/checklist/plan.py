"""Compute the checklist from the inventory: every X of Table 3, every row, every site check, limited to a scope.

Also the drawing of a site: its hosts, its links, and the items that concern each.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist import probes, report
from atlantis_netcfg.checklist.probes import registry
from atlantis_netcfg.checklist.probes.items import items_of, people
from atlantis_netcfg.checklist.probes.robot_files import RobotFiles
from atlantis_netcfg.core import errors
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import model

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from atlantis_netcfg.inventory import Host, Inventory


@dataclass(frozen=True, slots=True)
class Scope:
    """Filter of a checklist; empty: everything."""

    vehicles: tuple[str, ...] = ()
    """Selected vehicles; with a vehicle, the location's own items are left out."""
    endpoints: tuple[str, ...] = ()
    phases: tuple[report.Phase, ...] = ()
    """Recovery or integration alone, or some of the other phases; empty: all other phases."""
    mission: str = ""
    """Mission whose items are added; it does not narrow the scope."""

    @property
    def alone(self) -> report.Phase | None:
        """Phase that is a separate list with its own signature; None: the list before a test."""
        return next((phase for phase in self.phases if phase.is_alone), None)

    def has(self, item: report.Item | model.SiteCheckItem) -> bool:
        """Return whether an item belongs to this list, filtered or not; an integration record is for one robot."""
        if self.alone is report.Phase.INTEGRATION and item.phase is report.Phase.INTEGRATION:
            return item.vehicle in self.vehicles
        return item.phase is self.alone if self.alone else not item.phase.is_alone

    def as_dict(self) -> dict[str, tuple[str, ...]]:
        """Return the filter as command-line arguments; unused filters are left out."""
        words = {"vehicle": self.vehicles, "endpoint": self.endpoints, "phase": tuple(map(str, self.phases))}
        return {name: values for name, values in words.items() if values}


@dataclass(frozen=True, slots=True)
class PlanEntry:
    """An open item and the step that settles it."""

    item: report.Item
    step: probes.Step
    cell: probes.Cell


@dataclass(frozen=True, slots=True)
class Checklist:
    """The list of a site."""

    site: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[report.Row, ...]
    entries: tuple[PlanEntry, ...]
    left_out: tuple[report.LeftOut, ...]
    scope: Scope
    notes: tuple[str, ...] = ()
    """Notes that apply to the site whatever the results are."""
    beyond: tuple[str, ...] = ()
    """Ids of the items outside the scope, and of those of the other lists."""
    signers: tuple[str, ...] = ()
    """Names of the only people who may sign it; empty: anybody."""


def plan(inventory: Inventory, site: str, scope: Scope | None = None) -> Checklist:
    """Compute the list. Raises NoMatchError for unknown names, or if the result is empty."""
    scope = scope or Scope()
    _refuse_unknown(inventory, site, scope)
    robots = RobotFiles.read(inventory, site)
    whole = tuple(_every_row(inventory, site, scope.mission, robots))
    every = [entry for row in whole for entry in _entries(inventory, site, row, scope.mission, robots)]
    entries = [entry for entry in every if scope.has(entry.item)]
    selection = tuple(entry for entry in entries if _is_in_scope(entry, scope))
    if not selection:
        raise _empty_scope_error(site, scope)
    items = {entry.item.id for entry in selection}
    return Checklist(
        site=site,
        title=inventory.sites[site].title,
        columns=() if scope.alone else tuple(map(str, model.Column)),
        rows=tuple(_rows(whole, entries, scope)),
        entries=selection,
        left_out=tuple(_left_out(entries, scope)),
        scope=scope,
        notes=(
            *_notes_of_guests(inventory, whole),
            *(() if scope.alone else (*_notes(inventory, site), *_notes_of_robots(whole))),
            *_notes_of_items(inventory, site, scope, every),
        ),
        beyond=tuple(entry.item.id for entry in every if entry.item.id not in items),
        signers=people(inventory, inventory.sites[site].checklist.signed_by),
    )


def _refuse_unknown(inventory: Inventory, site: str, scope: Scope) -> None:
    if site not in inventory.sites:
        raise _unknown_name_error("site", site, inventory.sites)
    here = inventory.sites[site].checklist.vehicles
    for vehicle in scope.vehicles:
        if vehicle not in inventory.vehicles:
            raise _unknown_name_error("vehicle", vehicle, inventory.vehicles)
        if here is not None and vehicle not in here:
            hint = msg(
                f"its vehicles are: {arg(join(', ', here) or 'none')}; they are set in `checklist.vehicles` of the site"
            )
            raise errors.NoMatchError(f"`{arg(vehicle)}` is not tested at {arg(site)}", hint=hint)
    for endpoint in scope.endpoints:
        if endpoint not in registry.TITLES:
            raise _unknown_name_error("endpoint", endpoint, registry.TITLES)
    missions = [mission.name for mission in inventory.sites[site].checklist.missions]
    if scope.mission and scope.mission not in missions:
        raise _unknown_name_error("mission", scope.mission, missions)
    _refuse_mixed(inventory, site, scope)


def _refuse_mixed(inventory: Inventory, site: str, scope: Scope) -> None:
    """Raise UsageError if a separate list is mixed with other phases, or an integration record has several robots."""
    here = inventory.sites[site].checklist.vehicles
    if scope.alone is report.Phase.INTEGRATION and len(scope.vehicles) != 1:
        every = scope.vehicles or [key for key in inventory.vehicles if here is None or key in here] or ["NAME"]
        hint = msg(f"name it: `provision check site={arg(site)} vehicle={arg(every[0])} phase=integration`")
        raise errors.UsageError("an integration record is for one robot", hint=hint)
    if scope.alone and len(scope.phases) > 1:
        hint = msg(f"`provision check site={arg(site)} phase=recovery` on its own, when the vehicles are back")
        if scope.alone is report.Phase.INTEGRATION:
            hint = msg(
                f"`provision check site={arg(site)} vehicle={arg(scope.vehicles[0])} phase=integration` on its own"
            )
        raise errors.UsageError(f"the items of {arg(scope.alone)} are a separate checklist", hint=hint)


def _unknown_name_error(what: str, word: str, names: Iterable[str]) -> errors.NoMatchError:
    every = list(names)
    near = errors.nearest(word, every)
    choices = msg(f"choose one of: {arg(join(', ', every) or 'none')}")
    return errors.NoMatchError(
        f"unknown {arg(what)} `{arg(word)}`", hint=f"did you mean `{arg(near)}`? {arg(choices)}" if near else choices
    )


def _empty_scope_error(site: str, scope: Scope) -> errors.NoMatchError:
    if scope.alone is report.Phase.INTEGRATION:
        hint = msg(f"create its file robots/{arg(scope.vehicles[0])}.yml in the inventory: see docs/robots.md")
        return errors.NoMatchError(
            f"`{arg(scope.vehicles[0])}` has no robot file, so it has no integration record", hint=hint
        )
    if scope.alone:
        hint = "add them under `checklist: items:` with `phase: recovery` (docs/checklist.md)"
        return errors.NoMatchError(f"{arg(site)} has no such recovery item in the inventory", hint=hint)
    hint = msg(f"remove an argument: `provision check site={arg(site)}` lists all items")
    return errors.NoMatchError("no item of the checklist is left", hint=hint)


def _rows(every: Iterable[report.Row], entries: Sequence[PlanEntry], scope: Scope) -> Iterator[report.Row]:
    """Yield the rows of a list; a separate list has only rows with items, and nothing of Table 3."""
    cells = {(entry.cell.row, entry.item.endpoint) for entry in entries}
    for row in every:
        beside = tuple(name for name in row.beside if (row.key, name) in cells)
        if not scope.alone:
            yield row.model_copy(update={"beside": beside})
        elif beside:
            yield row.model_copy(update={"table3": (), "beside": beside, "deviation": None})


def _every_row(inventory: Inventory, site: str, mission: str, robots: RobotFiles | None) -> Iterator[report.Row]:
    here = inventory.sites[site].checklist.vehicles
    for key, vehicle in inventory.vehicles.items():
        if here is None or key in here:
            cells = tuple(str(column) for column in model.Column if column in vehicle.table3)
            robot_items = (
                (probes.ROBOT, probes.INTEGRATION) if robots is not None and key in robots.tested_vehicles else ()
            )
            cable = (model.ETHERNET,) if vehicle.ethernet else ()
            others = (*cable, *robot_items, *_items(inventory, site, key, mission))
            yield report.Row(
                key=key,
                name=vehicle.name,
                kind=str(vehicle.kind),
                aliases=vehicle.aliases,
                table3=() if vehicle.guest else cells,
                deviation=vehicle.table3_deviation,
                beside=(*cells, *others) if vehicle.guest else others,
            )
    site_config = inventory.sites[site]
    table3_columns = [str(column) for column in model.Column if column in site_config.location.table3]
    link_columns = {str(link.kind.traits.column) for link in site_config.bearers}
    if site_config.location.ethernet:
        link_columns.add(model.ETHERNET)
    beside = [
        name
        for name in (*map(str, model.Column), model.ETHERNET)
        if name in link_columns and name not in table3_columns
    ]
    beside += [probes.SITE, *((probes.ROBOT,) if robots is not None else ()), *_items(inventory, site, None, mission)]
    yield report.Row(
        key=site, name=site_config.title, kind="location", table3=tuple(table3_columns), beside=tuple(beside)
    )


def _items(inventory: Inventory, site: str, vehicle: str | None, mission: str) -> tuple[str, ...]:
    """Return the column for inventory items of a row, if the row has any."""
    return (
        (probes.ITEMS,)
        if any(True for _ in items_of(probes.Cell(inventory, site, vehicle, probes.ITEMS, mission)))
        else ()
    )


def _entries(
    inventory: Inventory, site: str, row: report.Row, mission: str, robots: RobotFiles | None
) -> Iterator[PlanEntry]:
    vehicle = None if row.kind == "location" else row.key
    for endpoint in (*row.table3, *row.beside):
        cell = probes.Cell(inventory, site, vehicle, endpoint, mission, robots)
        # A column that has nothing to say still has its line: somebody looks.
        for step in registry.steps_of(cell) or (registry.by_a_person(cell),):
            yield PlanEntry(_item(cell, step, table3=endpoint in row.table3), step, cell)


def _item(cell: probes.Cell, step: probes.Step, *, table3: bool) -> report.Item:
    is_skipped = bool(step.unless)
    return report.Item(
        id="/".join(filter(None, (cell.row, cell.endpoint, step.name))),
        title=step.title,
        vehicle=cell.vehicle,
        location=cell.site,
        endpoint=cell.endpoint,
        table3=table3,
        kind=step.kind,
        phase=step.phase,
        open=not is_skipped,
        verdict=Verdict.SKIP if is_skipped else Verdict.INCONCLUSIVE,
        message=step.unless or (msg(f"waits for {arg(_join_names(step.by))}") if step.by else _OPEN[step.kind]),
    )


def _join_names(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else msg(f"one of {arg(join(', ', names))}")


_OPEN = {
    report.ItemKind.AUTOMATIC: "not checked yet",
    report.ItemKind.ACTIVE: "waits for a person's consent",
    report.ItemKind.PERSON: "waits for a person",
}


def _is_in_scope(entry: PlanEntry, scope: Scope) -> bool:
    item = entry.item
    return (
        (not scope.vehicles or item.vehicle in scope.vehicles)
        and (not scope.endpoints or item.endpoint in scope.endpoints)
        and (not scope.phases or item.phase in scope.phases)
    )


def _left_out(entries: Sequence[PlanEntry], scope: Scope) -> Iterator[report.LeftOut]:
    """Yield what the scope excludes, cell by cell."""
    words = " ".join(f"{name}={','.join(values)}" for name, values in scope.as_dict().items())
    away = dict.fromkeys(
        (entry.cell.name, registry.TITLES[entry.item.endpoint]) for entry in entries if not _is_in_scope(entry, scope)
    )
    for name, title in away:
        yield report.LeftOut(what=msg(f"{arg(name)}: {arg(title)}"), why=msg(f"excluded by `{arg(words)}`"))


def _notes(inventory: Inventory, site: str) -> Iterator[str]:
    """Yield notes where policy cannot separate robots; a vehicle with no partner in the inventory may be anybody's."""
    reserved_keys = {row.name for row in inventory.sites[site].lan.reservations}
    robots = {key: vehicle for key, vehicle in inventory.vehicles.items() if key in reserved_keys}
    if len({vehicle.partner or f"unknown: {key}" for key, vehicle in robots.items()}) > 1:
        names = join(
            ", ",
            (
                msg(f"{arg(robot.name)} ({arg(robot.partner or 'partner not in the inventory')})")
                for robot in robots.values()
            ),
        )
        yield msg(
            f"neighbours in the LAN of {arg(site)} reach each other, whatever the policy says: traffic between ports "
            "of one switch, or through one access point, passes no filter. Robots with an address there: "
            f"{arg(names)}. Do not plug in a robot that must be kept from the others: connect it over the VPN only"
        )


def _notes_of_robots(rows: Iterable[report.Row]) -> Iterator[str]:
    """Yield a note about robots without a file that lists what they should publish."""
    names = [row.name for row in rows if row.kind != "location" and probes.ROBOT not in row.beside]
    if names:
        yield msg(f"not checked, because they have no file in robots/: what {arg(join(', ', names))} publish")


def _notes_of_guests(inventory: Inventory, rows: Iterable[report.Row]) -> Iterator[str]:
    """Yield a note about each guest vehicle, whose row the report's table does not have."""
    for row in rows:
        vehicle = inventory.vehicles.get(row.key) if row.kind != "location" else None
        if vehicle is not None and vehicle.guest:
            partner = inventory.partners[vehicle.partner or ""].full_name
            until = msg(f" until {arg(vehicle.until)}" if isinstance(vehicle, model.Guest) else "")
            yield msg(f"{arg(row.name)} is a guest of {arg(partner)}{arg(until)}, not a robot of the report's Table 3")


def _notes_of_items(inventory: Inventory, site: str, scope: Scope, every: Iterable[PlanEntry]) -> Iterator[str]:
    """Yield notes on the selected mission, items left to other missions, and items asked when vehicles return."""
    missions = inventory.sites[site].checklist.missions
    other = [mission.name for mission in missions if any(scope.has(item) for item in mission.items)]
    selected_mission = next((mission for mission in missions if mission.name == scope.mission), None)
    if selected_mission is not None:
        yield msg(f"with the items of mission {arg(selected_mission.name)}: {arg(selected_mission.title)}")
    elif other:
        yield msg(f"no mission given; `mission=NAME` adds the items of a mission: {arg(join(', ', other))}")
    later = [entry for entry in every if entry.item.phase is report.Phase.RECOVERY]
    later = [entry for entry in later if not scope.vehicles or entry.item.vehicle in scope.vehicles]
    if later and not scope.alone:
        words = msg("1 item of recovery is" if len(later) == 1 else f"{arg(len(later))} items of recovery are")
        vehicles = f" vehicle={','.join(scope.vehicles)}" if scope.vehicles else ""
        mission = f"{vehicles} mission={scope.mission}" if scope.mission else vehicles
        yield msg(
            f"{arg(words)} still to come, in a separate checklist, when the vehicles are back: `provision check "
            f"site={arg(site)}{arg(mission)} phase=recovery`"
        )


_PARTNERS, _INTERNET = "partners", "internet"
"""Keys of drawing nodes that are not hosts; the keys of hosts, sites and vehicles are their names."""


def drawing(inventory: Inventory, checklist: Checklist) -> report.Drawing:
    """Draw the site of a checklist, in the order of the inventory, so that the result is reproducible."""
    return _DrawingBuilder(inventory, checklist).drawing()


class _DrawingBuilder:
    def __init__(self, inventory: Inventory, checklist: Checklist) -> None:
        self._inventory = inventory
        self._site = checklist.site
        self._rows = checklist.rows
        self._entries = checklist.entries
        self._hosts = inventory.site_hosts(self._site)
        self._server = inventory.hosts[inventory.pilot.vpn.server]

    def drawing(self) -> report.Drawing:
        nodes = {node.key: node for node in chain(self._far(), self._site_nodes(), self._vehicles())}
        links = chain(self._vpn_links(), self._links(), self._local(), self._vehicle_links())
        valid_links = [link for link in links if link.a in nodes and link.b in nodes and link.a != link.b]
        return report.Drawing(nodes=tuple(nodes.values()), links=tuple(valid_links))

    @property
    def _site_config(self) -> model.Site:
        return self._inventory.sites[self._site]

    @property
    def _router(self) -> Host | None:
        return next((host for host in self._hosts if isinstance(host.device, model.Router)), None)

    @property
    def _gateway(self) -> Host | None:
        return self._inventory.computer_of(self._site)

    @property
    def _middle(self) -> str:
        """Node that represents the site: its router, else its gateway, else the site itself."""
        return next((host.name for host in (self._router, self._gateway) if host is not None), self._site)

    @property
    def _other_end(self) -> str:
        """Node to which the links lead: the site of the VPN server, or the Internet if that is this site."""
        return _INTERNET if self._server.site == self._site else self._server.site

    def _far(self) -> Iterator[report.DrawnNode]:
        """Yield the remote nodes, the VPN's server first, because lines to it run along that side."""
        if self._server.site != self._site:
            yield self._host(self._server)
        names = join(", ", (partner.full_name for partner in self._inventory.partners.values()))
        if names:
            yield report.DrawnNode(key=_PARTNERS, label="Partners", kind="partner", detail=names)
        if self._server.site != self._site:
            title = self._inventory.sites[self._server.site].title
            yield report.DrawnNode(key=self._server.site, label=title, kind="site")
        else:
            yield report.DrawnNode(key=_INTERNET, label="Internet", kind="site")
        for link in self._site_config.served_links:
            yield report.DrawnNode(key=link.carries, label=self._inventory.sites[link.carries].title, kind="site")

    def _site_nodes(self) -> Iterator[report.DrawnNode]:
        for host in self._hosts:
            yield self._host(host)
        if self._router is None and self._gateway is None:
            yield report.DrawnNode(
                key=self._site, label=self._site_config.title, kind="site", items=self._general_items()
            )

    def _host(self, host: Host) -> report.DrawnNode:
        item_ids = [entry.item.id for entry in self._entries if host.name in entry.step.concerns]
        local = [
            item for link in self._site_config.bearers if link.device == host.name for item in self._link_item_ids(link)
        ]
        rest = self._general_items() if host.name == self._middle else ()
        return report.DrawnNode(
            key=host.name,
            label=host.name,
            kind=host.device.kind,
            items=tuple(dict.fromkeys((*item_ids, *local, *rest))),
            detail=str(getattr(host.device, "address", "")),
        )

    def _general_items(self) -> tuple[str, ...]:
        """Return the site's own items that concern no particular host."""
        names = {host.name for host in (*self._hosts, self._server)}
        local = [
            entry
            for entry in self._entries
            if entry.item.vehicle is None and entry.item.endpoint in {probes.SITE, probes.ROBOT, probes.ITEMS}
        ]
        return tuple(entry.item.id for entry in local if names.isdisjoint(entry.step.concerns))

    def _vehicles(self) -> Iterator[report.DrawnNode]:
        for row in self._robots():
            items = tuple(entry.item.id for entry in self._entries if entry.item.vehicle == row.key)
            yield report.DrawnNode(
                key=row.key, label=row.name, kind="vehicle", items=items, detail=row.kind.upper().replace("_", " ")
            )

    def _robots(self) -> Iterator[report.Row]:
        return (row for row in self._rows if row.kind != "location")

    def _vpn_links(self) -> Iterator[report.DrawnLink]:
        yield report.DrawnLink(a=_PARTNERS, b=self._server.name, label="VPN", kind="vpn")
        yield report.DrawnLink(a=self._server.name, b=self._server.site, label="", kind="ethernet")
        if self._router is not None and self._server.site != self._site:
            items = tuple(entry.item.id for entry in self._site_entries() if "vpn" in entry.step.name)
            yield report.DrawnLink(a=self._router.name, b=self._server.name, label="VPN", kind="vpn", items=items)

    def _site_entries(self) -> Iterator[PlanEntry]:
        return (entry for entry in self._entries if entry.item.endpoint == probes.SITE)

    def _link_item_ids(self, link: model.Link) -> tuple[str, ...]:
        column = link.kind.traits.column
        return tuple(
            entry.item.id
            for entry in self._entries
            if entry.item.vehicle is None and entry.item.endpoint == column and self._concerns_link(entry, link)
        )

    def _concerns_link(self, entry: PlanEntry, link: model.Link) -> bool:
        """Return whether an item concerns a link; with two links of one kind, items for the other's device do not."""
        others = {item.device for item in self._site_config.bearers if item.name != link.name} - {link.device, None}
        return link.device in entry.step.concerns or others.isdisjoint(entry.step.concerns)

    def _links(self) -> Iterator[report.DrawnLink]:
        for site_link in self._site_config.bearers:
            column, near = site_link.kind.traits.column, site_link.device or self._middle
            yield report.DrawnLink(
                a=near,
                b=self._other_end,
                label=registry.TITLES[column],
                kind=column,
                items=self._link_item_ids(site_link),
            )
        for link in self._site_config.served_links:
            yield report.DrawnLink(
                a=link.device, b=link.carries, label=registry.TITLES[model.Column.WIFI], kind=model.Column.WIFI
            )

    def _local(self) -> Iterator[report.DrawnLink]:
        """Yield the router's cables: a link's device on the port of that link, everything else in the LAN."""
        if self._router is None or not isinstance(self._router.device, model.Router):
            return
        on = {port.link: port for port in self._router.device.ports if port.link is not None}
        box_of: dict[str, str | None] = {site_link.name: site_link.device for site_link in self._site_config.bearers}
        box_of |= {served_link.name: served_link.device for served_link in self._site_config.served_links}
        ports = {box_of[link]: port for link, port in on.items() if box_of.get(link) is not None}
        for host in self._hosts:
            port = ports.get(host.name)
            power = ", PoE" if port is not None and port.poe is not None else ""
            label = f"{port.name}{power}" if port is not None else "LAN"
            yield report.DrawnLink(a=self._router.name, b=host.name, label=label, kind="ethernet")

    def _vehicle_links(self) -> Iterator[report.DrawnLink]:
        for row in self._robots():
            for endpoint in (
                name
                for name in (*row.table3, *row.beside)
                if name not in {probes.ROBOT, probes.INTEGRATION, probes.ITEMS}
            ):
                items = tuple(
                    entry.item.id
                    for entry in self._entries
                    if entry.item.vehicle == row.key and entry.item.endpoint == endpoint
                )
                by = self._seen_by(self._inventory.vehicles[row.key].endpoints, endpoint)
                yield report.DrawnLink(a=row.key, b=by, label=registry.TITLES[endpoint], kind=endpoint, items=items)

    def _seen_by(self, endpoints: model.Endpoints, endpoint: str) -> str:
        """Return the host that sees the vehicle over an endpoint, as far as the inventory defines it."""
        endpoint_config = getattr(endpoints, endpoint, None)
        if (by := getattr(endpoint_config, "seen_by", None)) is not None and by in {host.name for host in self._hosts}:
            return str(by)
        station = endpoint == model.Column.WIFI and getattr(endpoint_config, "role", None) is model.WifiRole.STATION
        laptop = getattr(endpoint_config, "seen_from", None) is model.SeenFrom.LAPTOP
        if self._gateway is None or station or laptop:
            return self._middle
        return self._gateway.name
