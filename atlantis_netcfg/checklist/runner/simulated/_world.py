"""Specifications that simulate a site in a rehearsal: as in the inventory, until a fault changes them.

The simulated gateway without faults: the output of its programs, derived from the inventory.

The surroundings of the emulated RouterOS devices without faults, and the changes that faults make.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.checklist.probes import Cell
from atlantis_netcfg.checklist.probes.gps import GPSD_PORT, NMEA_PORT
from atlantis_netcfg.checklist.probes.link_probe import reserved_mac
from atlantis_netcfg.checklist.probes.site_checks.data_reaches import far_computers
from atlantis_netcfg.checklist.runner.simulated.measured_links import MeasuredLink
from atlantis_netcfg.checklist.runner.simulated.robots import SimulatedRobots
from atlantis_netcfg.computers.parts import computer_network
from atlantis_netcfg.emulator import linux
from atlantis_netcfg.emulator.acoustic import EvologicsSpec, SeatracSpec
from atlantis_netcfg.emulator.gnss import GnssSpec
from atlantis_netcfg.emulator.mavlink import AutopilotSpec
from atlantis_netcfg.inventory import model
from atlantis_netcfg.routeros.render import router_view
from atlantis_netcfg.vpn.client import IDENTITY

if TYPE_CHECKING:
    from atlantis_netcfg.inventory import Host, Inventory


_OUTDOORS_MHZ = 5500
"""Frequency at which CEPT permits outdoor antennas."""
_OF_THE_IMAGE = "/etc/netplan/10-atlantis.yaml"
ROUTER_MAC = "02:00:5E:00:FF:01"
"""MAC address of the router's LAN port as the emulated computer sees it; no real device has it."""


def gateway_computer(inventory: Inventory, host: Host, vehicles: tuple[str, ...]) -> linux.ComputerSpec:
    """Describe the gateway `host` with these vehicles around it."""
    device, lan = host.device, inventory.sites[host.site].lan
    assert isinstance(device, model.ServerComputer)  # noqa: S101 - the caller checks it
    reservation_by_name = {reservation.name: reservation for reservation in lan.reservations}
    server = inventory.hosts[inventory.pilot.vpn.server].device
    computer = linux.lan_computer(
        host.name,
        address=f"{device.address}/{lan.network.prefixlen}",
        mac=device.mac,
        router=(str(lan.gateway), ROUTER_MAC),
        others={
            str(reservation_by_name[key].address): reservation_by_name[key].mac
            for key in vehicles
            if key in reservation_by_name
        },
        tunnel=f"{device.vpn_address}/{inventory.pilot.vpn.network.prefixlen}"
        if device.vpn_address is not None
        else None,
        server=str(server.vpn_address) if isinstance(server, model.VpnServer) else None,
    )
    radios = (*_radios(inventory, vehicles), *_open_network(inventory, host, vehicles))
    return computer.model_copy(
        update={
            "interfaces": (*computer.interfaces, *radios),
            "files": {**computer.files, **_network(inventory, host)},
            "udp": tuple(_participants(inventory)),
            "dds": tuple(_answering(inventory, device)),
            "certificates": _identity(host),
            "reflectors": {
                item.address: linux.ReflectorSpec(host=item.name) for item in far_computers(inventory, device)
            },
            "echoes": {
                **computer.echoes,
                **dict.fromkeys(_access_point_addresses(inventory, vehicles), linux.EchoSpec(rtt_ms=2.4)),
            },
        }
    )


def _network(inventory: Inventory, host: Host) -> dict[str, str]:
    """Return the file with the computer's address for the next start: that of the role, or of its image."""
    network_file = computer_network(inventory, host)
    if network_file is not None:
        return {network_file.path: network_file.content}
    assert isinstance(host.device, model.ServerComputer)  # noqa: S101 - the caller checks it
    prefix = inventory.sites[host.site].lan.network.prefixlen
    address = f"{host.device.address}/{prefix}"
    return {_OF_THE_IMAGE: f"network: {{version: 2, ethernets: {{eth0: {{addresses: [{address}]}}}}}}\n"}


def _participants(inventory: Inventory) -> Iterator[linux.UdpSpec]:
    """Yield the ports of one ROS process with its profile: its domain and its number (DDSI-RTPS 9.6.2.3)."""
    if inventory.pilot.dds is not None:
        first = 7400 + 250 * inventory.pilot.dds.domain
        yield from (linux.UdpSpec(port=first + offset) for offset in (10, 11))


def _answering(inventory: Inventory, device: model.ServerComputer) -> Iterator[linux.DdsSpec]:
    """Yield the same process as DDS participant, which announces the address at which others look for it."""
    dds = inventory.pilot.dds
    if dds is not None:
        yield linux.DdsSpec(domain=dds.domain, addresses=(dds.address_of(device),))


def _identity(host: Host) -> dict[str, tuple[linux.CertificateSpec, ...]]:
    assert isinstance(host.device, model.ServerComputer)  # noqa: S101 - the caller checks it
    if host.device.vpn_address is None:
        return {}
    certificate = linux.CertificateSpec(subject=host.name, not_after=datetime.now(UTC) + timedelta(days=300))
    return {IDENTITY: (certificate, linux.CertificateSpec(subject=certificate.issuer))}


def _access_points(inventory: Inventory, vehicles: tuple[str, ...]) -> Iterator[model.WifiEndpoint]:
    for key in vehicles:
        wifi = inventory.vehicles[key].endpoints.wifi
        if wifi is not None and wifi.role is model.WifiRole.ACCESS_POINT:
            yield wifi


def _access_point_addresses(inventory: Inventory, vehicles: tuple[str, ...]) -> Iterator[str]:
    return (str(wifi.address) for wifi in _access_points(inventory, vehicles) if wifi.address is not None)


def _radios(inventory: Inventory, vehicles: tuple[str, ...]) -> Iterator[linux.InterfaceSpec]:
    """Yield one radio per access point, each in the network of its robot."""
    seen_interfaces: set[str] = set()
    for number, wifi in enumerate(_access_points(inventory, vehicles), start=1):
        if wifi.interface in seen_interfaces:
            continue
        seen_interfaces.add(wifi.interface)
        local = None if wifi.address is None else f"{wifi.address + 100}/24"
        yield linux.InterfaceSpec(
            name=wifi.interface,
            mac=f"02:00:5E:00:FE:{number:02X}",
            addresses=() if local is None else (linux.AddressSpec(address=local, lease_s=3000),),
            wireless=True,
            association=linux.AssociationSpec(
                ssid=wifi.ssid or "EXAMPLE",
                bssid=wifi.mac or f"02:00:5E:00:FD:{number:02X}",
                frequency_mhz=_OUTDOORS_MHZ,
            ),
        )


def _open_network(inventory: Inventory, host: Host, vehicles: tuple[str, ...]) -> Iterator[linux.InterfaceSpec]:
    """Yield the radio of the gateway's own network, with the stations that have no other access point."""
    radio = host.device.access_point if isinstance(host.device, model.Gateway) else None
    if radio is None:
        return
    cells = [Cell(inventory, host.site, key, model.Column.WIFI) for key in vehicles]
    wifi_cells = [(cell, cell.wifi) for cell in cells if cell.wifi is not None]
    macs = [
        reserved_mac(cell, wifi.mac)
        for cell, wifi in wifi_cells
        if wifi.role is model.WifiRole.STATION and wifi.seen_by is None
    ]
    network = linux.AssociationSpec(ssid=radio.ssid, bssid="02:00:5E:00:FC:01", frequency_mhz=radio.frequency_mhz)
    yield linux.InterfaceSpec(
        name=radio.interface,
        mac=network.bssid,
        addresses=(linux.AddressSpec(address=f"{radio.address}/{radio.network.prefixlen}"),),
        wireless=True,
        type="AP",
        association=network,
        stations=tuple(network.model_copy(update={"bssid": mac}) for mac in macs if mac is not None),
    )


Do = Callable[..., Any]
"""Sends a command to an emulator: its name, the command, arguments."""
Act = Callable[[Do], Callable[[], object]]
"""Applied to an emulator when all emulators run; what it returns undoes it."""


def change_modem(emulator: str, before: Mapping[str, Any], after: Mapping[str, Any]) -> Act:
    """Change card or network of a 4G unit; `before` is the state without faults."""

    def act(do: Do) -> Callable[[], object]:
        do(emulator, "modem", **after)
        return lambda: do(emulator, "modem", **before)

    return act


def silence_addresses(emulator: str, addresses: list[str]) -> Act:
    """Make these addresses ignore all requests of the router."""

    def act(do: Do) -> Callable[[], object]:
        do(emulator, "silence", addresses=addresses)
        return lambda: do(emulator, "silence", addresses=[])

    return act


def add_row(emulator: str, menu: str, **row: str) -> Act:
    """Add a row, as if somebody had changed the configuration by hand."""

    def act(do: Do) -> Callable[[], object]:
        number = _get_return_value(do(emulator, "console", words=[f"{menu}/add", *_console_words(row)]))
        return lambda: do(emulator, "console", words=[f"{menu}/remove", f"=numbers={number}"])

    return act


def change_rows(emulator: str, menu: str, where: Mapping[str, str], **values: str) -> Act:
    """Set values of all rows that match `where`."""

    def act(do: Do) -> Callable[[], object]:
        rows = [row for row in _rows(do(emulator, "console", words=[f"{menu}/print"])) if where.items() <= row.items()]
        if not rows:
            raise LookupError(f"{emulator} has no row of {menu} with {dict(where)}")
        numbers = ",".join(row[".id"] for row in rows)
        before = {name: rows[0].get(name, "") for name in values}
        _raise_on_trap(do(emulator, "console", words=[f"{menu}/set", f"=numbers={numbers}", *_console_words(values)]))
        return lambda: do(emulator, "console", words=[f"{menu}/set", f"=numbers={numbers}", *_console_words(before)])

    return act


def apart(near: str, *, before: Mapping[str, float], after: Mapping[str, float]) -> Act:
    """Change the radio conditions of a bridge, and wait until its ends reconnect."""

    def set_air(do: Do, air: Mapping[str, float]) -> None:
        do(near, "air", **air)
        _wait_for_registration(do, near)

    def act(do: Do) -> Callable[[], object]:
        set_air(do, after)
        return lambda: set_air(do, before)

    return act


def _wait_for_registration(do: Do, near: str) -> None:
    """Wait until an end of a bridge has registered the other. Raises LookupError after half a minute."""
    until = time.monotonic() + 30
    while not _rows(do(near, "console", words=["/interface/wireless/registration-table/print"])):
        if time.monotonic() > until:
            raise LookupError(f"{near} does not find the other end again")
        time.sleep(0.05)


def set_clock(emulator: str, moment: datetime) -> Act:
    """Set a router's clock, in its time zone; setting up the surroundings corrects it again."""

    def act(do: Do) -> Callable[[], object]:
        _raise_on_trap(do(emulator, "console", words=clock_words(moment)))
        return lambda: None

    return act


def clock_words(moment: datetime) -> list[str]:
    """Return the command that sets a router's clock."""
    return ["/system/clock/set", f"=date={moment:%Y-%m-%d}", f"=time={moment:%H:%M:%S}"]


def _console_words(values: Mapping[str, str]) -> list[str]:
    return [f"={name.replace('_', '-')}={value}" for name, value in values.items()]


def _rows(answers: list[list[str]]) -> list[dict[str, str]]:
    return [dict(word[1:].split("=", 1) for word in words) for kind, *words in answers if kind == "!re"]


def _raise_on_trap(answers: list[list[str]]) -> list[list[str]]:
    """Raise LookupError if the emulator rejected a command: the fault would have no effect."""
    for kind, *words in answers:
        if kind == "!trap":
            raise LookupError(" ".join(words))
    return answers


def _get_return_value(answers: list[list[str]]) -> str:
    reply = next(words for kind, *words in _raise_on_trap(answers) if kind == "!done")
    return next(word.removeprefix("=ret=") for word in reply if word.startswith("=ret="))


def surroundings(inventory: Inventory, host: Host) -> dict[str, Any]:
    """Describe a router's surroundings, such as LAN, tunnel and time server; for a switch, its stations."""
    if isinstance(host.device, model.Switch):
        return {"stations": list(_stations(inventory, host, host.device))}
    assert isinstance(host.device, model.Router)  # noqa: S101 - the caller checks it
    site, client, tunnel = inventory.sites[host.site], host.device.vpn_client, router_view(inventory, host).tunnel
    tunnels = {}
    if client is not None and tunnel is not None:
        tunnels[tunnel.interface] = f"{client.address}/{inventory.pilot.vpn.network.prefixlen}"
    return {
        "cards": _mac_by_address(inventory, host.site) | {str(site.lan.gateway): ROUTER_MAC},
        "loads": {port: {} for port in _fed(inventory, host.name)},
        "leases": {str(reservation.address): "bound" for reservation in site.lan.reservations},
        "tunnels": tunnels,
        "stations": list(_stations(inventory, host, host.device)),
        "time_server": str(inventory.pilot.time_servers[0].address),
        "called": [],
        "validity": {},
    }


def _mac_by_address(inventory: Inventory, site: str) -> dict[str, str]:
    cards = {str(reservation.address): reservation.mac for reservation in inventory.sites[site].lan.reservations}
    for host in inventory.site_hosts(site):
        if isinstance(host.device, model.ServerComputer) and host.device.mac is not None:
            cards[str(host.device.address)] = host.device.mac
    return cards


def _stations(inventory: Inventory, host: Host, device: model.Router | model.Switch) -> Iterator[dict[str, str]]:
    """Yield the vehicles that are stations of the device's access point, in range and with the right key."""
    radio, here = device.access_point, inventory.sites[host.site].checklist.vehicles
    for key in inventory.vehicles if here is None else here:
        cell = Cell(inventory, host.site, key, model.Column.WIFI)
        wifi = cell.wifi
        if radio is None or wifi is None or wifi.role is not model.WifiRole.STATION or wifi.seen_by != host.name:
            continue
        mac = reserved_mac(cell, wifi.mac)
        if mac is not None:
            yield {"mac": mac, "ssid": radio.ssid, "passphrase": radio.key.reveal()}


def _fed(inventory: Inventory, router: str) -> list[str]:
    """Return the ports that power a device."""
    sources = (getattr(host.device, "powered_by", None) for host in inventory.hosts.values())
    return [source.port for source in sources if source is not None and source.device == router]


@dataclass(frozen=True, slots=True)
class SimulatedReceiver:
    """An emulated GNSS receiver at the endpoint in the inventory."""

    spec: GnssSpec
    gpsd: bool
    address: str = ""
    port: int = 0
    device: str = ""


@dataclass(frozen=True, slots=True)
class SimulatedModem:
    """An emulated acoustic modem at the endpoint in the inventory, for a vehicle's `acoustic`, `usbl` or both."""

    spec: EvologicsSpec | SeatracSpec
    address: str = ""
    port: int = 0
    device: str = ""


@dataclass(frozen=True, slots=True)
class Autopilot:
    """An emulated autopilot; its stream comes from the address in the inventory to a UDP port of the gateway."""

    spec: AutopilotSpec
    port: int
    address: str


@dataclass(slots=True)
class World:
    """An emulated site; keys are vehicles and router names."""

    site: str
    computer: linux.ComputerSpec | None
    receivers: dict[str, SimulatedReceiver] = field(default_factory=dict)
    modems: dict[str, SimulatedModem] = field(default_factory=dict)
    autopilots: dict[str, Autopilot] = field(default_factory=dict)
    routers: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Router -> its surroundings."""
    links: dict[str, MeasuredLink] = field(default_factory=dict)
    """Link -> what `provision measure link` would have measured."""
    robots: SimulatedRobots = field(default_factory=SimulatedRobots)
    acts: list[Act] = field(default_factory=list)
    """Actions on the RouterOS emulators when all of them run, in this order; undone at the end."""

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

    def link(self, name: str, **changes: Any) -> None:  # noqa: ANN401 - fields of MeasuredLink
        """Change the measured values of a link."""
        self.links[name] = replace(self.links[name], **changes)

    def gateway(self, change: Callable[[linux.ComputerSpec], dict[str, Any]]) -> None:
        """Change the gateway computer; `change` returns the changed fields."""
        assert self.computer is not None  # noqa: S101 - faults of the gateway are offered where there is one
        self.computer = self.computer.model_copy(update=change(self.computer))


def healthy(inventory: Inventory, site: str) -> World:
    """Describe a site without faults, at which every check has the best possible result."""
    here = inventory.sites[site].checklist.vehicles
    vehicles = tuple(key for key in inventory.vehicles if here is None or key in here)
    gateway = Cell(inventory, site, None, "site").gateway
    world = World(site, None if gateway is None else gateway_computer(inventory, gateway, vehicles))
    for host in inventory.site_hosts(site):
        if isinstance(host.device, model.Router | model.Switch):
            world.routers[host.name] = surroundings(inventory, host)
    for link in inventory.sites[site].bearers if inventory.pilot.qualify is not None else ():
        world.links[link.name] = MeasuredLink(link.name, link.kind)
    world.robots = SimulatedRobots.honest(inventory, site)
    for key in vehicles:
        cell = Cell(inventory, site, key, "gps")
        world.receivers.update(_receiver(cell))
        world.modems.update(_modem(cell))
        world.autopilots.update(_autopilot(cell))
    return world


def _receiver(cell: Cell) -> Iterator[tuple[str, SimulatedReceiver]]:
    gps = cell.endpoints.gps
    if gps is None or gps.driver is model.GpsDriver.ROUTEROS:
        return
    fence = cell.site_config.checklist.geofence
    spec = GnssSpec() if fence is None else GnssSpec(latitude=fence.latitude, longitude=fence.longitude)
    gpsd = gps.driver is model.GpsDriver.GPSD
    port = gps.port or (GPSD_PORT if gpsd else NMEA_PORT)
    if gps.device is not None:
        yield cell.row, SimulatedReceiver(spec, gpsd, device=gps.device)
    elif (address := cell.address(gps.address)) is not None:
        yield cell.row, SimulatedReceiver(spec, gpsd, address, port)


def _modem(cell: Cell) -> Iterator[tuple[str, SimulatedModem]]:
    """Yield the emulated modem; one serves both columns if they share an endpoint."""
    ends = [end for end in (cell.endpoints.acoustic, cell.endpoints.usbl) if end is not None]
    if not ends:
        return
    end, spec = ends[0], _spec(cell)
    if end.device is not None:
        yield cell.row, SimulatedModem(spec.model_copy(update={"serial": True}), device=end.device)
    elif (address := cell.address(end.address)) is not None:
        yield cell.row, SimulatedModem(spec, address, end.port)


_FIX_EVERY_S = 0.5
"""As vehicles do: more often, and the fixes would fill the budget of a script on a busy laptop before it has ended."""


def _spec(cell: Cell) -> EvologicsSpec | SeatracSpec:
    acoustic: model.AcousticEndpoint | None = cell.endpoints.acoustic
    usbl: model.UsblEndpoint | None = cell.endpoints.usbl
    local = acoustic.acoustic_address if acoustic is not None else None
    hears = usbl.hears if usbl is not None else ()
    driver = acoustic.driver if acoustic is not None else usbl.driver if usbl is not None else None
    if driver is model.AcousticDriver.EVOLOGICS:
        reaches = (acoustic.partner,) if acoustic is not None and acoustic.partner is not None else ()
        return EvologicsSpec(
            local_address=local or 1, hears=hears or (2,), reaches=reaches, in_water=True, fix_every_s=_FIX_EVERY_S
        )
    ping_targets = (usbl.ping,) if usbl is not None and usbl.ping is not None else ()
    return SeatracSpec(
        beacon=local or 1, hears=hears or (2,), reaches=ping_targets, in_water=True, fix_every_s=_FIX_EVERY_S
    )


def _autopilot(cell: Cell) -> Iterator[tuple[str, Autopilot]]:
    remote = cell.endpoints.rc_rf
    if remote is not None:
        address = cell.address(remote.address) or ""
        yield cell.row, Autopilot(AutopilotSpec(system_id=remote.system_id), remote.port, address)
