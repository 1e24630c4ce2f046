"""What ModemManager's properties mean (its D-Bus API, "Flags and Enumerations"); IMEI and IMSI stay behind."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.bearers.lte.record import LteReading, Registration

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["MODEM", "MODEM_3GPP", "SIGNAL", "reading_of", "signal_is_set_up"]

MODEM = "org.freedesktop.ModemManager1.Modem"
MODEM_3GPP = f"{MODEM}.Modem3gpp"
SIGNAL = f"{MODEM}.Signal"
_FAILED, _LOCKED, _DISABLED, _ENABLED, _SEARCHING, _REGISTERED = -1, 2, 3, 6, 7, 8
"""MMModemState: from `registered` on it is in a network; between disabled and enabled it is on its way."""
_SIM_REASONS = {2: "sim-missing", 3: "sim-error"}
"""MMModemStateFailedReason."""
_LOCKS = {2: Registration.SIM_PIN_REQUIRED, 4: Registration.SIM_PUK_REQUIRED}
"""MMModemLock: sim-pin, sim-puk; the second PIN (3, 5) stands in nobody's way."""
_PIN_LOCK = 2
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
"""MMModem3gppRegistrationState; 0 is idle, 8 emergency calls only."""
_TECHNOLOGIES = (
    (1 << 15, "5g"),
    (1 << 14, "lte"),
    (1 << 16, "lte-m"),
    (1 << 17, "nb-iot"),
    (0x3E0, "umts"),
    (0x1E, "gsm"),
)
"""MMModemAccessTechnology, the best first."""
_IN_NETWORK = (Registration.REGISTERED_HOME, Registration.REGISTERED_ROAMING)
_LOWEST_DBM = -200.0
"""Below it a figure is a place-holder (MM_SIGNAL_UNKNOWN is the lowest number there is)."""


def reading_of(interfaces: Mapping[str, Mapping[str, Any]], bearers: Sequence[Mapping[str, Any]] = ()) -> LteReading:
    """Put a modem's properties and those of its bearers into one record."""
    modem, network = interfaces.get(MODEM, {}), interfaces.get(MODEM_3GPP, {})
    state, error = _state(modem, network)
    signal = _signal(interfaces.get(SIGNAL, {}))
    bearer = next((each for each in bearers if each.get("Connected") is True), {})
    registered = state in _IN_NETWORK
    retries = modem.get("UnlockRetries")
    left = retries.get(_PIN_LOCK) if isinstance(retries, dict) else None
    return LteReading(
        source="modemmanager",
        state=state,
        access_tech=_technology(modem.get("AccessTechnologies")),
        operator=_text(network.get("OperatorName")),
        plmn=_text(network.get("OperatorCode")),
        rsrp_dbm=signal.get("rsrp"),
        rsrq_db=signal.get("rsrq"),
        sinr_db=signal.get("snr"),
        rssi_dbm=signal.get("rssi"),
        roaming=_roaming(network) if registered else None,
        sim_slot=_slot(modem.get("PrimarySimSlot")),
        address=_text(_part(bearer, "Ip4Config").get("address")),
        apn=_text(_part(bearer, "Properties").get("apn")),
        pin_refused=True if state is Registration.SIM_PUK_REQUIRED else None,
        pin_tries_left=left if isinstance(left, int) else None,
        last_error=error,
    )


def signal_is_set_up(interfaces: Mapping[str, Mapping[str, Any]]) -> bool:
    """Whether somebody has told ModemManager to ask for signal figures: that is a setting, and not ours to make."""
    return bool(_signal(interfaces.get(SIGNAL, {}))) or bool(interfaces.get(SIGNAL, {}).get("Rate"))


def _state(modem: Mapping[str, Any], network: Mapping[str, Any]) -> tuple[Registration, str | None]:
    """Card first, then radio, then network.

    A ModemManager that does not tell the state of registration, but that the modem is registered, does not say in which
    network: that counts as home.
    """
    state = modem.get("State")
    if not isinstance(state, int):
        return Registration.UNKNOWN, None
    if state == _FAILED:
        reason = _SIM_REASONS.get(modem.get("StateFailedReason", 0))
        return (Registration.UNKNOWN, "failed") if reason is None else (Registration.SIM_MISSING, reason)
    if state == _LOCKED:
        return _LOCKS.get(modem.get("UnlockRequired", 0), Registration.UNKNOWN), "locked"
    if _DISABLED <= state < _ENABLED:
        return Registration.DISABLED, "disabled"
    return _network(state, network.get("RegistrationState"))


def _network(state: int, told: object) -> tuple[Registration, str | None]:
    if isinstance(told, int):
        return _STATES.get(told, Registration.UNKNOWN), "idle" if told == 0 else None
    if state >= _REGISTERED:
        return Registration.REGISTERED_HOME, None
    return Registration.SEARCHING if state == _SEARCHING else Registration.UNKNOWN, None


def _roaming(network: Mapping[str, Any]) -> bool | None:
    told = network.get("RegistrationState")
    return _STATES.get(told) is Registration.REGISTERED_ROAMING if isinstance(told, int) else None


def _signal(signal: Mapping[str, Any]) -> dict[str, float]:
    """The figures of the technology in use: LTE, else 5G."""
    for name in ("Lte", "Nr5g"):
        found = signal.get(name)
        if isinstance(found, dict):
            kept = {key: float(value) for key, value in found.items() if _is_figure(value)}
            if kept:
                return kept
    return {}


def _is_figure(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and value > _LOWEST_DBM


def _technology(mask: object) -> str | None:
    if not isinstance(mask, int):
        return None
    return next((name for bits, name in _TECHNOLOGIES if mask & bits), None)


def _text(value: object) -> str | None:
    return value if isinstance(value, str) and value else None


def _slot(value: object) -> int | None:
    return value if isinstance(value, int) and value > 0 else None


def _part(properties: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    found = properties.get(name)
    return found if isinstance(found, dict) else {}
