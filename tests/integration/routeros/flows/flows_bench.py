"""A site's router with its rendered rows, and what becomes of its flows."""

import time
from collections.abc import Callable
from pathlib import Path

from atlantis_netcfg.emulator import lab
from atlantis_netcfg.emulator.lab import hosts
from atlantis_netcfg.emulator.routeros.dataplane.namespace import RouterNamespace
from atlantis_netcfg.emulator.routeros.dataplane.rows import NetworkState, network_state
from atlantis_netcfg.emulator.routeros.device import Device
from atlantis_netcfg.emulator.routeros.spec import ManagementSpec
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.operations.common.rehearsal import site_spec
from atlantis_netcfg.operations.flows import matrix
from atlantis_netcfg.routeros.render import router

SHIPPED = Path(__file__).parents[4] / "inventory"
SITES = ("scc", "coastal", "te4sea")


def inventory() -> Inventory:
    return load(SHIPPED)


def rows(declared: Inventory, site: str, edit: Callable[[str], str] = str) -> NetworkState:
    """What the rows of a site's router say, after a change of the rendered text."""
    return network_state(device(declared, site, edit).core.topology.with_all_linked())


def device(declared: Inventory, site: str, edit: Callable[[str], str] = str) -> Device:
    """The router of a site, configured."""
    host = declared.hosts[f"{site}-router"]
    text = edit(router(declared, host))
    spec = next(item.router for item in site_spec(declared, [host], None).emulators)
    # In the place of the management address, which the text has, too.
    elsewhere = ManagementSpec(address="192.168.88.1/24", port=spec.management.port, technician="192.168.88.10")
    return Device(spec.model_copy(update={"seed": text, "management": elsewhere}), time.monotonic)


def try_site(declared: Inventory, site: str, state: NetworkState, *links: str) -> list[matrix.MatrixResult]:
    """The flows over each link, or over those that are named."""
    results = []
    host = declared.hosts[f"{site}-router"]
    with lab.reserve_name() as name:
        for number, link in enumerate(declared.sites[site].bearers):
            if not links or link.name in links:
                hosts.add_namespace(f"{name}-{number}")
                namespace = RouterNamespace(f"{name}-{number}")
                results.append(matrix.try_flows(declared, host, link, namespace, state))
    return results
