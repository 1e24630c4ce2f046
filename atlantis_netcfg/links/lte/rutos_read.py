"""Read-only access to a RutOS unit over HTTPS with few requests, and the meaning of its fields."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.links.lte import rutos_client
from atlantis_netcfg.links.lte.judge import LteReading, Registration

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


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
    "cell": ("cellid", "cell_id"),
    "imei": ("imei",),
    "iccid": ("iccid",),
}
"""Possible field names of each value, newest first. Assumption: rutos-state-words. Assumption: rutos-levels."""

_SILENT = frozenset({"", "n/a", "na", "-", "--", "unknown", "null", "none", "no service"})
"""Texts that mean that there is no value."""
_PLAUSIBLE = {"rsrp": (-160.0, -20.0), "rsrq": (-45.0, 20.0), "sinr": (-40.0, 60.0), "rssi": (-140.0, -10.0)}
"""A value outside is a placeholder of the firmware; dBm or dB (3GPP TS 36.133, 9.1 with some margin)."""
_TRY = re.compile(r"(\d+)\s+attempt")


def text(record: Mapping[str, Any], what: str) -> str | None:
    """Return the first non-empty field among the names of `what`, as the unit spells it."""
    for name in NAMES[what]:
        value = record.get(name)
        if isinstance(value, str | int | float) and not isinstance(value, bool):
            words = str(value).strip()
            if words.lower() not in _SILENT:
                return words
    return None


def number(record: Mapping[str, Any], what: str) -> float | None:
    """Return a figure given as number, text or text with unit; None if it is not a number or not plausible."""
    words = text(record, what)
    match = re.fullmatch(r"\s*(-?\d+(?:\.\d+)?)\s*(?:dBm|dB)?\s*", words or "", re.IGNORECASE)
    if match is None:
        return None
    value = float(match[1])
    low, high = _PLAUSIBLE.get(what, (float("-inf"), float("inf")))
    return value if low <= value <= high else None


def sim(record: Mapping[str, Any]) -> tuple[Registration | None, bool | None, int | None]:
    """Return the SIM state that blocks registration, whether a PIN was refused, and the remaining PIN tries.

    Negative texts are tested first: "Not inserted" contains "inserted". A SIM that asks for a PIN is inserted.
    """
    words = [(text(record, name) or "").lower() for name in ("pin", "card")]
    stage = record.get("mobile_stage")
    tries = number(record, "tries")
    tries_text = next((match[1] for match in map(_TRY.search, words) if match), None)
    tries_left = int(tries_text) if tries_text is not None else (None if tries is None else int(tries))
    is_pin_refused = any(bad in words[0] for bad in ("wrong", "incorrect", "invalid")) or None
    if stage in (6, 7) or _is_code_required(words[0], "puk"):
        return Registration.SIM_PUK_REQUIRED, True, 0
    if stage == 5 or is_pin_refused or _is_code_required(words[0], "pin"):  # noqa: PLR2004 - "waiting for PIN to be entered"
        return Registration.SIM_PIN_REQUIRED, is_pin_refused, tries_left
    if any(_is_sim_absent(each) for each in words) or stage == 1:
        return Registration.SIM_MISSING, is_pin_refused, tries_left
    if stage == 23:  # noqa: PLR2004 - "flight mode enabled"
        return Registration.DISABLED, is_pin_refused, tries_left
    return None, is_pin_refused, tries_left


def _is_code_required(words: str, what: str) -> bool:
    if f"{what} not required" in words or f"no {what}" in words or "disabled" in words:
        return False
    return re.search(rf"\b{what}\b", words) is not None and not words.endswith((" ok", " ready"))


def _is_sim_absent(words: str) -> bool:
    return any(word in words for word in ("not inserted", "not present", "no sim", "absent", "missing", "sim failure"))


def registration(words: str | None) -> Registration:
    """Return the registration state.

    "Not registered" counts as searching: the record has no separate value for 3GPP's "not registered, not searching".
    "Registered" alone does not state the network, and counts as home.
    """
    if words is None:
        return Registration.UNKNOWN
    lower_words = words.lower()
    if "denied" in lower_words:
        return Registration.DENIED
    if "searching" in lower_words or "not registered" in lower_words or "unregistered" in lower_words:
        return Registration.SEARCHING
    if "roaming" in lower_words and "not roaming" not in lower_words:
        return Registration.REGISTERED_ROAMING
    if "registered" in lower_words or lower_words == "home":
        return Registration.REGISTERED_HOME
    return Registration.UNKNOWN


TECHNOLOGIES = {"5g": "5g", "nr": "5g", "lte": "lte", "4g": "lte", "wcdma": "umts", "hspa": "umts", "umts": "umts"}
TECHNOLOGIES |= {"3g": "umts", "gsm": "gsm", "edge": "gsm", "gprs": "gsm", "2g": "gsm"}


def technology(words: str | None) -> str | None:
    """Convert `4G (LTE)` to lte; an unknown text stays as it is, in lower case. Assumption: rutos-cell."""
    if words is None:
        return None
    lower_words = words.lower()
    return next((name for word, name in TECHNOLOGIES.items() if word in lower_words), lower_words)


def band(words: str | None) -> str | None:
    """Convert `LTE B3`, `LTE_B3` or `B3` to B3; `n78` stays as it is."""
    match = re.search(r"(?:\b|_)([bn])(\d{1,3})\b", words or "", re.IGNORECASE)
    if match is None:
        return None
    return f"B{match[2]}" if match[1].lower() == "b" else f"n{match[2]}"


def plmn(record: Mapping[str, Any]) -> str | None:
    """Return the PLMN (five or six digits), from its own field or from the serving cell."""
    words = text(record, "plmn")
    if words is not None and re.fullmatch(r"\d{5,6}", words):
        return words
    cells = record.get("cell_info")
    cell = cells[0] if isinstance(cells, list) and cells and isinstance(cells[0], dict) else {}
    code = f"{cell.get('mcc', '')}{cell.get('mnc', '')}"
    return code if re.fullmatch(r"\d{5,6}", code) else None


def cell(record: Mapping[str, Any]) -> str | None:
    """Return the serving cell's identity, from its own field or from `cell_info`. Assumption: rutos-cell."""
    cells = record.get("cell_info")
    first = cells[0] if isinstance(cells, list) and cells and isinstance(cells[0], dict) else {}
    return text(record, "cell") or text(first, "cell")


SOURCE = "rutos"
REGISTERED_STATES = (Registration.REGISTERED_HOME, Registration.REGISTERED_ROAMING)


def modem_of(rows: object) -> Mapping[str, Any] | None:
    """Return the modem that carries the link: the primary one, else the first; None if there is none."""
    modems = [row for row in (rows if isinstance(rows, list) else [rows]) if isinstance(row, dict)]
    return next(
        (row for row in modems if str(row.get("primary")).lower() in ("true", "1")), modems[0] if modems else None
    )


def reading_of(modem: Mapping[str, Any], interfaces: object = None, apn: str | None = None) -> LteReading:
    """Convert a unit's record to a reading; `interfaces` holds the interface status rows, for the address."""
    between, is_pin_refused, tries_left = sim(modem)
    registration_words = text(modem, "registration")
    state = between or registration(registration_words)
    slot = number(modem, "slot")
    is_registered = state in REGISTERED_STATES
    return LteReading(
        source=SOURCE,
        state=state,
        access_tech=technology(text(modem, "technology")),
        operator=text(modem, "operator"),
        plmn=plmn(modem),
        band=band(text(modem, "band")),
        cell=cell(modem),
        rsrp_dbm=number(modem, "rsrp"),
        rsrq_db=number(modem, "rsrq"),
        sinr_db=number(modem, "sinr"),
        rssi_dbm=number(modem, "rssi"),
        roaming=state is Registration.REGISTERED_ROAMING if is_registered else None,
        sim_slot=None if slot is None else int(slot),
        address=_address(interfaces),
        is_connected=is_connected(modem),
        apn=apn,
        pin_refused=is_pin_refused,
        pin_tries_left=tries_left,
        last_error=None if is_registered else _error(modem, registration_words),
    )


def is_connected(modem: Mapping[str, Any]) -> bool | None:
    """Return whether the unit reports an active data connection; `simstate` is about the SIM, not this."""
    words = (text(modem, "connection") or "").lower()
    if words.startswith(("disconnected", "not connected")):
        return False
    return True if words.startswith("connected") else None


def serial_of(status: object) -> str | None:
    """Return the serial number that identifies the unit (`mnfinfo.serial` of its status). Assumption: rutos-serial."""
    if not isinstance(status, dict):
        return None
    for part in (status.get("mnfinfo"), status):
        if isinstance(part, dict) and isinstance(part.get("serial"), str | int) and str(part["serial"]).strip():
            return str(part["serial"]).strip()
    return None


def _error(modem: Mapping[str, Any], registration: str | None) -> str | None:
    """Return the reason for not being connected, as the unit words it."""
    for words in (text(modem, "pin"), text(modem, "card"), registration):
        if words is not None and words.lower() not in ("inserted", "ok", "ready"):
            return words
    return None


def _address(interfaces: object) -> str | None:
    """Return the first IPv4 address of a mobile interface (`mob1s1a1`), from `ipaddrs`. Assumption: rutos-address."""
    rows = interfaces if isinstance(interfaces, list) else []
    for row in rows:
        if not isinstance(row, dict) or not _is_mobile(row):
            continue
        for address in _texts(row):
            if match := re.fullmatch(r"(\d+\.\d+\.\d+\.\d+)(?:/\d+)?", address.strip()):
                return match[1]
    return None


def _is_mobile(row: Mapping[str, Any]) -> bool:
    name = str(row.get("id") or row.get("name") or "")
    return row.get("network_type") == "mobile" or re.match(r"mob\d+s\d+a\d+", name) is not None


def _texts(row: Mapping[str, Any]) -> Sequence[str]:
    """Return addresses given as text, as a list of texts, or as a list of rows with `address`."""
    result: list[str] = []
    for name in ("ipaddrs", "ipv4-address", "ipv4_address", "ip", "ipaddr"):
        value = row.get(name)
        for item in value if isinstance(value, list) else [value]:
            each = item.get("address") if isinstance(item, dict) else item
            if isinstance(each, str):
                result.append(each)
    return result


INTERFACES, DEVICE = "/api/interfaces/basic/status", "/api/system/device/status"
READS = ("/api/modems/status", "/api/sim_cards/status", INTERFACES, DEVICE)
"""All pages that are requested after `POST /api/login`, each by GET."""
UBUS_READS = (("gsm.modem0", "get_signal_query"), ("gsm.modem0", "info"))
"""All ubus calls on older firmware after `session login`."""
_NOBODY = "0" * 32
"""Session identifier before login (OpenWrt, rpcd)."""
_FORBIDDEN = (401, 403)  # Assumption: rutos-refusals
_PERMISSION_DENIED = 6
"""UBUS_STATUS_PERMISSION_DENIED."""


@dataclass(frozen=True, slots=True)
class RutosLook:
    """The result of reading a unit once, with its cost in requests and bytes."""

    reading: LteReading
    serial: str | None = None
    """Serial number, which identifies the unit; None: this user may not read it, or the firmware does not report it."""
    slots: tuple[str, ...] = ()
    """Configuration sections of the SIM slots (not of the SIM cards), in their order."""
    requests: int = 0
    sent_bytes: int = 0
    received_bytes: int = 0
    identities: Mapping[str, str] = field(default_factory=dict, repr=False)
    """Unmasked `imei` and `iccid`, only for a record that masks them."""
    unread: tuple[str, ...] = ()
    """Pages that this user may not read or this firmware does not have."""


def identities_of(modem: Mapping[str, Any]) -> dict[str, str]:
    """Return the IMEI and ICCID, where the unit reports them."""
    identities = {name: text(modem, name) for name in ("imei", "iccid")}
    return {name: value for name, value in identities.items() if value is not None and value.strip("0")}


def read(endpoint: rutos_client.RutosEndpoint) -> RutosLook:
    """Log in, read, and close the connection.

    Raises RutosUnreachable, CertificateUnknown and CertificateMismatch (before the password is sent), RutosLoginError,
    RutosError.
    """
    wire = rutos_client.RutosWire(endpoint)
    try:
        session = _Rest(endpoint, wire)
        try:
            session.log_in()
        except rutos_client.PageMissing:
            return _by_ubus(endpoint, wire)
        return _read_by_rest(endpoint, wire, session)
    finally:
        wire.close()


def _read_by_rest(endpoint: rutos_client.RutosEndpoint, wire: rutos_client.RutosWire, session: _Rest) -> RutosLook:
    modems, *others = READS
    modem = modem_of(session.get(modems))
    if modem is None:
        raise rutos_client.RutosError(
            f"{arg(endpoint)}: the unit says that it has no modem",
            hint="switch it off and on; a modem that stays away is broken",
        )
    rows, interfaces, device = pages = [session.optional(each) for each in others]
    usage = (wire.requests, wire.sent, wire.received)
    unread = tuple(name for name, page in zip(others, pages, strict=True) if page is None)
    reading, serial = reading_of(modem, interfaces), serial_of(device)
    return RutosLook(reading, serial, _sections(rows), *usage, identities_of(modem), unread)


def _sections(rows: object) -> tuple[str, ...]:
    section_rows = [row for row in rows if isinstance(row, dict)] if isinstance(rows, list) else []
    return tuple(str(row["section_name"]) for row in section_rows if row.get("section_name"))


class _Rest:
    """A session of the RutOS 7 API: its token is renewed once when it has expired."""

    def __init__(self, endpoint: rutos_client.RutosEndpoint, wire: rutos_client.RutosWire) -> None:
        self._endpoint = endpoint
        self._wire = wire
        self._token: str | None = None

    def log_in(self) -> None:
        """Log in; raise RutosLoginError or PageMissing."""
        who = {"username": self._endpoint.user, "password": self._endpoint.password.reveal()}
        answer = self._wire.ask("POST", "/api/login", who)
        data = _data(answer.body)
        token = data.get("token") if isinstance(data, dict) else None
        if answer.status in _FORBIDDEN or (isinstance(answer.body, dict) and answer.body.get("success") is False):
            raise _login_error(self._endpoint)
        if not isinstance(token, str) or not token:
            raise rutos_client.RutosError(
                f"{arg(self._endpoint)}: the answer to the login is not one of RutOS (HTTP {arg(answer.status)})",
                hint="is this a Teltonika unit? Another make: `driver: manual`",
            )
        self._token = token

    def get(self, path: str) -> Any:  # noqa: ANN401 - JSON of any shape
        """Return the data of a page; raise RutosError if the unit refuses it."""
        answer = self._wire.ask("GET", path, token=self._token)
        if answer.status in _FORBIDDEN:
            self.log_in()
            answer = self._wire.ask("GET", path, token=self._token)
        is_success = isinstance(answer.body, dict) and answer.body.get("success") is True
        if answer.status in _FORBIDDEN or not is_success:
            raise rutos_client.RutosError(
                f"{arg(self._endpoint)}: the unit does not give {arg(path)} (HTTP {arg(answer.status)})",
                hint=f"user {arg(self._endpoint.user)} needs the right to read it: "
                "System > Administration > Access control",
            )
        return _data(answer.body)

    def optional(self, path: str) -> Any:  # noqa: ANN401 - JSON of any shape
        """Return the data of a page; None if this firmware or this user does not have it."""
        answer = None
        with suppress(rutos_client.PageMissing):
            answer = self._wire.ask("GET", path, token=self._token)
        return _data(answer.body) if answer is not None and answer.status not in _FORBIDDEN else None


def _data(body: object) -> Any:  # noqa: ANN401 - JSON of any shape
    return body.get("data") if isinstance(body, dict) else None


def _login_error(endpoint: rutos_client.RutosEndpoint) -> rutos_client.RutosLoginError:
    return rutos_client.RutosLoginError(
        msg(f"{arg(endpoint)}: the unit did not accept user {arg(endpoint.user)} and the declared password"),
        hint=msg("compare `access` in host_vars with the unit; after some wrong passwords RutOS blocks the address"),
    )


def _by_ubus(endpoint: rutos_client.RutosEndpoint, wire: rutos_client.RutosWire) -> RutosLook:
    """Read a unit whose firmware lacks the API, by JSON-RPC to ubus; its field names differ."""
    who = {"username": endpoint.user, "password": endpoint.password.reveal()}
    code, session = _call(endpoint, wire, _NOBODY, ("session", "login"), who)
    token = session.get("ubus_rpc_session")
    if code == _PERMISSION_DENIED or not isinstance(token, str):
        raise _login_error(endpoint)
    record: dict[str, Any] = {}
    for target in UBUS_READS:
        code, result = _call(endpoint, wire, token, target, {})
        if code:
            raise rutos_client.RutosError(
                f"{arg(endpoint)}: the unit does not give {arg(' '.join(target))} (ubus status {arg(code)})",
                hint=f"may user {arg(endpoint.user)} read it, and is there a modem in the unit?",
            )
        cache = result.get("cache")
        record |= result | (cache if isinstance(cache, dict) else {})
    usage = (wire.requests, wire.sent, wire.received)
    return RutosLook(reading_of(record), None, (), *usage, identities_of(record), READS[1:])


def _call(
    endpoint: rutos_client.RutosEndpoint,
    wire: rutos_client.RutosWire,
    session: str,
    target: tuple[str, str],
    arguments: dict[str, str],
) -> tuple[int, dict[str, Any]]:
    body = {"jsonrpc": "2.0", "id": 1, "method": "call", "params": [session, *target, arguments]}
    try:
        answer = wire.ask("POST", "/ubus", body)
    except rutos_client.PageMissing as error:
        raise rutos_client.RutosError(
            f"{arg(endpoint)}: neither the API of RutOS nor ubus answers here",
            hint="is this a Teltonika unit? Another make: `driver: manual`",
        ) from error
    result = answer.body.get("result") if isinstance(answer.body, dict) else None
    if not isinstance(result, list) or not result or not isinstance(result[0], int):
        wrong = answer.body.get("error") if isinstance(answer.body, dict) else None
        if isinstance(wrong, dict) and wrong.get("code") == -32002:  # noqa: PLR2004 - "Access denied" of uhttpd's JSON-RPC
            return _PERMISSION_DENIED, {}
        raise rutos_client.RutosError(
            f"{arg(endpoint)}: the answer to {arg(' '.join(target))} is not one of ubus (HTTP {arg(answer.status)})"
        )
    values = result[1] if len(result) > 1 else {}
    return result[0], values if isinstance(values, dict) else {}
