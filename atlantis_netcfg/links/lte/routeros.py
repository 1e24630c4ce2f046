"""RouterOS' LTE interface: conversion of `monitor once` and related rows into the record of a 4G unit.

Both generations of fields are read: `status` with `data-class` and `primary-band` of version 7, and `pin-status`,
`registration-status`, `functionality` and `access-technology` of version 6 and of some modems (devices.md, section 4;
the names are those that the console of 7.21.5 offers for `monitor proplist`). Their values are written by the modem's
driver and are only partly documented: the interpretation of PIN, PUK and refusal follows 3GPP TS 27.007, 9.2.
Assumption: lte-pin-words

No device reports which APN the network gave in place of the configured one: with `use-network-apn=yes` the APN in use
is unknown. IMEI, IMSI, ICCID and the SIM's number are never copied.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from atlantis_netcfg.links import status
from atlantis_netcfg.links.lte.judge import LteReading, Registration

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    Row = Mapping[str, str]
    Rows = Sequence[Row]

IDENTITIES = frozenset({"imei", "imsi", "iccid", "uicc", "subscriber-number", "phone-number"})
"""Fields of a monitor that identify a person's SIM or a device; excluded from all reports and logs."""
_APN = ("name", "apn", "use-network-apn", "default")
_INTERFACE = ("name", "default-name", "disabled", "running", "inactive", "apn-profiles", "allow-roaming", "band")
_ADDRESS = ("address", "interface", "disabled", "invalid")
_RSRP_DBM, _RSRQ_DB, _SINR_DB, _RSSI_DBM = (-156.0, -31.0), (-43.0, 20.0), (-23.0, 40.0), (-125.0, -1.0)
"""Ranges that 3GPP TS 36.133 and 38.133 can report; a modem cannot have measured a value outside of them."""


def queries(interface: str = "lte1") -> tuple[status.Query, status.Query, status.Query, status.Query]:
    """Return the queries for a version 7 device, in the order of the first four arguments of `read`.

    `monitor` accepts no list of properties before 7.21, so the SIM's numbers are transferred; `read` drops them.
    """
    return (
        monitor_query(interface),
        status.Query("/interface/lte", "print", proplist=_INTERFACE),
        status.Query("/interface/lte/apn", "print", proplist=_APN),
        status.Query("/ip/address", "print", proplist=_ADDRESS),
    )


def monitor_query(name: str) -> status.Query:
    """Return the query for the state of the modem that currently has this name."""
    return status.Query("/interface/lte", "monitor", (("numbers", name), ("once", "")))


def modem_name(interfaces: Rows | None, modem: str = "lte1") -> str:
    """Return a modem's current name; it is identified by its default name, by `name` only if no row has that."""
    return _modem(interfaces, modem).get("name", modem)


def _modem(interfaces: Rows | None, modem: str) -> Row:
    matches = (row for field in ("default-name", "name") for row in interfaces or () if row.get(field) == modem)
    return next(matches, {})


def log_query() -> status.Query:
    """Return the query for the log, which shows a missing SIM if the monitor does not; large: use it only then."""
    return status.Query("/log", "print", proplist=("topics", "message"))


def redact(row: Row) -> dict[str, str]:
    """Return a monitor row without identifiers of the SIM or the device."""
    return {name: value for name, value in row.items() if name not in IDENTITIES}


def read(  # noqa: PLR0913, PLR0917 - one argument for each answer
    monitor: Row | None,
    interfaces: Rows | None = None,
    profiles: Rows | None = None,
    addresses: Rows | None = None,
    log: Rows | None = None,
    interface: str = "lte1",
) -> LteReading:
    """Build the reading from the query results; None means that a query was refused or not answered.

    `interface` is the modem's default name; its address and its log lines use its current name.
    """
    monitor_row = {name: value for name, value in redact(monitor or {}).items() if _known_text(value)}
    its_row = _modem(interfaces, interface)
    name = its_row.get("name", interface)
    error, from_log = _from_log(log or (), name)
    state = _state(monitor_row, its_row)
    if state is Registration.UNKNOWN and from_log is not None:
        state = from_log
    profile = _profile(its_row, profiles or ())
    operator = _known_text(monitor_row.get("current-operator"))
    return LteReading(
        source="routeros",
        state=state,
        access_tech=_technology(monitor_row),
        operator=None if operator is not None and operator.isdecimal() else operator,
        plmn=operator if operator is not None and operator.isdecimal() else None,
        band=_band(monitor_row),
        cell=_known_text(monitor_row.get("current-cellid")),
        rsrp_dbm=_level(monitor_row, "rsrp", _RSRP_DBM, "dBm"),
        rsrq_db=_level(monitor_row, "rsrq", _RSRQ_DB, "dB"),
        sinr_db=_level(monitor_row, "sinr", _SINR_DB, "dB"),
        rssi_dbm=status.decibels(monitor_row.get("rssi"), *_RSSI_DBM),
        roaming=_is_roaming(monitor_row),
        address=_address(addresses or (), name),
        apn=_apn_in_use(profile),
        network_apn=status.yes(profile.get("use-network-apn")),
        pin_refused=True if _WRONG_PIN.search(monitor_row.get("pin-status", "").lower()) else None,
        last_error=error,
    )


def _known_text(text: str | None) -> str | None:
    word = (text or "").strip()
    return None if word.lower() in {"", "n/a", "unknown", "none"} else word


_PUK = re.compile(r"\bpuk2?\b")
_NO_SIM = re.compile(r"\bno sim\b|not inserted|not present|\bsim (?:card )?(?:missing|absent|failure)")
_PIN_FREE = re.compile(r"\bno password\b|\bnot required\b|\bok\b|\bready\b|\bdisabled\b|\bunlocked\b")
_WRONG_PIN = re.compile(r"\bwrong\b|\bincorrect\b|\binvalid\b|\brejected\b")
_PIN = re.compile(r"\bpin\b|\bpassword\b|\blocked\b")
_RADIO_OFF = re.compile(r"\bminimum\b|\bminimal\b|\bflight|\bairplane\b|\bradio off\b|\bdisabled?\b|\boffline\b")
_REGISTRATIONS = (
    (re.compile(r"\bdenied\b|\brejected\b|\bforbidden\b"), Registration.DENIED),
    (re.compile(r"\bsearching\b|\bnot registered\b|\bunregistered\b|\binitiali[sz]ing\b"), Registration.SEARCHING),
    (re.compile(r"\broaming\b"), Registration.REGISTERED_ROAMING),
    (re.compile(r"\bregistered\b|\bconnected\b|\bconnecting\b|\bcall in progress\b"), Registration.REGISTERED_HOME),
)
"""Negatives first: `not registered` contains `registered`, and `denied` may occur with either."""


def _state(monitor_row: Row, its_row: Row) -> Registration:
    if status.yes(its_row.get("disabled")):
        return Registration.DISABLED
    words = [monitor_row.get(name, "").lower() for name in ("registration-status", "status")]
    card = _card(monitor_row.get("pin-status", "").lower(), words)
    if card is not None:
        return card
    if _RADIO_OFF.search(monitor_row.get("functionality", "").lower()):
        return Registration.DISABLED
    registration = next((state for word in words if (state := _registration(word)) is not None), Registration.UNKNOWN)
    roams = registration is Registration.REGISTERED_HOME and status.yes(monitor_row.get("roaming"))
    return Registration.REGISTERED_ROAMING if roams else registration


def _card(pin: str, others: list[str]) -> Registration | None:
    """Return the SIM state that prevents registration; None if there is none."""
    if any(_NO_SIM.search(word) for word in (pin, *others)):
        return Registration.SIM_MISSING
    if _PUK.search(pin):
        return Registration.SIM_PUK_REQUIRED
    is_wrong_pin = _WRONG_PIN.search(pin)
    if is_wrong_pin or (_PIN.search(pin) and not _PIN_FREE.search(pin)):
        return Registration.SIM_PIN_REQUIRED
    return None


def _registration(word: str) -> Registration | None:
    return next((state for pattern, state in _REGISTRATIONS if pattern.search(word)), None)


def _is_roaming(monitor_row: Row) -> bool | None:
    roams = status.yes(monitor_row.get("roaming"))
    if roams is None and "roaming" in monitor_row.get("registration-status", "").lower():
        return True
    return roams


def _technology(monitor_row: Row) -> str | None:
    text = _known_text(monitor_row.get("data-class")) or _known_text(monitor_row.get("access-technology"))
    if text is None:
        return None
    inside = re.search(r"\(([^)]+)\)", text)
    return (inside[1] if inside is not None else text).lower()


def _band(monitor_row: Row) -> str | None:
    """Parse the band from `B3@20Mhz earfcn: 1300 …` or `1300 (band 3, bandwidth 20Mhz)`."""
    text = f"{monitor_row.get('primary-band', '')} {monitor_row.get('earfcn', '')}"
    match = re.search(r"\b([BbNn])(\d{1,3})@", text) or re.search(r"\b(b)and (\d{1,3})\b", text)
    return f"{match[1].upper()}{match[2]}" if match is not None else None


def _level(monitor_row: Row, name: str, bounds: tuple[float, float], unit: str) -> float | None:
    """Return an LTE level; a modem on 5G alone has only the `nr-` one."""
    lte = status.decibels(monitor_row.get(name), *bounds, unit=unit)
    return status.decibels(monitor_row.get(f"nr-{name}"), *bounds, unit=unit) if lte is None else lte


def _profile(its_row: Row, profiles: Rows) -> Row:
    name = its_row.get("apn-profiles", "").split(",")[0]
    return next((row for row in profiles if name and row.get("name") == name), {})


def _apn_in_use(profile: Row) -> str | None:
    """Return the APN requested; unknown (None) with `use-network-apn`, as the network's choice is not reported."""
    return None if status.yes(profile.get("use-network-apn")) is not False else _known_text(profile.get("apn"))


def _address(addresses: Rows, interface: str) -> str | None:
    live = [
        row["address"].partition("/")[0]
        for row in addresses
        if row.get("interface") == interface
        and row.get("address")
        and not status.yes(row.get("disabled"))
        and not status.yes(row.get("invalid"))
    ]
    return live[0] if live else None


_CME = {
    "10": Registration.SIM_MISSING,
    "11": Registration.SIM_PIN_REQUIRED,
    "12": Registration.SIM_PUK_REQUIRED,
    "16": Registration.SIM_PIN_REQUIRED,
}
"""3GPP TS 27.007, 9.2: SIM not inserted, SIM PIN required, SIM PUK required, incorrect password."""


def _from_log(log: Rows, interface: str) -> tuple[str | None, Registration | None]:
    """Return the modem's latest log line about the SIM and the registration state that it implies."""
    pattern = re.compile(rf"{re.escape(interface)}: rcvd (?:(\+CME ERROR: (\d+))|\+CPIN: (.*))")
    matches = [match for row in log if (match := pattern.search(row.get("message", "")))]
    if not matches:
        return None, None
    last = matches[-1]
    if last[1] is not None:
        return last[1], _CME.get(last[2])
    word = last[3].strip().upper()
    return None, {"SIM PIN": Registration.SIM_PIN_REQUIRED, "SIM PUK": Registration.SIM_PUK_REQUIRED}.get(word)
