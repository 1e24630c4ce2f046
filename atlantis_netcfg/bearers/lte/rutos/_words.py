"""The words of RutOS, as data: field names by generation, and what its states mean.

Sources: devices.md, section 4 (a real record of an empty slot; public client BILBY); the field names of newer firmware
(`data_conn_state`, `operator_state`, `operator`, `rssi`, `pinleft`, `mobile_stage`) and the words of `pinstate` and of
the operator's state are those of Teltonika's published API description as public clients repeat them. Names with
`_str` and `_value` are those of `ubus call gsm.modem0 info` [inferred].
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.bearers.lte.record import Registration

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["NAMES", "band", "number", "plmn", "registration", "sim", "technology", "text"]

NAMES: Mapping[str, tuple[str, ...]] = {
    "operator": ("operator", "oper", "provider", "provider_name", "operator_name"),
    "registration": ("operator_state", "netstate", "net_reg_stat", "reg_stat_str", "registration"),
    "connection": ("data_conn_state", "state", "conn_state"),
    "technology": ("conntype", "ntype", "net_mode_str", "net_mode", "network_type"),
    "band": ("band", "band_str", "b_str", "sc_band"),
    "rsrp": ("rsrp", "rsrp_value"),
    "rsrq": ("rsrq", "rsrq_value"),
    "sinr": ("sinr", "sinr_value"),
    "rssi": ("rssi", "signal", "rssi_value"),
    "card": ("simstate", "sim_state", "sim_state_str"),
    "pin": ("pinstate", "pin_state", "pin_state_str"),
    "tries": ("pinleft", "pin_left"),
    "slot": ("active_sim", "sim_slot"),
    "plmn": ("opernum", "operator_number", "plmn", "provider_number"),
}
"""What is asked for to the names under which it may stand, the newest first."""

_SILENT = frozenset({"", "n/a", "na", "-", "--", "unknown", "null", "none", "no service"})
"""Texts that say nothing."""
_PLAUSIBLE = {"rsrp": (-160.0, -20.0), "rsrq": (-45.0, 20.0), "sinr": (-40.0, 60.0), "rssi": (-140.0, -10.0)}
"""Beyond these a figure is a place-holder of the firmware, in dBm or dB (3GPP TS 36.133, 9.1 with some room)."""
_TRY = re.compile(r"(\d+)\s+attempt")


def text(record: Mapping[str, Any], what: str) -> str | None:
    """The first of the names of `what` that says something, in the unit's own words."""
    for name in NAMES[what]:
        value = record.get(name)
        if isinstance(value, str | int | float) and not isinstance(value, bool):
            words = str(value).strip()
            if words.lower() not in _SILENT:
                return words
    return None


def number(record: Mapping[str, Any], what: str) -> float | None:
    """A figure that may come as a number, as text, or as text with its unit; None if it is none, or cannot be true."""
    words = text(record, what)
    match = re.fullmatch(r"\s*(-?\d+(?:\.\d+)?)\s*(?:dBm|dB)?\s*", words or "", re.IGNORECASE)
    if match is None:
        return None
    value = float(match[1])
    low, high = _PLAUSIBLE.get(what, (float("-inf"), float("inf")))
    return value if low <= value <= high else None


def sim(record: Mapping[str, Any]) -> tuple[Registration | None, bool | None, int | None]:
    """What stands between card and network, if anything; whether a PIN was refused; PINs left to try.

    A negative word is looked for first: "Not inserted" holds "inserted". A card that asks for a PIN is a card.
    """
    words = [(text(record, name) or "").lower() for name in ("pin", "card")]
    stage = record.get("mobile_stage")
    tries = number(record, "tries")
    found = next((match[1] for match in map(_TRY.search, words) if match), None)
    left = int(found) if found is not None else (None if tries is None else int(tries))
    refused = any(bad in words[0] for bad in ("wrong", "incorrect", "invalid")) or None
    if stage in (6, 7) or _asks(words[0], "puk"):
        return Registration.SIM_PUK_REQUIRED, True, 0
    if stage == 5 or refused or _asks(words[0], "pin"):  # noqa: PLR2004 - "waiting for PIN to be entered"
        return Registration.SIM_PIN_REQUIRED, refused, left
    if any(_absent(each) for each in words) or stage == 1:
        return Registration.SIM_MISSING, refused, left
    if stage == 23:  # noqa: PLR2004 - "flight mode enabled"
        return Registration.DISABLED, refused, left
    return None, refused, left


def _asks(words: str, what: str) -> bool:
    if f"{what} not required" in words or f"no {what}" in words or "disabled" in words:
        return False
    return re.search(rf"\b{what}\b", words) is not None and not words.endswith((" ok", " ready"))


def _absent(words: str) -> bool:
    return any(word in words for word in ("not inserted", "not present", "no sim", "absent", "missing", "sim failure"))


def registration(words: str | None) -> Registration:
    """Where the unit is in the network.

    "Not registered" counts as searching: 3GPP's "not registered, not searching" has no word of its own in the record.
    "Registered" alone does not say in which network, and counts as home.
    """
    if words is None:
        return Registration.UNKNOWN
    said = words.lower()
    if "denied" in said:
        return Registration.DENIED
    if "searching" in said or "not registered" in said or "unregistered" in said:
        return Registration.SEARCHING
    if "roaming" in said and "not roaming" not in said:
        return Registration.REGISTERED_ROAMING
    if "registered" in said or said == "home":
        return Registration.REGISTERED_HOME
    return Registration.UNKNOWN


def technology(words: str | None) -> str | None:
    """`4G (LTE)` to lte; a word that nobody knows stays what it is, in lower case."""
    if words is None:
        return None
    said = words.lower()
    known = {"5g": "5g", "nr": "5g", "lte": "lte", "4g": "lte", "wcdma": "umts", "hspa": "umts", "umts": "umts"}
    known |= {"3g": "umts", "gsm": "gsm", "edge": "gsm", "gprs": "gsm", "2g": "gsm"}
    return next((name for word, name in known.items() if word in said), said)


def band(words: str | None) -> str | None:
    """`LTE B3`, `LTE_B3` or `B3` to B3; `n78` stays."""
    match = re.search(r"(?:\b|_)([bn])(\d{1,3})\b", words or "", re.IGNORECASE)
    if match is None:
        return None
    return f"B{match[2]}" if match[1].lower() == "b" else f"n{match[2]}"


def plmn(record: Mapping[str, Any]) -> str | None:
    """Five or six digits, from a field of its own or from the serving cell."""
    words = text(record, "plmn")
    if words is not None and re.fullmatch(r"\d{5,6}", words):
        return words
    cells = record.get("cell_info")
    cell = cells[0] if isinstance(cells, list) and cells and isinstance(cells[0], dict) else {}
    code = f"{cell.get('mcc', '')}{cell.get('mnc', '')}"
    return code if re.fullmatch(r"\d{5,6}", code) else None
