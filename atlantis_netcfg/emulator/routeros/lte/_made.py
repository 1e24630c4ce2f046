"""The rows that the device makes by itself while its modem is connected."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.lte._modem import Phase, phase_of, settings_of
from atlantis_netcfg.emulator.routeros.values import id_text

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.core import Core

__all__ = ["made"]


def made(core: Core, path: str) -> list[dict[str, str]]:
    """The address and the default route that the device makes by itself while the modem is connected."""
    mine = settings_of(core) if path in {"/ip/address", "/ip/route"} else None
    modem = core.spec.modem
    if mine is None or modem is None or modem.cell is None or phase_of(core, mine) is not Phase.CONNECTED:
        return []
    number = id_text(core.store.dynamic_id(path, "lte", mine.item.id))
    flags = {"dynamic": "true", "disabled": "false"}
    if path == "/ip/address":
        own = {"address": f"{modem.cell.address}/32", "network": modem.cell.address, "interface": mine.name}
        return [{".id": number, **own, "actual-interface": mine.name, "invalid": "false", "slave": "false", **flags}]
    if not mine.default_route:
        return []
    way = {"dst-address": "0.0.0.0/0", "routing-table": "main", "gateway": mine.name, "distance": mine.distance}
    return [{".id": number, **way, "scope": "30", "target-scope": "10", "active": "true", "inactive": "false", **flags}]
