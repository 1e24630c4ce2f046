"""The network card that a row is known by at a site."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.probes.cell import Cell

__all__ = ["reserved_mac"]


def reserved_mac(cell: Cell, declared: object) -> str | None:
    """Give the declared MAC address, else that of the row's DHCP reservation, in upper case; None: nobody says."""
    if declared is not None:
        return str(declared).upper()
    reservations = (item for item in cell.declared.lan.reservations if item.name == cell.vehicle)
    return next((str(reservation.mac).upper() for reservation in reservations), None)
