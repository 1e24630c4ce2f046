"""A MikroTik LTE box between a site's router and the 4G network."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.declaration.model import Access, LteDriver, LteRouter
from atlantis_netcfg.emulator.routeros import CellSpec, ModemSpec, SimSpec
from atlantis_netcfg.operations.kinds._managed import Hardware, Managed, Place, Text
from atlantis_netcfg.render import lte, lte_bearer, lte_prerequisites, lte_view

if TYPE_CHECKING:
    from atlantis_netcfg.declaration import Host
    from atlantis_netcfg.render import Prerequisite

__all__ = ["ManagedLte"]


class ManagedLte(Managed):
    """Managed at its one cable, from the router's side."""

    __slots__ = ()

    @staticmethod
    def takes(host: Host) -> bool:
        """Tell whether a host is of this kind: other 4G units have drivers of their own."""
        return isinstance(host.device, LteRouter) and host.device.driver is LteDriver.ROUTEROS

    @property
    def access(self) -> Access:
        """As declared; the box is always at the site's own 4G link."""
        device = self.host.device
        assert isinstance(device, LteRouter)  # noqa: S101 - `takes` has said so
        assert device.access is not None  # noqa: S101 - a rule of the declaration has said so
        known = {"user": device.access.user, "password": device.access.password}
        port = {} if device.access.port is None else {"port": device.access.port}
        return Access.model_validate({"address": device.address, **known, **port})

    def texts(self) -> tuple[Text, ...]:
        """Return the one text."""
        return (Text(lte(self.declaration, self.host)),)

    def prerequisites(self) -> tuple[Prerequisite, ...]:
        """Modem, port and certificate."""
        return lte_prerequisites(self.declaration, self.host)

    @property
    def place(self) -> Place:
        """The cable; the technician stands behind the site's router, which masquerades."""
        view = lte_view(self.declaration, self.host)
        return Place(view.management.address, view.port, str(lte_bearer(self.declaration, self.host).address))

    @property
    def hardware(self) -> Hardware:
        """A box with one port and one modem; its SIM has the declared PIN, its network only the declared access point.

        It is a SIM of that network: what happens abroad is for those who try it on purpose.
        """
        view = lte_view(self.declaration, self.host)
        cell = CellSpec(apns=() if view.apn is None else (view.apn,), bands=view.bands or (3,))
        card = SimSpec(pin="" if view.pin is None else view.pin.reveal())
        bands = tuple(sorted({*ModemSpec().bands, *view.bands}))
        modem = ModemSpec(name=view.modem, sim=card, cell=cell, bands=bands)
        return Hardware(ports=(view.port,), modem=modem, board="LHG LTE6 kit")
