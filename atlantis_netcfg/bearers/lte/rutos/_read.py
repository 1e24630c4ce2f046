"""Read a RutOS unit: a handful of requests over one connection, none of which changes anything."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.bearers.lte.rutos._errors import NotOffered, RutosLoginFailed, RutosRefused
from atlantis_netcfg.bearers.lte.rutos._record import modem_of, reading_of, serial_of
from atlantis_netcfg.bearers.lte.rutos._wire import Wire

if TYPE_CHECKING:
    from atlantis_netcfg.bearers.lte.record import LteReading
    from atlantis_netcfg.bearers.lte.rutos._wire import RutosEndpoint

__all__ = ["READS", "UBUS_READS", "RutosLook", "read"]

READS = ("/api/modems/status", "/api/sim_cards/status", "/api/interfaces/basic/status", "/api/system/device/status")
"""All that is ever asked for after `POST /api/login`; each by GET."""
UBUS_READS = (("gsm.modem0", "get_signal_query"), ("gsm.modem0", "info"))
"""All that is ever called on older firmware after `session login`."""
_NOBODY = "0" * 32
"""The session of somebody who has not logged in (OpenWrt, rpcd)."""
_FORBIDDEN = (401, 403)
_DENIED = 6
"""UBUS_STATUS_PERMISSION_DENIED."""


@dataclass(frozen=True, slots=True)
class RutosLook:
    """What one look at a unit has given, and what it cost."""

    reading: LteReading
    serial: str | None = None
    """Identifies the unit; None: this user may not read it, or the firmware does not say."""
    slots: tuple[str, ...] = ()
    """Sections of the SIM slots, in their order: slots, not cards."""
    requests: int = 0
    sent: int = 0
    received: int = 0


def read(endpoint: RutosEndpoint) -> RutosLook:
    """Log in, read, and let go.

    Raises RutosUnreachable, CertificateUnknown and CertificateChanged (before the password is sent), RutosLoginFailed,
    RutosRefused.
    """
    wire = Wire(endpoint)
    try:
        session = _Rest(endpoint, wire)
        try:
            session.log_in()
        except NotOffered:
            return _by_ubus(endpoint, wire)
        return _by_rest(endpoint, wire, session)
    finally:
        wire.close()


def _by_rest(endpoint: RutosEndpoint, wire: Wire, session: _Rest) -> RutosLook:
    modems, slots, interfaces, device = READS
    modem = modem_of(session.get(modems))
    if modem is None:
        raise RutosRefused(
            f"{endpoint}: the unit says that it has no modem",
            hint="switch it off and on; a modem that stays away is broken",
        )
    rows = session.optional(slots)
    reading = reading_of(modem, session.optional(interfaces))
    serial = serial_of(session.optional(device))
    return RutosLook(reading, serial, _sections(rows), wire.requests, wire.sent, wire.received)


def _sections(rows: object) -> tuple[str, ...]:
    found = [row for row in rows if isinstance(row, dict)] if isinstance(rows, list) else []
    return tuple(str(row["section_name"]) for row in found if row.get("section_name"))


class _Rest:
    """The API of RutOS 7: a token, renewed once when it has run out."""

    def __init__(self, endpoint: RutosEndpoint, wire: Wire) -> None:
        self._endpoint = endpoint
        self._wire = wire
        self._token: str | None = None

    def log_in(self) -> None:
        """Raises RutosLoginFailed, NotOffered."""
        who = {"username": self._endpoint.user, "password": self._endpoint.password.reveal()}
        answer = self._wire.ask("POST", "/api/login", who)
        data = _data(answer.body)
        token = data.get("token") if isinstance(data, dict) else None
        if answer.status in _FORBIDDEN or (isinstance(answer.body, dict) and answer.body.get("success") is False):
            raise _not_let_in(self._endpoint)
        if not isinstance(token, str) or not token:
            raise RutosRefused(
                f"{self._endpoint}: the answer to the login is not one of RutOS (HTTP {answer.status})",
                hint="is this a Teltonika unit? Another make: `driver: manual`",
            )
        self._token = token

    def get(self, path: str) -> Any:  # noqa: ANN401 - JSON of any shape
        """Raises RutosRefused if the unit does not give it."""
        answer = self._wire.ask("GET", path, token=self._token)
        if answer.status in _FORBIDDEN:
            self.log_in()
            answer = self._wire.ask("GET", path, token=self._token)
        succeeded = isinstance(answer.body, dict) and answer.body.get("success") is True
        if answer.status in _FORBIDDEN or not succeeded:
            raise RutosRefused(
                f"{self._endpoint}: the unit does not give {path} (HTTP {answer.status})",
                hint=f"user {self._endpoint.user} needs the right to read it: System > Administration > Access control",
            )
        return _data(answer.body)

    def optional(self, path: str) -> Any:  # noqa: ANN401 - JSON of any shape
        """None where this firmware or this user has no such page: a reading does without."""
        answer = None
        with suppress(NotOffered):
            answer = self._wire.ask("GET", path, token=self._token)
        return _data(answer.body) if answer is not None and answer.status not in _FORBIDDEN else None


def _data(body: object) -> Any:  # noqa: ANN401 - JSON of any shape
    return body.get("data") if isinstance(body, dict) else None


def _not_let_in(endpoint: RutosEndpoint) -> RutosLoginFailed:
    return RutosLoginFailed(
        f"{endpoint}: the unit did not accept user {endpoint.user} and the declared password",
        hint="compare `access` in host_vars with the unit; after some wrong passwords RutOS blocks the address",
    )


def _by_ubus(endpoint: RutosEndpoint, wire: Wire) -> RutosLook:
    """Firmware without the API: JSON-RPC to ubus, whose field names differ again."""
    who = {"username": endpoint.user, "password": endpoint.password.reveal()}
    code, session = _call(endpoint, wire, _NOBODY, ("session", "login"), who)
    token = session.get("ubus_rpc_session")
    if code == _DENIED or not isinstance(token, str):
        raise _not_let_in(endpoint)
    merged: dict[str, Any] = {}
    for target in UBUS_READS:
        code, found = _call(endpoint, wire, token, target, {})
        if code:
            raise RutosRefused(
                f"{endpoint}: the unit does not give {' '.join(target)} (ubus status {code})",
                hint=f"may user {endpoint.user} read it, and is there a modem in the unit?",
            )
        cached = found.get("cache")
        merged |= found | (cached if isinstance(cached, dict) else {})
    return RutosLook(reading_of(merged), None, (), wire.requests, wire.sent, wire.received)


def _call(
    endpoint: RutosEndpoint, wire: Wire, session: str, target: tuple[str, str], arguments: dict[str, str]
) -> tuple[int, dict[str, Any]]:
    body = {"jsonrpc": "2.0", "id": 1, "method": "call", "params": [session, *target, arguments]}
    try:
        answer = wire.ask("POST", "/ubus", body)
    except NotOffered as error:
        raise RutosRefused(
            f"{endpoint}: neither the API of RutOS nor ubus answers here",
            hint="is this a Teltonika unit? Another make: `driver: manual`",
        ) from error
    result = answer.body.get("result") if isinstance(answer.body, dict) else None
    if not isinstance(result, list) or not result or not isinstance(result[0], int):
        wrong = answer.body.get("error") if isinstance(answer.body, dict) else None
        if isinstance(wrong, dict) and wrong.get("code") == -32002:  # noqa: PLR2004 - "Access denied" of uhttpd's JSON-RPC
            return _DENIED, {}
        raise RutosRefused(f"{endpoint}: the answer to {' '.join(target)} is not one of ubus (HTTP {answer.status})")
    found = result[1] if len(result) > 1 else {}
    return result[0], found if isinstance(found, dict) else {}
