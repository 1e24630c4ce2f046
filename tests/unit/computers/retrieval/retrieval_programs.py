"""The two programs of a retrieval as modules, and the shipped pilot with one declared."""

import importlib.util
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import Retrieval, ServerComputer

ROOT = Path(__file__).parents[4]
SHIPPED = load(ROOT / "inventory")
GATEWAY, CENTRE = "coastal-gateway", "scc-control"
KEY = "ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIOzMkrV3HHY+skvjB+3Dgsy6+gi2Qp9FkJyNvsHCouP1"


ROBOT = {
    "robot": "sparus",
    "host": GATEWAY,
    "user": "recorder",
    "host_key": "ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIH5eLMsHkBVYJvOqBFRmXyqnhS1jKGBnLmjqXmkKJqmR",
    "folder": "/home/recorder/bags",
    "budget_mb": 100,
}
"""As it is declared."""


def program(name: str) -> ModuleType:
    """`retrieval` or `retrieval_receive`, freshly imported."""
    spec = importlib.util.spec_from_file_location(name, ROOT / f"templates/gateway/{name}.py")
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


def with_retrieval(**values: Any) -> Inventory:  # noqa: ANN401 - of the model
    """From the coastal gateway to the control centre; both have the same host key here."""
    own = {} if "robots" in values else {"sources": [{"host": GATEWAY}]}
    declared = {"to": CENTRE, "budget_mb": 1000} | own | values
    hosts = dict(SHIPPED.hosts)
    for name in (GATEWAY, CENTRE):
        device = hosts[name].device
        assert isinstance(device, ServerComputer)
        ssh = device.ssh.model_copy(update={"host_key": KEY})
        hosts[name] = replace(hosts[name], device=device.model_copy(update={"ssh": ssh}))
    pilot = SHIPPED.pilot.model_copy(update={"retrieval": Retrieval.model_validate(declared)})
    return replace(SHIPPED, hosts=hosts, pilot=pilot)
