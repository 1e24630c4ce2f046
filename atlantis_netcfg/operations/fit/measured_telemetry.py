"""A vehicle's `telemetry:` as measured at a site: topics, sizes, rates; and its update in the inventory."""

from __future__ import annotations

from dataclasses import dataclass, replace
from difflib import unified_diff
from typing import TYPE_CHECKING, Final

import yaml
from pydantic import ValidationError

from atlantis_netcfg.core import errors
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.operations import guests, robots
from atlantis_netcfg.operations.common import inventory_files
from atlantis_netcfg.robots.observation import RobotState

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from datetime import date

    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.inventory.model.robot import RobotFile
    from atlantis_netcfg.links import LinkFinding
    from atlantis_netcfg.robots.observation import RobotReport

_VEHICLES: Final = "group_vars/all/vehicles.yml"


class TelemetryUnknown(errors.NetcfgError):
    """Not all published topics of a vehicle were received."""

    exit = errors.ExitCode.CHECKS_FAILED


@dataclass(frozen=True, slots=True)
class MeasuredTelemetry:
    """The topics received from one vehicle."""

    site: str
    vehicle: str
    seconds: float
    topics: tuple[model.TelemetryTopic, ...]
    """Topics in the vehicle's configuration; nobody at the control centre reads the others that it publishes."""
    others: tuple[str, ...]
    """Published topics that are not in the vehicle's configuration."""
    findings: tuple[LinkFinding, ...]
    """Findings about the vehicle that `robot discover` would report."""

    @property
    def wrong(self) -> LinkFinding | None:
        """The first finding that shows a difference between the robot and its file; None if there is none."""
        return next((each for each in self.findings if each.verdict in {Verdict.FAIL, Verdict.INCONCLUSIVE}), None)

    def of(self, inventory: Inventory) -> Inventory:
        """Return the pilot with these topics instead of the inventory's."""
        vehicle = inventory.vehicles[self.vehicle].model_copy(update={"telemetry": self.topics})
        return replace(inventory, vehicles={**inventory.vehicles, self.vehicle: vehicle})

    def as_dict(self) -> Mapping[str, object]:
        """Return JSON-able data."""
        return {
            "seconds": round(self.seconds, 1),
            "telemetry": [each.model_dump(mode="json") for each in self.topics],
            "others": list(self.others),
            "findings": [each.as_dict() for each in self.findings],
        }


def measure(inventory: Inventory, site: str, vehicle: str, seconds: float, address: str | None) -> MeasuredTelemetry:
    """Measure a vehicle at a site; raise UsageError, NoMatchError, or TelemetryUnknown if a topic is missing."""
    robot = next((each.robot for each in robots.robots_of(inventory)[0] if each.vehicle == vehicle), None)
    if robot is None:
        raise robots.without_file(vehicle)
    observation, reports = robots.discover(inventory, site, seconds, address)
    report = next((each for each in reports if (each.vehicle, each.state) == (vehicle, RobotState.DECLARED)), None)
    if report is None:
        message = msg(f"no messages of `{arg(vehicle)}` received at {arg(site)} in {arg(observation.seconds):.0f} s")
        hint = msg(f"`provision robot discover site={arg(site)}` shows the received robots")
        raise TelemetryUnknown(message, hint=hint)
    return telemetry_of(site, report, robot, inventory.vehicles[vehicle], observation.seconds)


def telemetry_of(
    site: str, report: RobotReport, robot: RobotFile, vehicle: model.Vehicle, seconds: float
) -> MeasuredTelemetry:
    """Convert a report to telemetry; raise TelemetryUnknown if a topic's rate is not known."""
    least = {robot.full_name(item.topic): item.least_hz for item in vehicle.telemetry}
    topics, unknown = [], []
    for topic in robot.topics():
        writers = [each for each in report.topics if each.topic == topic.name]
        rates = [each.rate_hz for each in writers if each.rate_hz is not None]
        try:
            entry = model.TelemetryTopic(
                topic=topic.name,
                data=topic.kind.data,
                rate_hz=float(f"{sum(rates):.3g}"),
                size_bytes=round(sum(each.octets for each in writers) / sum(each.messages for each in writers)),
                reliable=any(each.reliable for each in writers),
                least_hz=least.get(topic.name),
            )
        except (ValidationError, ZeroDivisionError):
            unknown.append(topic.name)
        else:
            topics.append(entry)
            unknown += [topic.name] if len(rates) < len(writers) else []
    if unknown:
        message = msg(
            f"the rate of {arg(join(', ', unknown))} of `{arg(report.vehicle)}` is still unknown after "
            f"{arg(seconds):.0f} s"
        )
        raise TelemetryUnknown(message, hint="three messages of each are needed: listen longer, `observed=5m`")
    others = sorted({each.topic for each in report.topics} - {each.topic for each in topics})
    return MeasuredTelemetry(site, str(report.vehicle), seconds, tuple(topics), tuple(others), report.findings)


@dataclass(frozen=True, slots=True)
class TelemetryChange:
    """A planned change of an inventory file."""

    file: str
    before: str
    after: str | None
    """None: the entry is not written on lines of its own."""
    rows: Sequence[str]

    @property
    def difference(self) -> list[str]:
        """The removed and added lines; empty if nothing changes."""
        if self.after is None:
            return [f"+{row}" for row in self.rows]
        lines = unified_diff(self.before.splitlines(), self.after.splitlines(), n=0, lineterm="")
        return [line for line in list(lines)[2:] if not line.startswith("@@")]


def change(inventory: Inventory, telemetry: MeasuredTelemetry, day: date) -> TelemetryChange:
    """Return the change that puts these topics into the file and keeps everything else."""
    vehicle, rows = inventory.vehicles[telemetry.vehicle], [_row(each) for each in telemetry.topics]
    block, file = ("guests", guests.FILE) if isinstance(vehicle, model.Guest) else ("vehicles", _VEHICLES)
    before = (inventory.root / file).read_bytes().decode()
    if vehicle.telemetry == telemetry.topics:
        return TelemetryChange(file, before, before, rows)
    comment = msg(f"received at {arg(telemetry.site)} on {arg(day.isoformat())}, within {arg(telemetry.seconds):.0f} s")
    after = with_telemetry(before, (block, telemetry.vehicle), comment, rows)
    expected_vehicles = telemetry.of(inventory).vehicles
    if after is not None and inventory_files.validate_change(inventory.root, file, after).vehicles != expected_vehicles:
        after = None
    return TelemetryChange(file, before, after, rows)


def write(inventory: Inventory, telemetry: MeasuredTelemetry, edit: TelemetryChange) -> None:
    """Write the change; raise TelemetryUnknown if the robot differs from its file, or UsageError."""
    if (wrong := telemetry.wrong) is not None:
        message = msg(
            f"nothing was written, because `{arg(telemetry.vehicle)}` does not match its file: {arg(wrong.message)}"
        )
        raise TelemetryUnknown(
            message, hint=f"`provision robot discover site={arg(telemetry.site)}` shows all differences"
        )
    if (inventory.root / edit.file).read_bytes().decode() != edit.before:
        raise errors.UsageError(
            f"{arg(edit.file)} changed in the meantime: nothing was written", hint="run the same command again"
        )
    if edit.after is None:
        hint = "add the lines shown without `--write` by hand"
        raise errors.UsageError(
            f"`{arg(telemetry.vehicle)}` is not written in {arg(edit.file)} in a form that this command can edit",
            hint=hint,
        )
    if edit.difference:
        inventory_files.write(inventory.root, edit.file, edit.after)


def _row(topic: model.TelemetryTopic) -> str:
    values = topic.model_dump(mode="json", exclude_defaults=True)
    return f"- {yaml.safe_dump(values, default_flow_style=True, sort_keys=False, width=1000).strip()}"


def with_telemetry(text: str, path: tuple[str, str], comment: str, rows: Sequence[str]) -> str | None:
    """Return the file with one vehicle's topics; None if its entry is not in block style."""
    node: yaml.Node | None = yaml.compose(text, yaml.SafeLoader)
    for name in path:
        node = _keys(node).get(name, (None, None))[1]
    if not isinstance(node, yaml.MappingNode) or node.flow_style or not node.value:
        return None
    there, indent = _keys(node).get("telemetry"), " " * node.value[0][0].start_mark.column
    first = there[0].start_mark.line if there is not None else _line_behind(node)
    last = _line_behind(there[1]) if there is not None else first
    lines = text.splitlines(keepends=True)
    new_lines = [f"{indent}telemetry: # {comment}\n", *(f"{indent}  {row}\n" for row in rows)]
    if first == len(lines) and lines and not lines[-1].endswith("\n"):
        lines[-1] += "\n"
    return "".join([*lines[:first], *new_lines, *lines[last:]])


def _keys(node: yaml.Node | None) -> dict[str, tuple[yaml.Node, yaml.Node]]:
    return {key.value: (key, value) for key, value in node.value} if isinstance(node, yaml.MappingNode) else {}


def _line_behind(node: yaml.Node) -> int:
    """Return the line after a block's last value: comments below it belong to what follows."""
    while isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        node = node.value[-1][1] if isinstance(node, yaml.MappingNode) else node.value[-1]
    end = node.end_mark
    return int(end.line) if end.column == 0 else int(end.line) + 1
