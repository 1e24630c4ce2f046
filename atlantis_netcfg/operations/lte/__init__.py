"""4G units that are not RouterOS in a run: set to what is declared of their SIM where that can be, and judged."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.declaration.model import LteDriver, LteRouter

if TYPE_CHECKING:
    from atlantis_netcfg.declaration import Host


def is_unit(host: Host) -> bool:
    """Tell whether a host is a 4G unit that its own driver reads, and not the RouterOS engine."""
    return isinstance(host.device, LteRouter) and host.device.driver is not LteDriver.ROUTEROS
