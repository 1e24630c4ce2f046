"""The two radios of a bridge: each is read by itself, and each is told the other one's hardware address."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers.wifi import Family, WifiWanted, queries
from atlantis_netcfg.bearers.wifi import read as read_wifi
from atlantis_netcfg.declaration.model import Cpe, PtpMode
from atlantis_netcfg.operations.links._door import command, rows
from atlantis_netcfg.routeros.api import Command

if TYPE_CHECKING:
    from atlantis_netcfg.bearers.wifi import WifiReading
    from atlantis_netcfg.declaration import Host
    from atlantis_netcfg.operations.links._door import Door
    from atlantis_netcfg.routeros._types import Row

__all__ = ["RadioLook", "read_radio", "wanted_of"]

_MENUS = {family: f"/interface/{family}/print" for family in Family}
_RADIO = "name,default-name,mac-address,disabled"


@dataclass(frozen=True, slots=True)
class RadioLook:
    """What a CPE said of its radio."""

    reading: WifiReading | None
    """None: the device has no radio that its menus show."""
    mac: str | None = None
    """Of its own radio, upper case."""


async def read_radio(door: Door) -> RadioLook:
    """Read in one session of three round trips: login, which radio it has, that radio. Raises DeviceFailed."""
    async with door.opened() as session:
        replies = await session.flight([Command(path, ((".proplist", _RADIO),)) for path in _MENUS.values()])
        found = _radio([(family, rows(reply)) for family, reply in zip(_MENUS, replies, strict=True)])
        if found is None:
            return RadioLook(None)
        family, row = found
        table, monitor = await session.flight([command(query) for query in queries(family, row["name"])])
    shown = rows(monitor)
    reading = read_wifi(family, rows(table), shown[0] if shown else None, row["name"])
    return RadioLook(reading, (row.get("mac-address") or "").upper() or None)


def _radio(told: list[tuple[Family, tuple[Row, ...] | None]]) -> tuple[Family, Row] | None:
    """The board's first radio; virtual ones have no `default-name` and come after it."""
    radios = [(family, row) for family, menu in told for row in menu or () if "name" in row]
    return next((one for one in radios if "default-name" in one[1]), radios[0] if radios else None)


def wanted_of(end: Host, other: Host, other_mac: str | None) -> WifiWanted:
    """What is declared of one end."""
    assert isinstance(end.device, Cpe)  # noqa: S101 - the ends of a bridge are CPEs
    ptp = end.device.ptp
    return WifiWanted(
        peer=other.name,
        peer_macs=frozenset({other_mac} if other_mac else ()),
        access_point=ptp.mode is PtpMode.ACCESS_POINT,
        ssid=ptp.ssid,
        protocol=ptp.protocol.value,
        frequency_mhz=ptp.frequency_mhz,
        width_mhz=ptp.width_mhz,
        weakest_dbm=ptp.signal.weakest_dbm,
        strongest_dbm=ptp.signal.strongest_dbm,
    )
