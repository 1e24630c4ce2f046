"""The shipped inventory, read with the models alone: rendering must not need the loader."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml
from pydantic import TypeAdapter

from atlantis_netcfg.inventory.model import Device, Pilot, Router, Site

INVENTORY = Path(__file__).parents[4] / "inventory"
GOLDEN = Path(__file__).parent / "golden"
SITES = ("scc", "coastal", "te4sea")
_DEVICE: TypeAdapter[Device] = TypeAdapter(Device)


@dataclass(frozen=True)
class Host:
    name: str
    site: str
    device: Device


@dataclass(frozen=True)
class Declaration:
    pilot: Pilot
    sites: Mapping[str, Site]
    hosts: Mapping[str, Host]

    def router(self, site: str) -> Host:
        return self.hosts[f"{site}-router"]


def _yaml(name: str) -> dict[str, Any]:
    loaded = yaml.safe_load((INVENTORY / name).read_text("utf-8"))
    assert isinstance(loaded, dict)
    return loaded


def declaration() -> Declaration:
    names = _yaml("hosts.yml")["all"]["children"]["sites"]["children"]
    site_of = {host: site for site, group in names.items() for host in group["hosts"]}
    return Declaration(
        pilot=Pilot.model_validate(_yaml("group_vars/all/pilot.yml")["pilot"]),
        sites={site: Site.model_validate(_yaml(f"group_vars/{site}.yml")["site"]) for site in names},
        hosts={
            host: Host(host, site, _DEVICE.validate_python(_yaml(f"host_vars/{host}.yml")["device"]))
            for host, site in site_of.items()
        },
    )


def with_site(given: Declaration, name: str, **changes: object) -> Declaration:
    site = given.sites[name].model_copy(update=changes)
    return replace(given, sites={**given.sites, name: site})


def with_router(given: Declaration, site: str, **changes: object) -> Declaration:
    host = given.router(site)
    assert isinstance(host.device, Router)
    changed = replace(host, device=host.device.model_copy(update=changes))
    return replace(given, hosts={**given.hosts, host.name: changed})
