"""The emulated devices of a site, started for one command: adopted, empty, behind the link's delay.

"Adopted" is the state after `provision device adopt`: the toolkit's user, a certificate on api-ssl, and the management
address on the management port, nothing else. A rehearsal therefore shows the first configuration of the site.
"""

from __future__ import annotations

import os
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any
from zlib import crc32

from atlantis_netcfg.core import events, temporary
from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.emulator import routeros
from atlantis_netcfg.inventory.model import Cpe, Router
from atlantis_netcfg.operations.common import kinds
from atlantis_netcfg.operations.common.costs import ports_of
from atlantis_netcfg.operations.common.link_shapes import shapes_to
from atlantis_netcfg.operations.common.request import Request, Target
from atlantis_netcfg.operations.common.schedule import members_of, with_other_ends
from atlantis_netcfg.operations.common.session_link import site_link_of
from atlantis_netcfg.operations.computers._emulation import RehearsedComputers, rehearsed_computers
from atlantis_netcfg.operations.lte.units import EmulatedUnit, emulated_units, not_rehearsed
from atlantis_netcfg.routeros.assumptions import summarize_assumptions
from atlantis_netcfg.routeros.first_contact.steps import FACTORY_ADDRESS, FACTORY_USER

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from atlantis_netcfg.emulator.coverage import PlaceTruth
    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.operations.adopt import Adoption
    from atlantis_netcfg.operations.common.link_shapes import Replay

_LISTENS_S = 1.0
"""Emulated radar wait of an access point, instead of one or ten minutes, to keep rehearsals short."""
_NOMINAL_M = 150.0
"""Distance if none is declared: from the coastal testbed to the control centre."""
_RADIO_NOT_REHEARSED = (
    "radio: the 1 or 10 minutes of an access point's radar check take one second",
    "radio: alignment, interference, rain, tide and actual antenna gain; the level is for free space",
    "radio: the far end of a new bridge is reached over its own cable until its radio is on",
)
_STATIONS_NOT_REHEARSED = (
    "radio: stations of an access point: emulated ones are nearby, and connect at once with its name and key",
    "radio: a router with an access point is emulated as a board that does not exist: RB5009UPr+S+ with a radio",
)


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """The running emulated devices of a rehearsal."""

    targets: Mapping[str, Target]
    not_rehearsed: tuple[str, ...]
    emulators: routeros.SpawnedSite
    units: Mapping[str, EmulatedUnit] = field(default_factory=dict)
    """Emulated 4G units that are not RouterOS devices."""
    computers: RehearsedComputers = field(default_factory=RehearsedComputers)
    replay: Replay | None = None
    """Measured run that replaces a link of the inventory."""

    @property
    def request_fields(self) -> dict[str, Any]:
        """The fields of a request that describe the emulated devices."""
        computers = self.computers
        return {
            "targets": self.targets,
            "standins": computers.stubs,
            "images": computers.images,
            "authority": computers.authority,
        }

    @property
    def left_out(self) -> Mapping[str, str]:
        """Hosts that are not emulated on this computer, with the reason, and what root would add."""
        if os.geteuid() == 0:
            return self.computers.left_out
        return {name: msg(f"{arg(why)}; root adds real packets") for name, why in self.computers.left_out.items()}

    def export(self, name: str) -> str:
        """Return the emulated device's current `/export`; for a 4G unit its settings, for a computer its files."""
        if name in self.computers.machines:
            return self.computers.export(name)
        if name in self.units:
            return self.units[name].export()
        return str(self.emulators.do(name, "export"))

    def tune(self, name: str, truth: PlaceTruth) -> bool:
        """Set an emulated 4G unit's reception to that of a place; return False if it does not support this."""
        if name in self.units:
            hear = self.units[name].tune
            if hear is not None:
                hear(truth)
            return hear is not None
        levels = {"rsrp_dbm": truth.rsrp_dbm, "rsrq_db": truth.rsrq_db, "sinr_db": truth.sinr_db}
        self.emulators.do(name, "modem", cell={"cell_id": truth.cell_id, **levels} if truth.has_service else None)
        return True

    def relink(self, inventory: Inventory, host: Host, via: str) -> None:
        """Put the emulated device of a host behind another link."""
        if host.name in self.computers.machines:
            shapes = shapes_to(inventory, host.site, via, self.replay)
            self.computers.machines[host.name].link(shapes=shapes)
            return
        self.emulators.do(host.name, "link", **link(inventory, host, via, self.replay).model_dump())


@contextmanager
def rehearsal(
    inventory: Inventory,
    hosts: Sequence[Host],
    via: str | None = None,
    notify: events.Subscriber = events.ignore,
    replay: Replay | None = None,
) -> Iterator[Rehearsal]:
    """Start an emulated device for every supported host until the context ends; `via`: the link used for all."""
    if replay is not None:
        replay.refuse_elsewhere(inventory, dict.fromkeys(host.site for host in hosts))
    requested_names = {host.name for host in hosts}
    emulated_hosts = with_other_ends(inventory, [host for host in hosts if kinds.is_supported(host)])
    others = [host for host in hosts if kinds.is_other_lte_unit(host)]
    spec = site_spec(inventory, emulated_hosts, via, {end.name for end in emulated_hosts} - requested_names, replay)
    if emulated_hosts or others:
        number = len(emulated_hosts) + len(others)
        words = msg("starting 1 emulated device" if number == 1 else f"starting {arg(number)} emulated devices")
        notify(events.Event(",".join(sorted({host.site for host in hosts})), events.Stage.CONNECTING, words))
    with (
        temporary.folder("twins") as folder,
        emulated_units(others, folder) as units,
        rehearsed_computers(inventory, hosts, folder / "computers", notify) as computers,
        routeros.spawn(spec, folder) as emulators,
    ):
        targets = {
            name: Target(
                host=ready["host"],
                port=ready["api_ssl"],
                pin=ready["pin"],
                ssh=ready.get("ssh"),
                host_key=ready.get("host_key"),
            )
            for name, ready in emulators.ready.items()
        }
        with_radio = [host for host in emulated_hosts if kinds.get_managed_device(inventory, host).hardware.radios]
        radio: tuple[str, ...] = _RADIO_NOT_REHEARSED if with_radio else ()
        if any(isinstance(host.device, Router) for host in with_radio):
            radio = (*radio, *_STATIONS_NOT_REHEARSED)
        targets |= {**{name: unit.target for name, unit in units.items()}, **computers.targets}
        routers = (*routeros.NOT_REHEARSED, summarize_assumptions()) if emulated_hosts else ()
        replay_limits = () if replay is None else (replay.not_rehearsed,)
        untold = (*replay_limits, *routers, *radio, *not_rehearsed(others), *computers.not_rehearsed)
        yield Rehearsal(targets, untold, emulators, units, computers, replay)


def site_spec(
    inventory: Inventory,
    hosts: Sequence[Host],
    via: str | None = None,
    along: Collection[str] = (),
    replay: Replay | None = None,
) -> routeros.SiteSpec:
    """Return the specification of these hosts' emulators, each of a kind that the engine handles.

    `along`: hosts added as the other end of a bridge, at a site that may not have the link `via`.
    """
    name = ",".join(sorted({host.site for host in hosts}))
    emulators = tuple(_emulator(inventory, host, None if host.name in along else via, replay) for host in hosts)
    return routeros.SiteSpec(name=name, emulators=emulators, pairs=tuple(_air(inventory, hosts, via, along)))


def _air(
    inventory: Inventory, hosts: Sequence[Host], via: str | None, along: Collection[str]
) -> Iterator[routeros.RadioPair]:
    """Yield the radio links between these hosts; the near end is on the technician's side."""
    names = [host.name for host in hosts]
    requested_names = [name for name in names if name not in along]
    request = Request(via=dict.fromkeys(requested_names, via) if via is not None else {})
    for member in members_of(inventory, requested_names, request):
        if member.bridge is None or not all(end.name in names for end in member.hosts):
            continue
        near, far = member.bridge.ends
        radios = [kinds.get_managed_device(inventory, end).hardware.radios[0] for end in (near, far)]
        distance = next((end.device.ptp.distance_m for end in (near, far) if isinstance(end.device, Cpe)), None)
        air = routeros.Air(distance_m=distance or _NOMINAL_M, dfs_wait_s=_LISTENS_S, weather_wait_s=_LISTENS_S)
        yield routeros.RadioPair(near=near.name, far=far.name, near_radio=radios[0], far_radio=radios[1], air=air)


@contextmanager
def rehearse_adoption(adoption: Adoption) -> Iterator[routeros.SpawnedSite]:
    """Run an adoption against an emulated device in factory state, which ends with the context."""
    name = adoption.host.name
    spec = factory_spec(adoption.inventory, adoption.host, serial=adoption.via != "ssh")
    with (
        temporary.folder("twins") as folder,
        routeros.spawn(routeros.SiteSpec(name=adoption.host.site, emulators=(spec,)), folder) as emulators,
    ):
        if spec.router.serial:
            adoption.via = f"serial:{emulators.ready[name]['serial']}"

        def locate(address: str, port: int) -> tuple[str, int]:
            """Return the emulated port for the target's address, or for any other, which counts as the factory's."""
            ready = dict(emulators.do(name, "info"))
            doors = ready if address == adoption.target.host else ready["first_contact"]
            return ready["host"], int(doors["ports"].get(str(port), 0))

        adoption.locate = locate
        yield emulators


def factory_spec(inventory: Inventory, host: Host, *, serial: bool = False) -> routeros.EmulatorSpec:
    """Return the specification of a router's emulator in factory state, with the laptop on a factory LAN port."""
    spec = _emulator(inventory, host, None)
    management = spec.router.management
    port = next((port for port in spec.router.ports[1:] if port != management.port), None)
    if spec.router.radios and len(spec.router.ports) == 1:
        port = management.port  # as "CPE Router" its one port is no port of a bridge
    if port is None:
        raise UsageError(
            f"{arg(host.name)} has only one port, and the laptop would cut its own connection: its adoption cannot be "
            "rehearsed",
            hint="adopt it over its serial port, or set user, certificate and address by hand (docs/routers.md)",
        )
    laptop = routeros.ManagementSpec(address=f"{FACTORY_ADDRESS}/24", port=port, technician="192.168.88.10")
    changes = {
        "factory": True,
        "users": (routeros.User(name=FACTORY_USER),),
        "first_contact": laptop,
        "certificates": (),
    }
    router = spec.router.model_copy(update={**changes, "serial": serial})
    return spec.model_copy(update={"router": router, "link": routeros.RouterLink()})


def _emulator(inventory: Inventory, host: Host, via: str | None, replay: Replay | None = None) -> routeros.EmulatorSpec:
    managed_device = kinds.get_managed_device(inventory, host)
    hardware, place, access = managed_device.hardware, managed_device.place, managed_device.access
    return routeros.EmulatorSpec(
        router=routeros.RouterSpec(
            name=host.name,
            board=hardware.board,
            serial_number=f"TWIN{crc32(host.name.encode()):08X}",
            ports=hardware.ports,
            poe_ports=hardware.poe_ports,
            radios=tuple(routeros.Radio(name=name) for name in hardware.radios),
            modem=hardware.modem,
            packages=hardware.packages,
            users=(routeros.User(name=access.user, password=access.password.reveal()),),
            management=routeros.ManagementSpec(address=place.address, port=place.port, technician=place.technician),
            certificates=managed_device.certificates,
            neighbours=_reachable_addresses(inventory, host),
        ),
        link=link(inventory, host, site_link_of(inventory, host, via).name, replay),
    )


def _reachable_addresses(inventory: Inventory, host: Host) -> tuple[str, ...]:
    """Return the addresses that answer a router's pings: each link's next hop and probe targets, all healthy."""
    if not isinstance(host.device, Router):
        return ()
    links = inventory.sites[host.site].bearers
    return tuple(str(address) for link in links for address in (link.gateway, *link.canaries))


def link(inventory: Inventory, host: Host, via: str, replay: Replay | None = None) -> routeros.RouterLink:
    """Return the emulated device's link, shaped by inventory or replay and counted on the router port that it uses."""
    port = next((port for port, name in ports_of(host).items() if name == via), None)
    up, down = shapes_to(inventory, host.site, via, replay)
    return routeros.RouterLink(up=up, down=down, port=port)
