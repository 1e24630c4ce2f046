"""Problems of a 4G unit as text: one finding for each thing that a technician can act on.

Radio levels only warn: whether the site has its link is decided by registration, address and probes. The bands of the
levels are rules of thumb published by modem makers, not a standard: devices.md, section 4, from memory.

Also the record that every 4G driver returns, and the reading of a unit without a driver.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.links import status

if TYPE_CHECKING:
    from collections.abc import Iterator


class Registration(StrEnum):
    """The unit's registration state; an unrecognised state is `unknown`, never a failure."""

    REGISTERED_HOME = "registered_home"
    REGISTERED_ROAMING = "registered_roaming"
    SEARCHING = "searching"
    DENIED = "denied"
    SIM_MISSING = "sim_missing"
    SIM_PIN_REQUIRED = "sim_pin_required"
    SIM_PUK_REQUIRED = "sim_puk_required"
    """Too many wrong PINs were entered: only the PUK unlocks the SIM."""
    DISABLED = "disabled"
    UNKNOWN = "unknown"

    @property
    def words(self) -> str:
        """The state as text for people."""
        return msg(self.replace("_", " "))


@dataclass(frozen=True, slots=True, kw_only=True)
class LteReading:
    """The state that a 4G unit reported at one moment; values missing or reported as "N/A" are None.

    It has no IMEI, IMSI or ICCID: those are redacted where they are read.
    """

    source: str
    """The driver: routeros, rutos, modemmanager, at, manual."""
    state: Registration = Registration.UNKNOWN
    access_tech: str | None = None
    """Radio technology as the device names it, in lower case: lte, 5g, umts …"""
    operator: str | None = None
    plmn: str | None = None
    """Mobile country and network code, like 26801."""
    band: str | None = None
    """Radio band, like B3."""
    cell: str | None = None
    """Identity of the serving cell, in the device's own format; None: not reported."""
    rsrp_dbm: float | None = None
    rsrq_db: float | None = None
    sinr_db: float | None = None
    rssi_dbm: float | None = None
    roaming: bool | None = None
    sim_slot: int | None = None
    address: str | None = None
    """IP address assigned by the network; None: none, or not readable."""
    is_connected: bool | None = None
    """Whether the unit reports an active data connection; None: not reported."""
    apn: str | None = None
    """APN in use, as read from the unit: it may ignore the one in the inventory."""
    pin_refused: bool | None = None
    """Whether the SIM has refused a PIN; None: not reported."""
    pin_tries_left: int | None = None
    """PIN attempts left before the PUK is required; None: not reported."""
    network_apn: bool | None = None
    """RouterOS' `use-network-apn`: the network's APN takes precedence over the configured one; None: not reported."""
    last_error: str | None = None
    """Last error, as the device words it."""


LOOK_FOR = (
    "the SIM is detected and does not ask for a PIN",
    "registered (home or roaming), with the operator's name",
    "APN as in the contract, and an IP address",
    "roaming as in the contract",
    "RSRP above -105 dBm, RSRQ above -15 dB, SINR above 0 dB",
)
"""What a person should check on the unit's own web page."""


def unmanaged_reading() -> LteReading:
    """Return the reading of a unit without a driver: everything unknown."""
    return LteReading(source="manual")


def manual_check_finding(address: str) -> status.LinkFinding:
    """Return the finding for a unit without a driver: a person must check its web page."""
    return status.LinkFinding(
        Verdict.INCONCLUSIVE,
        "look-yourself",
        msg(f"this 4G unit has no driver: check it on its own page, http://{arg(address)}/ or as its manual says"),
        msg("check: " + str(arg(join("; ", LOOK_FOR)))),
    )


WEAK_RSRP_DBM = -105.0
WEAK_RSRQ_DB = -15.0
WEAK_SINR_DB = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LteSubscription:
    """The SIM and its subscription, as given in the inventory."""

    apn: str | None = None
    """None: the network's default APN is used."""
    roaming: bool = False
    pin_declared: bool = False
    apn_required: bool = False
    """Whether an APN is required, because the subscription has a user or a password."""
    bands: tuple[int, ...] = ()
    """LTE bands to which the unit is restricted; empty: no restriction."""


_REGISTERED_STATES = frozenset({Registration.REGISTERED_HOME, Registration.REGISTERED_ROAMING})


def judge(reading: LteReading, subscription: LteSubscription) -> tuple[status.LinkFinding, ...]:
    """Return all findings about the unit; empty if it matches the inventory and its signal is good."""
    if reading.state in _REGISTERED_STATES:
        return tuple(_judge_registered(reading, subscription))
    return (_judge_unregistered(reading, subscription),)


def link_state(reading: LteReading) -> status.LinkState:
    """Return the link state that the unit itself reports, without a probe."""
    if reading.state in _REGISTERED_STATES:
        return status.LinkState.UP if reading.address is not None or reading.is_connected else status.LinkState.UNKNOWN
    if reading.state is Registration.SEARCHING:
        return status.LinkState.SEARCHING
    return status.LinkState.UNKNOWN if reading.state is Registration.UNKNOWN else status.LinkState.DOWN


def quality(reading: LteReading) -> status.Quality:
    """Return the quality readings for a `LinkStatus`."""
    return {
        "registration": reading.state.value,
        "operator": reading.operator,
        "plmn": reading.plmn,
        "access_tech": reading.access_tech,
        "band": reading.band,
        "rsrp_dbm": reading.rsrp_dbm,
        "rsrq_db": reading.rsrq_db,
        "sinr_db": reading.sinr_db,
        "rssi_dbm": reading.rssi_dbm,
        "roaming": None if reading.roaming is None else str(reading.roaming).lower(),
        "address": reading.address,
        "apn": reading.apn,
    }


def _judge_unregistered(reading: LteReading, subscription: LteSubscription) -> status.LinkFinding:
    if reading.state is Registration.SIM_PIN_REQUIRED:
        return _pin(reading, subscription)
    verdict, code, message, hint = _STATES[reading.state]
    if reading.last_error:
        message = msg(f"{arg(message)} (the device reports: {arg(reading.last_error)})")
    return status.LinkFinding(verdict, code, message, hint)


def _pin(reading: LteReading, subscription: LteSubscription) -> status.LinkFinding:
    tries_text = msg("" if reading.pin_tries_left is None else f"; tries left: {arg(reading.pin_tries_left)}")
    if reading.pin_refused:
        message = msg(f"the SIM refused the PIN; it will not be tried again{arg(tries_text)}")
        hint = "compare `sim.pin` with the letter of the SIM; unlock the SIM in a telephone before the next run"
        return status.LinkFinding(Verdict.FAIL, "pin-wrong", message, hint)
    if not subscription.pin_declared:
        hint = "set `sim.pin` (in the vault), or disable the SIM's PIN in a telephone"
        return status.LinkFinding(
            Verdict.FAIL,
            "pin-needed",
            msg(f"the SIM asks for a PIN, but the inventory has none{arg(tries_text)}"),
            hint,
        )
    message = msg(
        f"the SIM asks for a PIN; a run that changes the device tries the one in the inventory once{arg(tries_text)}"
    )
    hint = (
        "provision the site; if a run has already tried the PIN, it is wrong: find the right one before you try again"
    )
    return status.LinkFinding(Verdict.FAIL, "pin-not-entered", message, hint)


_STATES: dict[Registration, tuple[Verdict, str, str, str]] = {
    Registration.SIM_PUK_REQUIRED: (
        Verdict.FAIL,
        "puk-needed",
        "the SIM is locked after too many wrong PINs and asks for its PUK; the toolkit tries nothing",
        "unlock it in a telephone with the PUK from the letter of the SIM; ten wrong PUKs destroy the SIM",
    ),
    Registration.SIM_MISSING: (
        Verdict.FAIL,
        "sim-missing",
        "the unit detects no SIM",
        "switch it off, insert the SIM in the slot in use (contacts as shown in the unit's manual), switch it on",
    ),
    Registration.DENIED: (
        Verdict.FAIL,
        "registration-denied",
        "the network refuses the SIM",
        "ask the operator whether the SIM is active, paid, and allowed in this network and in this kind of device",
    ),
    Registration.SEARCHING: (
        Verdict.FAIL,
        "searching",
        "the unit is searching for a network",
        "wait two minutes; then check the antenna cables, the bands in the inventory and the operator's coverage here",
    ),
    Registration.DISABLED: (
        Verdict.FAIL,
        "disabled",
        "the unit's radio is switched off",
        "apply the site's configuration to enable it, or find out who disabled it",
    ),
    Registration.UNKNOWN: (
        Verdict.INCONCLUSIVE,
        "registration-unknown",
        "the unit reports an unknown registration state",
        "read the state on the unit's own page",
    ),
}


def _judge_registered(reading: LteReading, subscription: LteSubscription) -> Iterator[status.LinkFinding]:
    yield from _roaming(reading, subscription)
    yield from _apn(reading, subscription)
    yield from _address(reading, subscription)
    yield from _bands(reading, subscription)
    yield from _levels(reading)


def _is_roaming(reading: LteReading) -> bool:
    return reading.state is Registration.REGISTERED_ROAMING or reading.roaming is True


def _roaming(reading: LteReading, subscription: LteSubscription) -> Iterator[status.LinkFinding]:
    if not _is_roaming(reading):
        return
    where = reading.operator or reading.plmn or "a foreign network"
    if subscription.roaming:
        message = msg(f"the SIM roams in {arg(where)}: data may cost a multiple of the domestic price")
        yield status.LinkFinding(
            Verdict.WARN, "roaming-on", message, "check the price in the contract before a large transfer"
        )
    else:
        message = msg(f"the SIM is abroad in {arg(where)}, and roaming is not allowed: registered, but without data")
        hint = "use a SIM of this country, or set `sim.roaming: true` if the contract covers it"
        yield status.LinkFinding(Verdict.FAIL, "roaming-not-allowed", message, hint)


def _apn(reading: LteReading, subscription: LteSubscription) -> Iterator[status.LinkFinding]:
    if subscription.apn is None:
        hint = "set `sim.apn` as in the SIM's contract"
        if subscription.apn_required:
            message = "the inventory has a user or password of the subscription, but not its APN"
            yield status.LinkFinding(Verdict.FAIL, "apn-missing", message, hint)
        elif reading.apn is None and reading.address is None and not _is_roaming(reading):
            yield status.LinkFinding(
                Verdict.FAIL, "apn-missing", "no APN in the inventory, and the unit has none of its own", hint
            )
    elif reading.network_apn and reading.apn is None:
        message = msg(
            f"the unit uses the network's APN, so the one in the inventory, {arg(subscription.apn)}, may not be in use"
        )
        hint = "provision the site, which switches `use-network-apn` off"
        yield status.LinkFinding(Verdict.WARN, "apn-of-the-network", message, hint)
    elif reading.apn is not None and _bare(reading.apn) != _bare(subscription.apn):
        message = msg(f"the APN in use is {arg(reading.apn)}, the inventory has {arg(subscription.apn)}")
        hint = (
            "provision the site to set it; if it does not change, the network ignores the inventory's APN: ask "
            "the operator"
        )
        yield status.LinkFinding(Verdict.WARN, "apn-differs", message, hint)


def _bare(apn: str) -> str:
    """Return an APN in comparable form: without the operator part and in one case (3GPP TS 23.003, 9.1)."""
    return re.sub(r"\.mnc\d{3}\.mcc\d{3}\.gprs$", "", apn.casefold())


def _address(reading: LteReading, subscription: LteSubscription) -> Iterator[status.LinkFinding]:
    if reading.address is not None or reading.is_connected or (_is_roaming(reading) and not subscription.roaming):
        return
    message = "the unit is registered, but the network has assigned no address (or the unit does not report it)"
    hint = "check APN, user and password against the contract, and that the SIM has data left"
    yield status.LinkFinding(Verdict.FAIL, "no-address", message, hint)


def _bands(reading: LteReading, subscription: LteSubscription) -> Iterator[status.LinkFinding]:
    allowed_bands = [f"B{number}" for number in subscription.bands]
    if (
        allowed_bands
        and reading.band is not None
        and reading.band.startswith("B")
        and reading.band not in allowed_bands
    ):
        message = msg(
            f"the band in use is {arg(reading.band)}, but the inventory allows {arg(join(', ', allowed_bands))}"
        )
        yield status.LinkFinding(Verdict.WARN, "band-differs", message, "provision the site to set the bands")


def _levels(reading: LteReading) -> Iterator[status.LinkFinding]:
    levels = (
        ("rsrp", "RSRP", reading.rsrp_dbm, WEAK_RSRP_DBM, "dBm"),
        ("rsrq", "RSRQ", reading.rsrq_db, WEAK_RSRQ_DB, "dB"),
        ("sinr", "SINR", reading.sinr_db, WEAK_SINR_DB, "dB"),
    )
    for code, name, value, limit, unit in levels:
        if value is not None and value < limit:
            message = msg(f"{arg(name)} is {arg(value):g} {arg(unit)}, below {arg(limit):g} {arg(unit)}")
            yield status.LinkFinding(Verdict.WARN, f"weak-{code}", message, _WEAK[code])


_WEAK = {
    "rsrp": "move the antenna higher or into sight of the mast, and check its cables",
    "rsrq": "the cell is loaded or disturbed: turn the antenna, or restrict the unit to another band",
    "sinr": "interference: turn the antenna away from other transmitters, or change the band",
}
