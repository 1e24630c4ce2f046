"""What stands for a site in a rehearsal, as specifications: healthy as declared, until a fault changes them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import Cell
from atlantis_netcfg.checklist.probes.gps import GPSD_PORT, NMEA_PORT
from atlantis_netcfg.checklist.runner.simulated._computer import gateway_computer
from atlantis_netcfg.checklist.runner.simulated._routers import surroundings
from atlantis_netcfg.declaration.model import AcousticDriver, GpsDriver, Router
from atlantis_netcfg.emulator.acoustic import EvologicsSpec, SeatracSpec
from atlantis_netcfg.emulator.gnss import GnssSpec
from atlantis_netcfg.emulator.mavlink import AutopilotSpec

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from typing import Any

    from atlantis_netcfg.checklist.runner.simulated._routers import Act
    from atlantis_netcfg.declaration import Declaration
    from atlantis_netcfg.declaration.model import AcousticEndpoint, UsblEndpoint
    from atlantis_netcfg.emulator.linux import ComputerSpec


@dataclass(frozen=True, slots=True)
class Receiver:
    """A GNSS receiver at the end that is declared for it."""

    spec: GnssSpec
    gpsd: bool
    address: str = ""
    port: int = 0
    device: str = ""


@dataclass(frozen=True, slots=True)
class Modem:
    """An acoustic modem at the end that is declared for it; `acoustic` and `usbl` of a vehicle may be one."""

    spec: EvologicsSpec | SeatracSpec
    address: str = ""
    port: int = 0
    device: str = ""


@dataclass(frozen=True, slots=True)
class Autopilot:
    """An autopilot whose stream arrives at a UDP port of the gateway, from the address that is declared."""

    spec: AutopilotSpec
    port: int
    address: str


@dataclass(slots=True)
class World:
    """A site of twins; the keys are vehicles, and the routers' names."""

    site: str
    computer: ComputerSpec | None
    receivers: dict[str, Receiver] = field(default_factory=dict)
    modems: dict[str, Modem] = field(default_factory=dict)
    autopilots: dict[str, Autopilot] = field(default_factory=dict)
    routers: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Router to what stands around it."""
    acts: list[Act] = field(default_factory=list)
    """What is done to the RouterOS twins when all stands, in this order; taken back at the end."""

    def receiver(self, vehicle: str, **changes: Any) -> None:  # noqa: ANN401 - fields of GnssSpec
        """Change a vehicle's receiver."""
        item = self.receivers[vehicle]
        self.receivers[vehicle] = replace(item, spec=item.spec.model_copy(update=changes))

    def modem(self, vehicle: str, **changes: Any) -> None:  # noqa: ANN401 - fields of its spec
        """Change a vehicle's acoustic modem."""
        item = self.modems[vehicle]
        self.modems[vehicle] = replace(item, spec=item.spec.model_copy(update=changes))

    def autopilot(self, vehicle: str, **changes: Any) -> None:  # noqa: ANN401 - fields of AutopilotSpec
        """Change a vehicle's autopilot."""
        item = self.autopilots[vehicle]
        self.autopilots[vehicle] = replace(item, spec=item.spec.model_copy(update=changes))

    def gateway(self, change: Callable[[ComputerSpec], dict[str, Any]]) -> None:
        """Change the gateway computer: `change` gives the fields that are otherwise."""
        assert self.computer is not None  # noqa: S101 - faults of the gateway are offered where there is one
        self.computer = self.computer.model_copy(update=change(self.computer))


def healthy(declaration: Declaration, site: str) -> World:
    """Describe a site at which every check is as good as it can be."""
    here = declaration.sites[site].checklist.vehicles
    vehicles = tuple(key for key in declaration.vehicles if here is None or key in here)
    gateway = Cell(declaration, site, None, "site").gateway
    world = World(site, None if gateway is None else gateway_computer(declaration, gateway, vehicles))
    for host in declaration.site_hosts(site):
        if isinstance(host.device, Router):
            world.routers[host.name] = surroundings(declaration, host)
    for key in vehicles:
        cell = Cell(declaration, site, key, "gps")
        world.receivers.update(_receiver(cell))
        world.modems.update(_modem(cell))
        world.autopilots.update(_autopilot(cell))
    return world


def _receiver(cell: Cell) -> Iterator[tuple[str, Receiver]]:
    gps = cell.endpoints.gps
    if gps is None or gps.driver is GpsDriver.ROUTEROS:
        return
    fence = cell.declared.checklist.geofence
    spec = GnssSpec() if fence is None else GnssSpec(latitude=fence.latitude, longitude=fence.longitude)
    gpsd = gps.driver is GpsDriver.GPSD
    port = gps.port or (GPSD_PORT if gpsd else NMEA_PORT)
    if gps.device is not None:
        yield cell.row, Receiver(spec, gpsd, device=gps.device)
    elif (address := cell.address(gps.address)) is not None:
        yield cell.row, Receiver(spec, gpsd, address, port)


def _modem(cell: Cell) -> Iterator[tuple[str, Modem]]:
    """One twin serves both columns, where they are declared to be at one end."""
    ends = [end for end in (cell.endpoints.acoustic, cell.endpoints.usbl) if end is not None]
    if not ends:
        return
    end, spec = ends[0], _spec(cell)
    if end.device is not None:
        yield cell.row, Modem(spec.model_copy(update={"serial": True}), device=end.device)
    elif (address := cell.address(end.address)) is not None:
        yield cell.row, Modem(spec, address, end.port)


def _spec(cell: Cell) -> EvologicsSpec | SeatracSpec:
    acoustic: AcousticEndpoint | None = cell.endpoints.acoustic
    usbl: UsblEndpoint | None = cell.endpoints.usbl
    local = acoustic.acoustic_address if acoustic is not None else None
    hears = usbl.hears if usbl is not None else ()
    driver = acoustic.driver if acoustic is not None else usbl.driver if usbl is not None else None
    if driver is AcousticDriver.EVOLOGICS:
        reaches = (acoustic.partner,) if acoustic is not None and acoustic.partner is not None else ()
        return EvologicsSpec(local_address=local or 1, hears=hears or (2,), reaches=reaches, in_water=True)
    pinged = (usbl.ping,) if usbl is not None and usbl.ping is not None else ()
    return SeatracSpec(beacon=local or 1, hears=hears or (2,), reaches=pinged, in_water=True)


def _autopilot(cell: Cell) -> Iterator[tuple[str, Autopilot]]:
    remote = cell.endpoints.rc_rf
    if remote is not None:
        address = cell.address(remote.address) or ""
        yield cell.row, Autopilot(AutopilotSpec(system_id=remote.system_id), remote.port, address)
