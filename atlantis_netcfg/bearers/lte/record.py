"""The record that every 4G driver returns, and the reading of a unit without a driver."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from atlantis_netcfg.bearers.status import Finding
from atlantis_netcfg.core.verdicts import Verdict


class Registration(StrEnum):
    """Where the unit is on its way into the network; a word that nobody knows is `unknown`, never a failure."""

    REGISTERED_HOME = "registered_home"
    REGISTERED_ROAMING = "registered_roaming"
    SEARCHING = "searching"
    DENIED = "denied"
    SIM_MISSING = "sim_missing"
    SIM_PIN_REQUIRED = "sim_pin_required"
    SIM_PUK_REQUIRED = "sim_puk_required"
    """Too many wrong PINs: only the PUK helps."""
    DISABLED = "disabled"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True, kw_only=True)
class LteReading:
    """What a 4G unit said at one moment; what it did not say, or said as "N/A", is None.

    It has no IMEI, IMSI or ICCID: those are redacted where they are read.
    """

    source: str
    """The driver: routeros, rutos, modemmanager, at, manual."""
    state: Registration = Registration.UNKNOWN
    access_tech: str | None = None
    """As the device names it, in lower case: lte, 5g, umts …"""
    operator: str | None = None
    plmn: str | None = None
    """Mobile country and network code, like 26801."""
    band: str | None = None
    """Like B3."""
    rsrp_dbm: float | None = None
    rsrq_db: float | None = None
    sinr_db: float | None = None
    rssi_dbm: float | None = None
    roaming: bool | None = None
    sim_slot: int | None = None
    address: str | None = None
    """IP address that the network has given; None: none, or not readable."""
    connected: bool | None = None
    """Whether the unit says that its data connection is up; None: not said."""
    apn: str | None = None
    """In use, read back: a declared one may be ignored."""
    pin_refused: bool | None = None
    """Whether the SIM has refused a PIN; None: not said."""
    pin_tries_left: int | None = None
    """Before the PUK is needed; None: not said."""
    network_apn: bool | None = None
    """RouterOS' `use-network-apn`: the network's own APN goes before the configured one; None: not said."""
    last_error: str | None = None
    """In the device's own words."""


LOOK_FOR = (
    "the SIM is found and asks for no PIN",
    "registered (home or roaming), with the operator's name",
    "APN as in the contract, and an IP address",
    "roaming as in the contract",
    "RSRP above -105 dBm, RSRQ above -15 dB, SINR above 0 dB",
)
"""What has to stand on the unit's own page."""


def unmanaged_reading() -> LteReading:
    """The reading of a unit without a driver: everything unknown."""
    return LteReading(source="manual")


def check_by_hand(address: str) -> Finding:
    """The finding for a unit without a driver: a person must look at its own page."""
    return Finding(
        Verdict.INCONCLUSIVE,
        "look-yourself",
        f"no driver for this 4G unit: a person must look at its own page, http://{address}/ or as its manual says",
        "look for: " + "; ".join(LOOK_FOR),
    )
