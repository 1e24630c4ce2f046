"""From what a RutOS unit says of its modem to the one record of all drivers; IMEI, IMSI and ICCID stay behind."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.bearers.lte.record import LteReading, Registration
from atlantis_netcfg.bearers.lte.rutos import _words as words

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["SOURCE", "connected", "modem_of", "reading_of", "serial_of"]

SOURCE = "rutos"
_REGISTERED = (Registration.REGISTERED_HOME, Registration.REGISTERED_ROAMING)


def modem_of(rows: object) -> Mapping[str, Any] | None:
    """The modem that carries the link: the primary one, else the first; None if there is none."""
    found = [row for row in (rows if isinstance(rows, list) else [rows]) if isinstance(row, dict)]
    return next((row for row in found if str(row.get("primary")).lower() in ("true", "1")), found[0] if found else None)


def reading_of(modem: Mapping[str, Any], interfaces: object = None, apn: str | None = None) -> LteReading:
    """Put one record into ours. `interfaces`: the rows of the interfaces' status, for the address."""
    between, refused, left = words.sim(modem)
    said = words.text(modem, "registration")
    state = between or words.registration(said)
    slot = words.number(modem, "slot")
    registered = state in _REGISTERED
    return LteReading(
        source=SOURCE,
        state=state,
        access_tech=words.technology(words.text(modem, "technology")),
        operator=words.text(modem, "operator"),
        plmn=words.plmn(modem),
        band=words.band(words.text(modem, "band")),
        rsrp_dbm=words.number(modem, "rsrp"),
        rsrq_db=words.number(modem, "rsrq"),
        sinr_db=words.number(modem, "sinr"),
        rssi_dbm=words.number(modem, "rssi"),
        roaming=state is Registration.REGISTERED_ROAMING if registered else None,
        sim_slot=None if slot is None else int(slot),
        address=_address(interfaces),
        connected=connected(modem),
        apn=apn,
        pin_refused=refused,
        pin_tries_left=left,
        last_error=None if registered else _error(modem, said),
    )


def connected(modem: Mapping[str, Any]) -> bool | None:
    """Whether the unit says that its data connection is up: `state` is the connection, `simstate` the card."""
    said = (words.text(modem, "connection") or "").lower()
    if said.startswith(("disconnected", "not connected")):
        return False
    return True if said.startswith("connected") else None


def serial_of(status: object) -> str | None:
    """The unit's serial number (`mnfinfo.serial` of the device's status) [inferred]: it identifies the unit."""
    if not isinstance(status, dict):
        return None
    for part in (status.get("mnfinfo"), status):
        if isinstance(part, dict) and isinstance(part.get("serial"), str | int) and str(part["serial"]).strip():
            return str(part["serial"]).strip()
    return None


def _error(modem: Mapping[str, Any], registration: str | None) -> str | None:
    """What stands in the way, in the unit's words."""
    for said in (words.text(modem, "pin"), words.text(modem, "card"), registration):
        if said is not None and said.lower() not in ("inserted", "ok", "ready"):
            return said
    return None


def _address(interfaces: object) -> str | None:
    """The first IPv4 address of a mobile interface (`mob1s1a1`) [inferred: `ipaddrs` beside `ip6addrs`]."""
    rows = interfaces if isinstance(interfaces, list) else []
    for row in rows:
        if not isinstance(row, dict) or not _mobile(row):
            continue
        for found in _texts(row):
            if match := re.fullmatch(r"(\d+\.\d+\.\d+\.\d+)(?:/\d+)?", found.strip()):
                return match[1]
    return None


def _mobile(row: Mapping[str, Any]) -> bool:
    name = str(row.get("id") or row.get("name") or "")
    return row.get("network_type") == "mobile" or re.match(r"mob\d+s\d+a\d+", name) is not None


def _texts(row: Mapping[str, Any]) -> Sequence[str]:
    """Addresses as text, as a list of texts, or as a list of rows with `address`."""
    found: list[str] = []
    for name in ("ipaddrs", "ipv4-address", "ipv4_address", "ip", "ipaddr"):
        value = row.get(name)
        for one in value if isinstance(value, list) else [value]:
            each = one.get("address") if isinstance(one, dict) else one
            if isinstance(each, str):
                found.append(each)
    return found
