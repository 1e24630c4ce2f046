"""The shipped gateway of the coast, with a network of the test's own."""

from dataclasses import replace
from functools import cache
from pathlib import Path

from atlantis_netcfg.inventory import Host, Inventory, load
from atlantis_netcfg.inventory.model import AddressBy, ComputerNetwork, Gateway, NetworkTool

SHIPPED = Path(__file__).parents[4] / "inventory"
HOST = "coastal-gateway"


@cache
def shipped() -> Inventory:
    return load(SHIPPED)


def coast(by: str | None, address_by: str = "static", **network: object) -> tuple[Inventory, Host]:
    """`by`: None declares no network."""
    declaration = shipped()
    host = declaration.hosts[HOST]
    assert isinstance(host.device, Gateway)
    assert host.device.image is not None
    image = host.device.image.model_copy(update={"address_by": AddressBy(address_by), "interface": "eth0"})
    wanted = None if by is None else ComputerNetwork(by=NetworkTool(by), interface="eth0", **network)
    device = host.device.model_copy(update={"network": wanted, "image": image})
    changed = replace(host, device=device)
    return replace(declaration, hosts={**declaration.hosts, HOST: changed}), changed
