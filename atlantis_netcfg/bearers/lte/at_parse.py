"""What a modem's answers mean (3GPP TS 27.007; the figures of `+CESQ` after libmbim, devices.md section 4).

99 and 255 are "not known" and give None. An answer to a read of a registration has the mode before the state, an
unsolicited line of the same name has not; a line of another name never counts.
"""

from __future__ import annotations

import csv
import re
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers.lte.record import LteReading, Registration

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.bearers.lte.at import Answer

__all__ = ["reading_of"]

_STATES = {
    0: Registration.SEARCHING,
    1: Registration.REGISTERED_HOME,
    2: Registration.SEARCHING,
    3: Registration.DENIED,
    4: Registration.UNKNOWN,
    5: Registration.REGISTERED_ROAMING,
    6: Registration.REGISTERED_HOME,
    7: Registration.REGISTERED_ROAMING,
    8: Registration.SEARCHING,
    9: Registration.REGISTERED_HOME,
    10: Registration.REGISTERED_ROAMING,
}
"""`<stat>`, 7.2, 10.1.20 and 10.1.22. 0, "not searching either", and 8, "emergency only", have no word of their own."""
_REGISTERED = (Registration.REGISTERED_HOME, Registration.REGISTERED_ROAMING)
_CME = {
    10: Registration.SIM_MISSING,
    11: Registration.SIM_PIN_REQUIRED,
    12: Registration.SIM_PUK_REQUIRED,
    13: Registration.SIM_MISSING,
    15: Registration.SIM_MISSING,
    16: Registration.SIM_PIN_REQUIRED,
}
"""9.2: 10 not inserted, 11 PIN, 12 PUK, 13 failure, 15 wrong, 16 incorrect password; 14 is busy and says nothing."""
_CME_WORDS = (
    ("not inserted", 10),
    ("puk required", 12),
    ("pin required", 11),
    ("incorrect password", 16),
    ("failure", 13),
)
_TECHNOLOGIES = {0: "gsm", 1: "gsm", 3: "gsm", 2: "umts", 4: "umts", 5: "umts", 6: "umts", 7: "lte", 9: "nb-iot"}
_TECHNOLOGIES |= {10: "lte", 11: "5g", 12: "5g", 13: "lte"}
"""`<AcT>`, 7.3."""


def reading_of(answers: Mapping[str, Answer]) -> LteReading:
    """Put the answers to the reads into one record; a read that the modem does not know leaves its figures None."""
    card, refused, card_words = _card(answers)
    network, network_words = _network(answers)
    off = _first(answers, "AT+CFUN?")
    switched_off = bool(off) and off[0] in ("0", "4")
    state = card or (Registration.DISABLED if switched_off else network)
    operator, plmn, technology = _operator(answers)
    extra_plmn, band = _vendor(answers)
    registered = state in _REGISTERED
    rsrp, rsrq = _extended(answers)
    return LteReading(
        source="at",
        state=state,
        access_tech=technology,
        operator=operator,
        plmn=plmn or extra_plmn,
        band=band,
        rsrp_dbm=rsrp,
        rsrq_db=rsrq,
        rssi_dbm=_strength(answers),
        roaming=state is Registration.REGISTERED_ROAMING if registered else None,
        address=_address(answers),
        apn=_apn(answers),
        pin_refused=refused,
        last_error=None if registered else (card_words or network_words),
    )


def _rows(answers: Mapping[str, Answer], command: str) -> list[list[str]]:
    """The fields of the lines that begin with the command's own name."""
    answer = answers.get(command)
    if answer is None or not answer.ok:
        return []
    name = command.removeprefix("AT").rstrip("?")
    bodies = (line.removeprefix(f"{name}:") for line in answer.lines if line.startswith(f"{name}:"))
    return [[each.strip() for each in row] for body in bodies for row in csv.reader([body.strip()])]


def _first(answers: Mapping[str, Answer], command: str) -> list[str]:
    return next(iter(_rows(answers, command)), [])


def _whole(text: str) -> int | None:
    return int(text) if re.fullmatch(r"-?\d{1,6}", text) else None


def _card(answers: Mapping[str, Answer]) -> tuple[Registration | None, bool | None, str | None]:
    """What stands between card and network, whether a PIN was refused, in which words."""
    answer = answers.get("AT+CPIN?")
    if answer is None:
        return None, None, None
    if not answer.ok:
        code = _cme(answer.final)
        refused = True if code in (12, 16) else None
        return _CME.get(code or 0), refused, answer.final
    words = next(iter(_first(answers, "AT+CPIN?")), "").upper()
    if words == "SIM PIN":
        return Registration.SIM_PIN_REQUIRED, None, words
    if words == "SIM PUK":
        return Registration.SIM_PUK_REQUIRED, True, words
    return None, None, None if words == "READY" else words or None


def _cme(final: str) -> int | None:
    """The number of `+CME ERROR: 10`, or of the same in words."""
    if not final.startswith("+CME ERROR"):
        return None
    cause = final.partition(":")[2].strip()
    if (number := _whole(cause)) is not None:
        return number
    return next((code for words, code in _CME_WORDS if words in cause.lower()), None)


def _network(answers: Mapping[str, Answer]) -> tuple[Registration, str | None]:
    """Data first: EPS, then packet; the circuit-switched state only where neither is known to the modem."""
    data = [found for command in ("AT+CEREG?", "AT+CGREG?") if (found := _stat(answers, command)) is not None]
    stats = data or [found for found in (_stat(answers, "AT+CREG?"),) if found is not None]
    states = [_STATES.get(stat, Registration.UNKNOWN) for stat in stats]
    ranked = (*_REGISTERED, Registration.DENIED, Registration.SEARCHING)
    state = next((each for each in ranked if each in states), Registration.UNKNOWN)
    idle = state is Registration.SEARCHING and set(stats) <= {0}
    return state, "not registered, and not searching" if idle else None


def _stat(answers: Mapping[str, Answer], command: str) -> int | None:
    for row in _rows(answers, command):
        raw = row[1] if len(row) > 1 else ""
        if _whole(row[0]) is not None and re.fullmatch(r"\d{1,2}", raw):
            return int(raw)
    return None


def _operator(answers: Mapping[str, Answer]) -> tuple[str | None, str | None, str | None]:
    """Name, code, technology: the name is a code where somebody has chosen the numeric format."""
    row = _first(answers, "AT+COPS?")
    name = row[2] if len(row) > 2 and row[2] else None  # noqa: PLR2004 - mode, format, operator, technology
    code = _whole(row[3]) if len(row) > 3 else None  # noqa: PLR2004 - as above
    technology = None if code is None else _TECHNOLOGIES.get(code)
    if name is not None and re.fullmatch(r"\d{5,6}", name):
        return None, name, technology
    return name, None, technology


def _strength(answers: Mapping[str, Answer]) -> float | None:
    value = _whole(next(iter(_first(answers, "AT+CSQ")), ""))
    return -113.0 + 2 * value if value is not None and 0 <= value <= 31 else None  # noqa: PLR2004 - 8.5


def _extended(answers: Mapping[str, Answer]) -> tuple[float | None, float | None]:
    """RSRP in dBm and RSRQ in dB."""
    row = _first(answers, "AT+CESQ")
    if len(row) < 6:  # noqa: PLR2004 - rxlev, ber, rscp, ecno, rsrq, rsrp
        return None, None
    quality, power = _whole(row[4]), _whole(row[5])
    rsrp = -140.0 + power if power is not None and 0 <= power <= 97 else None  # noqa: PLR2004 - 8.69
    rsrq = -19.5 + quality / 2 if quality is not None and 0 <= quality <= 34 else None  # noqa: PLR2004 - 8.69
    return rsrp, rsrq


def _active(answers: Mapping[str, Answer]) -> str | None:
    """The context that is active; None if none is, or the modem does not say."""
    return next((row[0] for row in _rows(answers, "AT+CGACT?") if len(row) > 1 and row[1] == "1"), None)


def _apn(answers: Mapping[str, Answer]) -> str | None:
    """In use, as the network has it; else as the active context, or the only one, is defined."""
    active = _active(answers)
    for row in _rows(answers, "AT+CGCONTRDP"):
        if len(row) > 2 and row[0] == (active or row[0]) and row[2]:  # noqa: PLR2004 - cid, bearer, apn
            return re.sub(r"\.mnc\d+\.mcc\d+\.gprs$", "", row[2], flags=re.IGNORECASE)
    defined = [row for row in _rows(answers, "AT+CGDCONT?") if len(row) > 2]  # noqa: PLR2004 - cid, type, apn
    chosen = [row for row in defined if row[0] == active] if active is not None else defined[:1]
    return next((row[2] for row in chosen if row[2]), None)


def _address(answers: Mapping[str, Answer]) -> str | None:
    active = _active(answers)
    for row in _rows(answers, "AT+CGPADDR"):
        if len(row) > 1 and row[0] == (active or row[0]):
            match = re.fullmatch(r"(\d{1,3}(?:\.\d{1,3}){3})", row[1])
            if match is not None and match[1] != "0.0.0.0":  # noqa: S104 - no address yet
                return match[1]
    return None


def _vendor(answers: Mapping[str, Answer]) -> tuple[str | None, str | None]:
    """Code and band of `+QNWINFO: "FDD LTE","26803","LTE BAND 3",1300` (Quectel)."""
    row = _first(answers, "AT+QNWINFO")
    if len(row) < 3:  # noqa: PLR2004 - technology, operator, band, channel
        return None, None
    band = re.fullmatch(r"(?:LTE BAND (\d+)|NR5G BAND (\d+))", row[2])
    code = row[1] if re.fullmatch(r"\d{5,6}", row[1]) else None
    if band is None:
        return code, None
    return code, f"B{band[1]}" if band[1] else f"n{band[2]}"
