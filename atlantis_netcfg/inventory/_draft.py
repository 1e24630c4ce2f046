"""Validated parts of the inventory with the place of every value: input of the validation rules."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeVar

from atlantis_netcfg.inventory.findings import Finding, Mark
from atlantis_netcfg.inventory.model import Device, Model, Partner, Pilot, Router, Site, Vehicle

if TYPE_CHECKING:
    from atlantis_netcfg.inventory._hosts import HostLayout
    from atlantis_netcfg.inventory._yaml import Node


@dataclass(frozen=True, slots=True)
class Part:
    """One block of the inventory: `pilot`, `partner inesc`, `site coastal`, `device coastal-router`."""

    sort: str
    name: str = ""


@dataclass(slots=True)
class Draft:
    """Valid parts only; a reference to an invalid part of the inventory is neither right nor wrong."""

    layout: HostLayout
    nodes: dict[Part, Node] = field(default_factory=dict)
    """All declared parts, valid or not."""
    pilot: Pilot | None = None
    partners: dict[str, Partner] = field(default_factory=dict)
    vehicles: dict[str, Vehicle] = field(default_factory=dict)
    sites: dict[str, Site] = field(default_factory=dict)
    devices: dict[str, Device] = field(default_factory=dict)

    def names(self, sort: str) -> list[str]:
        """Return the names of all parts of a sort, valid or not."""
        return [part.name for part in self.nodes if part.sort == sort]

    def mark(self, part: Part, *path: str | int) -> Mark:
        """Return the place of a value; for a block, the place of its key."""
        node = self.nodes[part].at(*path)
        return node.place if isinstance(node.value, dict | list) else node.mark

    def finding_at(self, part: Part, path: tuple[str | int, ...], message: str, hint: str) -> Finding:
        """Build a finding at a value."""
        return Finding.at(self.mark(part, *path), message, hint)

    def where(self, part: Part, *path: str | int) -> str:
        """Format a place as `inventory/group_vars/scc.yml:6`."""
        mark = self.mark(part, *path)
        return f"{mark.file}:{mark.line}"

    def valid_devices(self, model: type[_Box]) -> Iterator[tuple[str, str, _Box]]:
        """Yield host, site and device for every valid device of a kind."""
        for host, site in self.layout.hosts.items():
            device = self.devices.get(host)
            if isinstance(device, model):
                yield host, site, device

    def router_of(self, site: str) -> tuple[str, Router] | None:
        """Return the router of a site, if there is exactly one valid router."""
        here = [name for name, place in self.layout.hosts.items() if place == site]
        routers = [name for name in here if self.kind_of(name) == "router"]
        device = self.devices.get(routers[0]) if len(routers) == 1 else None
        return (routers[0], device) if isinstance(device, Router) else None

    def kind_of(self, host: str) -> str | None:
        """Return a host's kind: from its own file, else from its group."""
        device = self.devices.get(host)
        return device.kind if device is not None else self.layout.kinds.get(host)


_Box = TypeVar("_Box", bound="Model")


Rule = Callable[[Draft], Iterator[Finding]]
"""Checks the whole draft, and returns every violation."""
