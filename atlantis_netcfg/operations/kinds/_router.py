"""The router of a site."""

from __future__ import annotations

from ipaddress import IPv4Interface
from typing import TYPE_CHECKING

from atlantis_netcfg.declaration.model import PortUse, Router
from atlantis_netcfg.operations.kinds._managed import Hardware, Managed, Place, Text
from atlantis_netcfg.render import prerequisites, router

if TYPE_CHECKING:
    from atlantis_netcfg.declaration import Host
    from atlantis_netcfg.declaration.model import Access
    from atlantis_netcfg.render import Prerequisite

__all__ = ["ManagedRouter"]


class ManagedRouter(Managed):
    """Managed from the technician's port."""

    __slots__ = ()

    @staticmethod
    def takes(host: Host) -> bool:
        """Tell whether a host is of this kind."""
        return isinstance(host.device, Router)

    @property
    def _router(self) -> Router:
        assert isinstance(self.host.device, Router)  # noqa: S101 - `takes` has said so
        return self.host.device

    @property
    def access(self) -> Access:
        """As declared."""
        return self._router.access

    def texts(self) -> tuple[Text, ...]:
        """Return the one text."""
        return (Text(router(self.declaration, self.host)),)

    def prerequisites(self) -> tuple[Prerequisite, ...]:
        """Ports and certificates."""
        return prerequisites(self.declaration, self.host)

    @property
    def place(self) -> Place:
        """The management port."""
        network = self.declaration.sites[self.host.site].management
        return Place(
            address=str(IPv4Interface(f"{self.access.address}/{network.network.prefixlen}")),
            port=next(port.name for port in self._router.ports if port.use is PortUse.MANAGEMENT),
            technician=str(network.technician),
        )

    @property
    def hardware(self) -> Hardware:
        """The declared ports."""
        ports = self._router.ports
        return Hardware(
            ports=tuple(port.name for port in ports),
            poe_ports=tuple(port.name for port in ports if port.poe is not None),
        )
