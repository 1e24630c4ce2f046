"""A rehearsal whose sites are joined: computers are plugged in behind their routers, and the tunnels of all are up."""

from __future__ import annotations

import json
import shlex
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core import temporary
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.emulator.lab import hosts as lab_hosts
from atlantis_netcfg.emulator.routeros.dataplane import tunnel
from atlantis_netcfg.inventory import model
from atlantis_netcfg.operations.common.session_link import LAN
from atlantis_netcfg.operations.pilot_network.network import PilotNetwork, open_network
from atlantis_netcfg.operations.vpn.router import enrol_routers
from atlantis_netcfg.vpn.client import SERVICE

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from atlantis_netcfg.emulator import lab
    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.operations.common.rehearsal import Rehearsal
    from atlantis_netcfg.operations.common.request import Request

_TUNNEL: Final = "tun0"
_UP_S: Final = 60.0
"""A tunnel is up within so many seconds: over a satellite its handshake takes about 10."""
_POLL_S: Final = 0.2


@dataclass
class PilotRehearsal:
    """What runs while the sites are joined."""

    inventory: Inventory
    rehearsal: Rehearsal
    network: PilotNetwork
    routers: tuple[Host, ...]
    request: Request
    """For the emulated devices."""
    silent: dict[str, str] = field(default_factory=dict)
    """Computers and routers whose tunnel is not up, and why."""
    tunnels: dict[str, tunnel.RouterTunnels] = field(default_factory=dict)
    """VPN clients of each router, by its host name."""

    @property
    def has_server(self) -> bool:
        """Whether the VPN's server takes part: without it no tunnel comes up."""
        return self.inventory.pilot.vpn.server in self.rehearsal.computers.machines

    def machines(self, site: str) -> dict[str, lab.Machine]:
        """Return the machines of a site by host name."""
        computers = self.rehearsal.computers.machines
        return {name: machine for name, machine in computers.items() if self.inventory.hosts[name].site == site}


@contextmanager
def join_sites(
    inventory: Inventory, hosts: Sequence[Host], rehearsal: Rehearsal, request: Request
) -> Iterator[PilotRehearsal]:
    """Join the sites of configured emulated routers and machines until the context ends.

    Raises MachineError if this computer cannot do it, DeviceError if a router refuses its identity.
    """
    routers = tuple(host for host in hosts if isinstance(host.device, model.Router))
    for host in hosts:
        rehearsal.relink(inventory, host, LAN.name)  # the technician is there; the sites' own links are real packets
    if inventory.pilot.vpn.server in rehearsal.computers.machines:
        enrol_routers(inventory, rehearsal, routers, request)
    request = request.model_copy(update={"accept_cost": True})
    with ExitStack() as stack, temporary.folder("tunnels") as folder:

        def attach(host: Host, namespace: str | None) -> None:
            rehearsal.emulators.do(host.name, "attach", namespace=namespace)

        network = stack.enter_context(open_network(inventory, routers, attach, rehearsal.replay))
        for host in routers:
            stack.callback(attach, host, None)
        pilot = PilotRehearsal(inventory, rehearsal, network, routers, request)
        for host in routers:
            for machine in pilot.machines(host.site).values():
                network.plug_in(machine, host)
        if pilot.has_server:
            _connect(pilot, stack, folder)
        yield pilot


def _connect(pilot: PilotRehearsal, stack: ExitStack, folder: Path) -> None:
    """Start the routers' clients, let those of the computers try again, and wait for the tunnels of all."""
    end = time.monotonic() + _UP_S
    for host in pilot.routers:
        place = folder / host.name
        place.mkdir(mode=0o700)
        do = partial(pilot.rehearsal.emulators.do, host.name)
        clients = pilot.tunnels[host.name] = tunnel.RouterTunnels(do, pilot.network.routers[host.name], place)
        stack.callback(clients.close)
        clients.refresh()
    machines = [
        machine
        for name, machine in pilot.rehearsal.computers.machines.items()
        if _is_client(pilot.inventory.hosts[name])
    ]
    with ThreadPoolExecutor(max(1, len(machines))) as pool:
        results = list(pool.map(lambda machine: _reconnect(machine, end), machines))
    silent = [machine.name for machine, is_up in zip(machines, results, strict=True) if not is_up]
    for name, clients in pilot.tunnels.items():
        if not all(client.wait(max(0.0, end - time.monotonic())) for client in clients.tunnels.values()):
            silent.append(name)
    pilot.silent |= dict.fromkeys(silent, msg(f"no tunnel to the VPN within {arg(_UP_S):g} s"))


def _is_client(host: Host) -> bool:
    return isinstance(host.device, model.ServerComputer) and host.device.vpn_address is not None


def _reconnect(machine: lab.Machine, end: float) -> bool:
    """Restart a computer's VPN client; return whether its tunnel has an address before `end` (monotonic)."""
    machine.run(shlex.join(("systemctl", "restart", SERVICE)))
    while time.monotonic() < end:
        rows = json.loads(lab_hosts.run_in_namespace(machine.namespace, "ip", "-j", "-4", "address", "show"))
        if any(row["ifname"] == _TUNNEL and row["addr_info"] for row in rows):
            return True
        time.sleep(_POLL_S)
    return False
