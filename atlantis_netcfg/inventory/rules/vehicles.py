"""Rules for vehicles: unambiguous names, and rows that match the report's Table 3 or give a reason."""

from __future__ import annotations

import re
from functools import cache
from importlib import resources
from types import MappingProxyType
from typing import TYPE_CHECKING

import yaml
from pydantic import TypeAdapter

from atlantis_netcfg.core.errors import nearest
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import _draft, model
from atlantis_netcfg.inventory.findings import Finding, suggest

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping


class VehicleRow(model.Model):
    """A row of the report's Table 3 with its marked cells."""

    name: str
    kind: model.VehicleKind
    table3: frozenset[model.Column]


@cache
def table3() -> Mapping[str, VehicleRow]:
    """Return the report's Table 3 by vehicle name, in the report's order."""
    text = resources.files("atlantis_netcfg.inventory").joinpath("data", "table3.yml").read_text(encoding="utf-8")
    rows = TypeAdapter(list[VehicleRow]).validate_python(yaml.safe_load(text))
    return MappingProxyType({row.name: row for row in rows})


def names(draft: _draft.Draft) -> Iterator[Finding]:
    """Require unique names, aliases and keys; spaces, hyphens and case make no difference."""
    owner_by_name: dict[str, tuple[str, str]] = {}
    for key, vehicle in draft.vehicles.items():
        part = _draft.Part("vehicle", key)
        local: list[tuple[str, tuple[str | int, ...]]] = [(key, ()), (vehicle.name, ("name",))]
        local += [(alias, ("aliases", index)) for index, alias in enumerate(vehicle.aliases)]
        for word, path in local:
            owner, where = owner_by_name.setdefault(_fold_name(word), (key, draft.where(part, *path)))
            if owner != key:
                message = msg(f"`{arg(word)}` is already a name of `{arg(owner)}` ({arg(where)})")
                yield draft.finding_at(part, path, message, "a name belongs to one vehicle: remove it here or there")


def _fold_name(word: str) -> str:
    return re.sub(r"[\W_]+", "", word.casefold())


def aliases(draft: _draft.Draft) -> Iterator[Finding]:
    """Report an alias that is listed twice or equals the name."""
    for key, vehicle in draft.vehicles.items():
        earlier_names = [key, vehicle.name]
        for index, alias in enumerate(vehicle.aliases):
            if alias.casefold() in (word.casefold() for word in earlier_names):
                message = msg(f"`{arg(alias)}` is already a name of this vehicle")
                yield draft.finding_at(_draft.Part("vehicle", key), ("aliases", index), message, "remove it")
            earlier_names.append(alias)


def partners(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that a vehicle's partner exists."""
    whole = draft.nodes.get(_draft.Part("partners"))
    if whole is None or not isinstance(whole.value, dict):
        return  # that is told
    partner_names = draft.names("partner")
    for key, vehicle in draft.vehicles.items():
        if vehicle.partner is not None and vehicle.partner not in partner_names:
            hint = suggest(vehicle.partner, partner_names, none="add it to `partners`, or write null")
            yield draft.finding_at(
                _draft.Part("vehicle", key), ("partner",), msg(f"partner `{arg(vehicle.partner)}` does not exist"), hint
            )


def columns(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a column that is listed twice in the row of a vehicle or a location."""
    rows: list[tuple[_draft.Part, tuple[str, ...], tuple[model.Column, ...]]] = [
        (_draft.Part("vehicle", key), ("table3",), vehicle.table3) for key, vehicle in draft.vehicles.items()
    ]
    rows += [
        (_draft.Part("site", name), ("location", "table3"), site.location.table3) for name, site in draft.sites.items()
    ]
    for part, path, row in rows:
        for index, column in enumerate(row):
            if column in row[:index]:
                yield draft.finding_at(part, (*path, index), msg(f"`{arg(column)}` is twice in this row"), "remove one")


def report_rows(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that a row equals the report's or gives a reason; guests and docking stations are exempt."""
    table = table3()
    for key, vehicle in draft.vehicles.items():
        row = table.get(vehicle.name)
        if vehicle.guest or isinstance(vehicle, model.Guest):
            continue
        if row is None and vehicle.kind is model.VehicleKind.DOCKING_STATION:
            continue
        if row is None:
            yield from _check_extra_vehicle(draft, key, vehicle, table)
            continue
        differs = list(_differences(vehicle, row))
        if differs and vehicle.table3_deviation is None:
            message = msg(f"`{arg(key)}` differs from the report's Table 3: {arg(join('; ', differs))}")
            hint = "correct it, or give the reason: `table3_deviation: <reason>`"
            path = "kind" if vehicle.kind is not row.kind else "table3"
            yield draft.finding_at(_draft.Part("vehicle", key), (path,), message, hint)
        if not differs and vehicle.table3_deviation is not None:
            message = msg(f"`{arg(key)}` has a reason for a deviation from the report's Table 3, but does not deviate")
            yield draft.finding_at(
                _draft.Part("vehicle", key), ("table3_deviation",), message, "remove `table3_deviation:`"
            )


def guests(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that a guest is not in the report, has a partner, and is tested at existing sites."""
    table = table3()
    for key, vehicle in draft.vehicles.items():
        part = _draft.Part("vehicle", key)
        if isinstance(vehicle, model.Guest) and not vehicle.guest:
            hint = "remove the line, or add the vehicle to vehicles.yml"
            yield draft.finding_at(
                part, ("guest",), msg(f"`{arg(key)}` is in guests.yml, but is not marked as a guest"), hint
            )
        if not vehicle.guest:
            continue
        if vehicle.name in table:
            message = msg(f"`{arg(vehicle.name)}` is a robot of the report's Table 3, not a guest")
            yield draft.finding_at(part, ("name",), message, "remove `guest: true`, or give the guest another name")
        if vehicle.table3_deviation is not None:
            message = msg(f"`{arg(key)}` is a guest: no row of the report applies to it")
            yield draft.finding_at(part, ("table3_deviation",), message, "remove `table3_deviation:`")
        if vehicle.partner is None:
            message = msg(f"the partner of guest `{arg(key)}` is missing")
            yield draft.finding_at(part, ("partner",), message, "add `partner:` with a key of `partners`")
        for index, site in enumerate(vehicle.tested_at if isinstance(vehicle, model.Guest) else ()):
            if site not in draft.layout.sites:
                hint = suggest(site, draft.layout.sites, none="add it to hosts.yml")
                yield draft.finding_at(part, ("tested_at", index), msg(f"site `{arg(site)}` does not exist"), hint)


def _differences(vehicle: model.Vehicle, row: VehicleRow) -> Iterator[str]:
    if vehicle.kind is not row.kind:
        yield msg(f"kind is {arg(row.kind)}")
    if more := _join_columns(set(vehicle.table3) - row.table3):
        yield msg(f"{arg(more)} not in the report")
    if fewer := _join_columns(row.table3 - set(vehicle.table3)):
        yield msg(f"{arg(fewer)} missing")


def _join_columns(some: Iterable[model.Column]) -> str:
    column_set = set(some)
    return join(", ", (column for column in model.Column if column in column_set))


def _check_extra_vehicle(
    draft: _draft.Draft, key: str, vehicle: model.Vehicle, table: Mapping[str, VehicleRow]
) -> Iterator[Finding]:
    if vehicle.table3_deviation is None:
        near = nearest(vehicle.name, table)
        hint = msg(
            f"did you mean `{arg(near)}`?"
            if near
            else "give the reason why it is here: `table3_deviation: <reason>`, or `guest: true`"
        )
        yield draft.finding_at(
            _draft.Part("vehicle", key),
            ("name",),
            msg(f"the report's Table 3 has no vehicle `{arg(vehicle.name)}`"),
            hint,
        )


def report_complete(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that every vehicle of the report is in the inventory; a misspelt one is reported at its name."""
    whole = _draft.Part("vehicles")
    if whole not in draft.nodes:
        return
    vehicle_names = [str(draft.nodes[_draft.Part("vehicle", key)].at("name").value) for key in draft.names("vehicle")]
    for name in table3():
        if name not in vehicle_names and nearest(name, vehicle_names) is None:
            message = msg(f"`{arg(name)}` of the report's Table 3 is not in the inventory")
            yield draft.finding_at(whole, (), message, "every robot of the report stays in the checklist: add it")


def topics_once(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a topic that is listed twice for one vehicle: it would be counted twice."""
    for key, vehicle in draft.vehicles.items():
        seen_topics: set[str] = set()
        for index, item in enumerate(vehicle.telemetry):
            if item.topic in seen_topics:
                message = msg(f"the topic `{arg(item.topic)}` of `{arg(key)}` is here twice")
                yield draft.finding_at(
                    _draft.Part("vehicle", key), ("telemetry", index, "topic"), message, "remove one"
                )
            seen_topics.add(item.topic)


def topics_go_by_dds(draft: _draft.Draft) -> Iterator[Finding]:
    """Require `dds:` for telemetry: traffic is counted for the pilot's DDS implementation and profiles."""
    if draft.pilot is None or draft.pilot.dds is not None:
        return
    for key, vehicle in draft.vehicles.items():
        if vehicle.telemetry:
            message = msg(f"`{arg(key)}` publishes telemetry, but the pilot has no DDS settings to carry it")
            hint = "add `dds: {distribution: foxy}` below `pilot:`, or remove `telemetry:`"
            yield draft.finding_at(_draft.Part("vehicle", key), ("telemetry",), message, hint)


def useful_rates(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a topic whose `least_hz` is above the rate at which it is published."""
    for key, vehicle in draft.vehicles.items():
        for index, item in enumerate(vehicle.telemetry):
            if item.least_hz is not None and item.least_hz > item.rate_hz:
                message = msg(
                    f"`{arg(item.topic)}` of `{arg(key)}` is published at {arg(item.rate_hz):g} Hz, below its "
                    "`least_hz`"
                )
                path = ("telemetry", index, "least_hz")
                yield draft.finding_at(
                    _draft.Part("vehicle", key), path, message, "write a lower `least_hz`, or remove it"
                )


RULES: tuple[_draft.Rule, ...] = (
    names,
    aliases,
    partners,
    columns,
    report_rows,
    guests,
    report_complete,
    topics_once,
    topics_go_by_dds,
    useful_rates,
)

_GUIDELINES = {
    model.TelemetryData.NUMBERS: (1.0, 4.0, "numbers and poses: 1 to 4 Hz"),
    model.TelemetryData.IMAGES: (4.0, 5.0, "images: 4 to 5 Hz, of low resolution"),
    model.TelemetryData.POINT_CLOUDS: (0.0, 1.0, "point clouds: below 1 Hz"),
}
"""Minimum and maximum rate in Hz, and the guideline in the report's section 3.3.3."""


def beside_guideline(data: model.TelemetryData, rate_hz: float) -> tuple[str, str] | None:
    """Return `above` or `below` and the report's guideline if the rate is outside it; None if it is within."""
    lowest, highest, guideline = _GUIDELINES[data]
    if rate_hz > highest or (data is model.TelemetryData.POINT_CLOUDS and rate_hz == highest):
        return "above", guideline
    return ("below", guideline) if rate_hz < lowest else None


def rates_within_the_guidelines(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a topic that is published more often than the report's guideline allows."""
    for key, vehicle in draft.vehicles.items():
        for index, item in enumerate(vehicle.telemetry):
            way, guideline = beside_guideline(item.data, item.rate_hz) or ("", "")
            if way == "above":
                message = msg(
                    f"`{arg(item.topic)}` of `{arg(key)}` is published at {arg(item.rate_hz):g} Hz, above the report's "
                    "guideline"
                )
                path = ("telemetry", index, "rate_hz")
                yield draft.finding_at(
                    _draft.Part("vehicle", key), path, message, msg(f"{arg(guideline)} (report, 3.3.3)")
                )


WARNINGS: tuple[_draft.Rule, ...] = (rates_within_the_guidelines,)
