"""Rules for endpoint checks: only checklist endpoints, checked from capable devices, at existing addresses.

Probe targets: addresses beyond a link that are pinged over it, to learn whether it carries traffic.
"""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Network
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import _draft, findings, model
from atlantis_netcfg.inventory.rules.networks import NetworkIndex, claims

if TYPE_CHECKING:
    from collections.abc import Iterator


_Path = tuple[str | int, ...]


@dataclass(frozen=True, slots=True)
class _EndpointRow:
    """A checklist row that has endpoints."""

    part: _draft.Part
    path: _Path
    endpoints: model.Endpoints
    columns: frozenset[str]
    """Columns that are checked."""

    @property
    def endpoint_names(self) -> list[str]:
        return [name for name in model.Endpoints.model_fields if getattr(self.endpoints, name) is not None]


def _rows(draft: _draft.Draft) -> Iterator[_EndpointRow]:
    for key, vehicle in draft.vehicles.items():
        columns = {str(column) for column in vehicle.table3} | ({model.ETHERNET} if vehicle.ethernet else set())
        yield _EndpointRow(_draft.Part("vehicle", key), (), vehicle.endpoints, frozenset(columns))
    for name, site in draft.sites.items():
        columns = {str(column) for column in site.location.table3} | _link_columns(site)
        yield _EndpointRow(_draft.Part("site", name), ("location",), site.location.endpoints, frozenset(columns))


def _link_columns(site: model.Site) -> set[str]:
    """Return the checklist columns of a location that are checked because of its links."""
    columns = {str(link.kind.traits.column) for link in site.bearers} & {str(model.Column.WIFI), model.ETHERNET}
    return columns | ({model.ETHERNET} if site.location.ethernet else set())


def check_tested_vehicles(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require that the vehicles that a site tests exist in the pilot and are listed once."""
    vehicle_names = draft.names("vehicle")
    for name, site in draft.sites.items():
        here = site.checklist.vehicles or ()
        for index, key in enumerate(here):
            path = ("checklist", "vehicles", index)
            if key not in vehicle_names:
                hint = findings.suggest(key, vehicle_names, none="add it to `vehicles`")
                yield draft.finding_at(
                    _draft.Part("site", name), path, msg(f"vehicle `{arg(key)}` does not exist"), hint
                )
            elif key in here[:index]:
                yield draft.finding_at(
                    _draft.Part("site", name), path, msg(f"`{arg(key)}` is twice in this list"), "remove one"
                )


def in_the_table(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require that a described endpoint is marked in the row's `table3` or, for a cable, listed beside it."""
    for row in _rows(draft):
        for name in row.endpoint_names:
            if name in row.columns:
                continue
            message = msg(f"`{arg(name)}` is described here but not checked: `table3` does not mark it")
            hint = msg(f"remove `{arg(name)}:` here, or mark it in `table3`")
            if name == model.ETHERNET:
                message = "`ethernet` is described here but not checked: `ethernet: true` is missing"
                hint = "remove it here, or write `ethernet: true` next to `table3`"
            yield draft.finding_at(row.part, (*row.path, "endpoints", name), message, hint)


def seen_by(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require that `seen_by` is a RouterOS device; for a location, one of that location."""
    for row in _rows(draft):
        for name in row.endpoint_names:
            host = getattr(getattr(row.endpoints, name), "seen_by", None)
            if host is None:
                continue
            path = (*row.path, "endpoints", name, "seen_by")
            able = [
                routero
                for routero in _routeros(draft)
                if row.part.sort == "vehicle" or _site_of(draft, routero) == row.part.name
            ]
            if host not in draft.layout.hosts:
                hint = findings.suggest(host, able, none="add it to hosts.yml")
                yield draft.finding_at(row.part, path, msg(f"host `{arg(host)}` does not exist"), hint)
            elif host in draft.devices and host not in _routeros(draft):
                message = msg(f"`{arg(host)}` is not a RouterOS device: it cannot report what it sees")
                yield draft.finding_at(row.part, path, message, msg(f"available: {arg(findings.choices(able))}"))
            elif host in draft.devices and host not in able:
                message = msg(f"`{arg(host)}` is at `{arg(_site_of(draft, host))}`, not here")
                yield draft.finding_at(row.part, path, message, msg(f"available: {arg(findings.choices(able))}"))


def _site_of(draft: _draft.Draft, host: str) -> str:
    return draft.layout.hosts[host]


def _routeros(draft: _draft.Draft) -> list[str]:
    return [host for host in draft.layout.hosts if _is_routeros(draft.devices.get(host))]


def _is_routeros(device: model.Device | None) -> bool:
    return isinstance(device, model.Router | model.Switch | model.Cpe) or (
        isinstance(device, model.LteRouter) and device.driver is model.LteDriver.ROUTEROS
    )


def another_modem(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require that a modem's peer is another modem, and unique addresses per kind of modem."""
    first: dict[tuple[str, int], str] = {}
    for key, vehicle in draft.vehicles.items():
        part, acoustic, usbl = _draft.Part("vehicle", key), vehicle.endpoints.acoustic, vehicle.endpoints.usbl
        if acoustic is None or acoustic.acoustic_address is None:
            continue
        local = acoustic.acoustic_address
        for path in _self_references(local, acoustic, usbl):
            message = msg(f"`{arg(key)}` itself has the acoustic address {arg(local)}")
            yield draft.finding_at(
                part, ("endpoints", *path), message, "write the address of the modem at the other end"
            )
        other = first.setdefault((str(acoustic.driver), local), key)
        if other != key:
            where = draft.where(_draft.Part("vehicle", other), "endpoints", "acoustic", "acoustic_address")
            message = msg(f"{arg(local)} is already the acoustic address of `{arg(other)}` ({arg(where)})")
            path = ("endpoints", "acoustic", "acoustic_address")
            yield draft.finding_at(
                part,
                path,
                message,
                msg(f"give each {arg(acoustic.driver)} modem its own address, here and on the modem"),
            )


def _self_references(local: int, acoustic: model.AcousticEndpoint, usbl: model.UsblEndpoint | None) -> Iterator[_Path]:
    if acoustic.partner == local:
        yield "acoustic", "partner"
    if usbl is None or usbl.driver is not acoustic.driver:
        return
    for index, address in enumerate(usbl.hears):
        if address == local:
            yield "usbl", "hears", index
    if usbl.ping == local:
        yield "usbl", "ping"


def addresses(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require an address for a vehicle at every site that tests it, so that its endpoints can be reached."""
    gateways = {place for _, place, _ in draft.valid_devices(model.Gateway)}
    for name, site in draft.sites.items():
        reserved_names = {reservation.name for reservation in site.lan.reservations}
        site_vehicles = site.checklist.vehicles
        if site_vehicles is None and name not in gateways:
            continue  # nobody says that anything is tested there
        for key in draft.vehicles if site_vehicles is None else site_vehicles:
            vehicle = draft.vehicles.get(key)
            if vehicle is None or key in reserved_names or not (wanting := _endpoints_without_address(vehicle)):
                continue
            path: _Path = (
                ("checklist",) if site_vehicles is None else ("checklist", "vehicles", site_vehicles.index(key))
            )
            message = msg(
                f"`{arg(key)}` is tested here but has no address, although it is to be queried: "
                f"{arg(join(', ', wanting))}"
            )
            hint = msg(
                f"add `- {{name: {arg(key)}, mac: …, address: …}}` to `lan: reservations:`, or `address:` to each"
            )
            yield draft.finding_at(_draft.Part("site", name), path, message, hint)


def _endpoints_without_address(vehicle: model.Vehicle) -> list[str]:
    """Return the endpoints that are checked at an address and have none configured."""
    all_of_it = vehicle.endpoints
    modems = {"acoustic": all_of_it.acoustic, "usbl": all_of_it.usbl}
    wanting = {name: modem is not None and modem.device is None for name, modem in modems.items()}
    wanting |= {"wifi": all_of_it.wifi is not None, "ethernet": all_of_it.ethernet is not None}
    gps = all_of_it.gps
    wanting["gps"] = gps is not None and gps.driver in {model.GpsDriver.GPSD, model.GpsDriver.NMEA_TCP}
    endpoint_names = [name for name in model.Endpoints.model_fields if wanting.get(name)]
    return [name for name in endpoint_names if getattr(all_of_it, name).address is None]


def streams(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Report two autopilots that send their streams to the same port of one computer."""
    for name, site in draft.sites.items():
        has_gateway = any(place == name for _, place, _ in draft.valid_devices(model.Gateway))
        first: dict[tuple[model.SeenFrom, int], str] = {}
        for key, vehicle in draft.vehicles.items():
            stream, here = vehicle.endpoints.rc_rf, site.checklist.vehicles
            if stream is None or (here is not None and key not in here):
                continue
            place = stream.seen_from if has_gateway else model.SeenFrom.LAPTOP
            other = first.setdefault((place, stream.port), key)
            if other != key:
                message = msg(
                    f"UDP port {arg(stream.port)} of the {arg(place)} is already used by `{arg(other)}`, which is also "
                    f"tested at `{arg(name)}`"
                )
                hint = msg(
                    f"configure the companion computer of `{arg(key)}` to forward to another port, and set it here"
                )
                yield draft.finding_at(_draft.Part("vehicle", key), ("endpoints", "rc_rf", "port"), message, hint)


RULES: tuple[_draft.Rule, ...] = (check_tested_vehicles, in_the_table, seen_by, another_modem, addresses, streams)

_PAIR = 2


def require_two_probe_targets(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require at least two probe targets on a probed link: one silent target must not take it down.

    A satellite may have none at any rank: its port and its terminal are watched, which costs nothing.
    """
    for name, site in draft.sites.items():
        for index, link in enumerate(site.bearers):
            path = ("bearers", index, "canaries")
            if 0 < len(set(link.canaries)) < _PAIR:
                message = msg(
                    f"link `{arg(link.name)}` has one probe target: if that host fails, the link counts as down"
                )
                yield draft.finding_at(
                    _draft.Part("site", name), path, message, "name two different hosts beyond the link"
                )
            elif not link.canaries and index < len(site.bearers) - 1 and not link.kind.traits.allow_list:
                message = msg(f"link `{arg(link.name)}` has no probe targets, so its failure would not be noticed")
                hint = "name two; only a satellite link and the last link in order of preference can do without"
                yield draft.finding_at(_draft.Part("site", name), ("bearers", index), message, hint)


def require_own_probe_targets(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require probe targets of its own for each link: a target is routed over one link only."""
    for name, site in draft.sites.items():
        part = _draft.Part("site", name)
        first_uses: dict[IPv4Address, tuple[int, int]] = {}
        for index, link in enumerate(site.bearers):
            for place, probe_target in enumerate(link.canaries):
                first = first_uses.setdefault(probe_target, (index, place))
                lonely = first[0] == index and len(set(link.canaries)) < _PAIR
                if first != (index, place) and not lonely:
                    other = site.bearers[first[0]].name
                    line = draft.mark(part, "bearers", first[0], "canaries", first[1]).line
                    message = msg(
                        f"{arg(probe_target)} is already a probe target of link `{arg(other)}` (line {arg(line)})"
                    )
                    hint = "a probe target belongs to one link: choose another host"
                    yield draft.finding_at(part, ("bearers", index, "canaries", place), message, hint)


def require_unused_probe_addresses(draft: _draft.Draft) -> Iterator[findings.Finding]:
    """Require that nothing needed has a probe target's address: it is unreachable while the link is down."""
    networks = NetworkIndex(claims(draft))
    for name, site in draft.sites.items():
        for index, link in enumerate(site.bearers):
            for place, probe_target in enumerate(link.canaries):
                if use := _other_use(draft, networks, probe_target):
                    message = msg(f"the probe target {arg(probe_target)} of link `{arg(link.name)}` is {arg(use)}")
                    hint = "choose a host beyond the link that is used for nothing else"
                    yield draft.finding_at(
                        _draft.Part("site", name), ("bearers", index, "canaries", place), message, hint
                    )


def _other_use(draft: _draft.Draft, networks: NetworkIndex, address: IPv4Address) -> str | None:
    if draft.pilot is not None:
        if address == draft.pilot.vpn.endpoint:
            return "the VPN's endpoint"
        for server in draft.pilot.time_servers:
            if address == server.address:
                return msg(f"the time server {arg(server.name)}")
    claim = next(iter(networks.over(IPv4Network(address))), None)
    return msg(f"inside {arg(claim.what)}, {arg(claim.network)}") if claim is not None else None


PROBES_RULES: tuple[_draft.Rule, ...] = (
    require_two_probe_targets,
    require_own_probe_targets,
    require_unused_probe_addresses,
)
