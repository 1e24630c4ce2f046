"""Read-only access over D-Bus to a modem that ModemManager owns."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

from jeepney import DBusAddress, HeaderFields, MessageFlag, MessageType, new_method_call
from jeepney.io.blocking import DBusConnection, open_dbus_connection

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.links.lte.judge import LteReading, Registration
from atlantis_netcfg.links.status import LinkFinding

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from types import TracebackType


SERVICE = "org.freedesktop.ModemManager1"
ROOT = "/org/freedesktop/ModemManager1"
TIMEOUT_S = 30.0
"""Timeout in seconds of a D-Bus call: the bus is local, but ModemManager may wait for its modem."""
SYSTEM_BUS = "unix:path=/run/dbus/system_bus_socket"

Objects = dict[str, dict[str, dict[str, Any]]]
"""Properties by object path and interface."""


class MmUnreachable(DeviceError):
    """The bus or ModemManager is missing or does not respond; nothing was changed."""


class Bus:
    """A connection to the D-Bus system bus; `with` opens and closes it."""

    def __init__(self, address: str | None = None, *, timeout_s: float = TIMEOUT_S) -> None:
        self._address = address or os.environ.get("DBUS_SYSTEM_BUS_ADDRESS") or SYSTEM_BUS
        self._timeout_s = timeout_s
        self._connection: DBusConnection | None = None
        self.calls = 0

    def __enter__(self) -> Self:
        try:
            self._connection = open_dbus_connection(self._address)
        except (OSError, ValueError, RuntimeError) as error:
            raise MmUnreachable(
                f"no D-Bus on this computer ({arg(type(error).__name__)})",
                hint="ModemManager needs a Linux computer with D-Bus; another unit needs another `driver`",
            ) from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._connection is not None:
            self._connection.close()

    def objects(self) -> Objects:
        """Return every modem with all its properties; raise MmUnreachable."""
        reply = self._call(ROOT, "org.freedesktop.DBus.ObjectManager", "GetManagedObjects")
        return {
            str(path): {str(name): {key: plain(value) for key, value in of.items()} for name, of in interfaces.items()}
            for path, interfaces in reply.items()
        }

    def properties(self, path: str, interface: str) -> dict[str, Any]:
        """Return all properties of one interface of an object; raise MmUnreachable."""
        reply = self._call(path, "org.freedesktop.DBus.Properties", "GetAll", "s", (interface,))
        return {name: plain(value) for name, value in reply.items()}

    def _call(self, path: str, interface: str, method: str, signature: str = "", body: tuple[str, ...] = ()) -> Any:  # noqa: ANN401 - D-Bus of any shape
        connection = self._connection
        assert connection is not None  # noqa: S101 - entered
        target = DBusAddress(path, bus_name=SERVICE, interface=interface)
        message = new_method_call(target, method, signature or None, body)
        message.header.flags |= MessageFlag.no_auto_start
        self.calls += 1
        try:
            reply = connection.send_and_get_reply(message, timeout=self._timeout_s)
        except (TimeoutError, OSError) as error:
            raise MmUnreachable(
                f"ModemManager did not respond within {arg(self._timeout_s):g} s ({arg(type(error).__name__)})",
                hint="check `systemctl status ModemManager`",
            ) from error
        if reply.header.message_type is MessageType.error:
            raise _refusal(str(reply.header.fields.get(HeaderFields.error_name, "")))
        return reply.body[0]


def _refusal(name: str) -> MmUnreachable:
    if name.endswith((".ServiceUnknown", ".NameHasNoOwner")):
        return MmUnreachable(
            "ModemManager is not running on this computer",
            hint="start it (`sudo systemctl start ModemManager`), or set the `driver` of the unit",
        )
    return MmUnreachable(
        f"ModemManager refused access ({arg(name.rpartition('.')[2] or 'no reason given')})",
        hint="this user may lack permission: try `mmcli -L` as the same user",
    )


def plain(value: Any) -> Any:  # noqa: ANN401 - D-Bus of any shape
    """Strip D-Bus variant signatures from a value, at any depth."""
    if isinstance(value, tuple) and len(value) == 2 and isinstance(value[0], str) and _is_signature(value[0]):  # noqa: PLR2004
        return plain(value[1])
    if isinstance(value, dict):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, list):
        return [plain(each) for each in value]
    return value


def _is_signature(text: str) -> bool:
    return 0 < len(text) < 20 and set(text) <= set("ybnqiuxtdsogvha(){}")  # noqa: PLR2004 - no property of ours is deeper


MODEM = "org.freedesktop.ModemManager1.Modem"
MODEM_3GPP = f"{MODEM}.Modem3gpp"
SIGNAL = f"{MODEM}.Signal"
_STATE_FAILED, _STATE_LOCKED, _STATE_DISABLED, _STATE_ENABLED, _SEARCHING, _STATE_REGISTERED = -1, 2, 3, 6, 7, 8
"""MMModemState: from `registered` on the modem is in a network; between disabled and enabled it is in transition."""
_SIM_REASONS = {2: "sim-missing", 3: "sim-error"}
"""MMModemStateFailedReason."""
_LOCKS = {2: Registration.SIM_PIN_REQUIRED, 4: Registration.SIM_PUK_REQUIRED}
"""MMModemLock: sim-pin, sim-puk. The second PIN (3, 5) does not prevent registration."""
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
"""MMModemAccessTechnology, best first."""
_IN_NETWORK = (Registration.REGISTERED_HOME, Registration.REGISTERED_ROAMING)
_LOWEST_DBM = -200.0
"""A value not above this is a placeholder (MM_SIGNAL_UNKNOWN is the lowest representable number)."""


def reading_of(interfaces: Mapping[str, Mapping[str, Any]], links: Sequence[Mapping[str, Any]] = ()) -> LteReading:
    """Combine a modem's properties and those of its bearers into one record."""
    modem, network = interfaces.get(MODEM, {}), interfaces.get(MODEM_3GPP, {})
    state, error = _state(modem, network)
    signal = _signal(interfaces.get(SIGNAL, {}))
    link = next((each for each in links if each.get("Connected") is True), {})
    is_registered = state in _IN_NETWORK
    retries = modem.get("UnlockRetries")
    tries_left = retries.get(_PIN_LOCK) if isinstance(retries, dict) else None
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
        roaming=_is_roaming(network) if is_registered else None,
        sim_slot=_slot(modem.get("PrimarySimSlot")),
        address=_text(_part(link, "Ip4Config").get("address")),
        apn=_text(_part(link, "Properties").get("apn")),
        pin_refused=True if state is Registration.SIM_PUK_REQUIRED else None,
        pin_tries_left=tries_left if isinstance(tries_left, int) else None,
        last_error=error,
    )


def signal_is_set_up(interfaces: Mapping[str, Mapping[str, Any]]) -> bool:
    """Return whether ModemManager polls signal values: this is a setting, which the toolkit does not change."""
    return bool(_signal(interfaces.get(SIGNAL, {}))) or bool(interfaces.get(SIGNAL, {}).get("Rate"))


def _state(modem: Mapping[str, Any], network: Mapping[str, Any]) -> tuple[Registration, str | None]:
    """Return the state of the SIM, then the radio, then the network, with the error text.

    If ModemManager reports that the modem is registered but not in which network, that counts as home.
    """
    state = modem.get("State")
    if not isinstance(state, int):
        return Registration.UNKNOWN, None
    if state == _STATE_FAILED:
        reason = _SIM_REASONS.get(modem.get("StateFailedReason", 0))
        return (Registration.UNKNOWN, "failed") if reason is None else (Registration.SIM_MISSING, reason)
    if state == _STATE_LOCKED:
        return _LOCKS.get(modem.get("UnlockRequired", 0), Registration.UNKNOWN), "locked"
    if _STATE_DISABLED <= state < _STATE_ENABLED:
        return Registration.DISABLED, "disabled"
    return _registration_state(state, network.get("RegistrationState"))


def _registration_state(state: int, registration: object) -> tuple[Registration, str | None]:
    if isinstance(registration, int):
        return _STATES.get(registration, Registration.UNKNOWN), "idle" if registration == 0 else None
    if state >= _STATE_REGISTERED:
        return Registration.REGISTERED_HOME, None
    return Registration.SEARCHING if state == _SEARCHING else Registration.UNKNOWN, None


def _is_roaming(network: Mapping[str, Any]) -> bool | None:
    registration = network.get("RegistrationState")
    return _STATES.get(registration) is Registration.REGISTERED_ROAMING if isinstance(registration, int) else None


def _signal(signal: Mapping[str, Any]) -> dict[str, float]:
    """Return the signal values of the technology in use: LTE, else 5G."""
    for name in ("Lte", "Nr5g"):
        values = signal.get(name)
        if isinstance(values, dict):
            figures = {key: float(value) for key, value in values.items() if _is_figure(value)}
            if figures:
                return figures
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
    part = properties.get(name)
    return part if isinstance(part, dict) else {}


_LINK = "org.freedesktop.ModemManager1.Bearer"

NO_SIGNAL = LinkFinding(
    Verdict.INCONCLUSIVE,
    "signal-not-set-up",
    "ModemManager reports no signal values because signal polling is off",
    "a check changes no settings: type `mmcli -m any --signal-setup=30` once, then check again",
)


@dataclass(frozen=True, slots=True)
class MmLook:
    """The result of reading ModemManager once."""

    reading: LteReading
    findings: tuple[LinkFinding, ...]
    """`NO_SIGNAL` if ModemManager is not configured to poll the signal, else empty."""
    calls: int


def read(address: str | None = None, *, timeout_s: float = TIMEOUT_S) -> MmLook:
    """Read the only modem of this computer; `address` is the bus (None: system bus). Raise MmUnreachable."""
    with Bus(address, timeout_s=timeout_s) as bus:
        modems = {path: properties for path, properties in bus.objects().items() if MODEM in properties}
        if len(modems) != 1:
            problem = msg(
                "no modem" if not modems else f"{arg(len(modems))} modems, and the inventory does not say which"
            )
            raise MmUnreachable(
                f"ModemManager has {arg(problem)}",
                hint="check `mmcli -L`: only the modem of this site must be plugged in",
            )
        (interfaces,) = modems.values()
        paths = interfaces[MODEM].get("Bearers") or []
        links = [bus.properties(str(path), _LINK) for path in paths]
        findings = () if signal_is_set_up(interfaces) else (NO_SIGNAL,)
        return MmLook(reading_of(interfaces, links), findings, bus.calls)
