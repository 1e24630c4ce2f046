"""Files of the robots tested at a site, read once per list, and the comparison with received data."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Self

from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.inventory.robots import reading
from atlantis_netcfg.inventory.robots.key_names import KeyNames
from atlantis_netcfg.robots.observation import judge

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.inventory.model.robot import RobotFile
    from atlantis_netcfg.robots.observation import RobotObservation, RobotReport


@dataclass(slots=True, eq=False, repr=False)
class RobotFiles:
    """Robots by vehicle; a file with errors blocks no list, because `provision inventory validate` rejects it.

    It holds the robots' tokens, so it has no text form.
    """

    names: KeyNames
    sources: Mapping[str, reading.RobotSource]
    """Robot -> source, for every robot of the inventory whose file has no error."""
    tested_vehicles: tuple[str, ...]
    """Vehicles that are tested at the site and have a file, with or without errors; guests are not among them."""
    past_guests: Mapping[str, str] = field(default_factory=dict)
    """Guests whose last day is over -> that day; they are strangers again."""
    _cached_reports: tuple[RobotObservation, list[RobotReport]] | None = None

    @classmethod
    def read(cls, inventory: Inventory, site: str) -> Self | None:
        """Read those of an inventory; None: no vehicle that is tested at the site has one."""
        here, files = inventory.sites[site].checklist.vehicles, reading.robot_files(inventory)
        tested_vehicles = tuple(
            key
            for key, vehicle in inventory.vehicles.items()
            if key in files and not vehicle.guest and (here is None or key in here)
        )
        if not tested_vehicles:
            return None
        try:
            names, findings = reading.key_names(inventory)
            sources = [] if findings else reading.read_declared(inventory, names)
        except NetcfgError:
            return cls(KeyNames(), {}, tested_vehicles)
        good = {each.vehicle: each for each in sources if each.robot is not None and not each.findings}
        open_sources = {key: source.with_token(inventory.decrypt) for key, source in good.items() if key is not None}
        return cls(names, open_sources, tested_vehicles, reading.past_guests(inventory))

    def robot(self, vehicle: str) -> RobotFile:
        """Return the content of a valid robot file."""
        robot = self.sources[vehicle].robot
        assert robot is not None  # noqa: S101 - it is good
        return robot

    def reports(self, observation: RobotObservation) -> list[RobotReport]:
        """Compare an observation with all files; cached, because the items of a list share one observation."""
        if self._cached_reports is None or self._cached_reports[0] is not observation:
            expected_keys = [key for key in self.tested_vehicles if key in self.sources]
            self._cached_reports = (
                observation,
                judge(observation, [*self.sources.values()], expected_keys, self.names, self.past_guests),
            )
        return self._cached_reports[1]

    def report(self, vehicle: str, observation: RobotObservation) -> RobotReport:
        """Return the report of one robot with a valid file."""
        return next(report for report in self.reports(observation) if report.vehicle == vehicle)
