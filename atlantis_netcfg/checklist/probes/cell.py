"""One cell of the checklist: a row (vehicle or location) and what of it is looked at."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes.requests import Place
from atlantis_netcfg.declaration.model import Endpoints, Gateway, Router, SeenFrom

if TYPE_CHECKING:
    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.declaration.model import Site

__all__ = ["SITE", "Cell"]

SITE = "site"
"""The endpoint of the site's own checks."""


@dataclass(frozen=True, slots=True)
class Cell:
    """What the steps of a column are made from."""

    declaration: Declaration
    site: str
    vehicle: str | None
    """Key; None: the location."""
    endpoint: str
    """A column of Table 3, `ethernet`, or `site`."""

    @property
    def row(self) -> str:
        """The first part of an item's id."""
        return self.vehicle or self.site

    @property
    def name(self) -> str:
        """The row in words."""
        return self.declared.title if self.vehicle is None else self.declaration.vehicles[self.vehicle].name

    @property
    def declared(self) -> Site:
        """The site."""
        return self.declaration.sites[self.site]

    @property
    def endpoints(self) -> Endpoints:
        """How the row's endpoints are seen."""
        if self.vehicle is not None:
            return self.declaration.vehicles[self.vehicle].endpoints
        return self.declared.location.endpoints

    @property
    def gateway(self) -> Host | None:
        """The site's gateway computer."""
        return next((host for host in self.declaration.site_hosts(self.site) if isinstance(host.device, Gateway)), None)

    @property
    def router(self) -> Host | None:
        """The site's router."""
        return next((host for host in self.declaration.site_hosts(self.site) if isinstance(host.device, Router)), None)

    def place(self, seen_from: SeenFrom) -> Place:
        """Where a probe of this cell stands: a site without a gateway is looked at from the laptop."""
        if seen_from is SeenFrom.GATEWAY and self.gateway is not None:
            return Place.GATEWAY
        return Place.LAPTOP

    def address(self, declared: object) -> str | None:
        """The declared address, else that of the row's DHCP reservation at this site; None: nobody says."""
        if declared is not None:
            return str(declared)
        reservations = (item for item in self.declared.lan.reservations if item.name == self.vehicle)
        return next((str(reservation.address) for reservation in reservations), None)
