"""The unit's HTTPS interface: self-signed certificate, the API of RutOS 7, and ubus over JSON-RPC.

Status codes and error texts follow Teltonika's published description (Assumption: rutos-refusals); a page that a
firmware lacks returns HTTP 501 (devices.md, section 4: `sim_switch`).
"""

from __future__ import annotations

import asyncio
import json
import re
import secrets
import shlex
import time
from contextlib import suppress
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

_LARGEST = 65536
_Reply = tuple[int, Any]


class Web:
    """HTTP request handler; `requests` lists the received requests in order."""

    def __init__(self, spec: RutosSpec, modem: RutosModem) -> None:
        self._spec = spec
        self._modem = modem
        self._tokens: dict[str, float] = {}
        self._visits: dict[asyncio.Task[None], asyncio.StreamWriter] = {}
        self.requests: list[str] = []
        self.failed_logins = 0
        self.expire_after: int | None = None
        """Test setting: number of requests after which all tokens expire once; None: never."""

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one connection, which stays open between requests."""
        visit = asyncio.current_task()
        assert visit is not None  # noqa: S101 - asyncio's servers make one for each connection
        self._visits[visit] = writer
        try:
            with suppress(asyncio.IncompleteReadError, ConnectionError, asyncio.LimitOverrunError, ValueError):
                while await self._serve_request(reader, writer):
                    pass
        finally:
            writer.close()
            with suppress(OSError):
                await writer.wait_closed()
            del self._visits[visit]

    async def hang_up(self) -> None:
        """Close all remaining connections."""
        visits = tuple(self._visits)
        for writer in self._visits.values():
            writer.transport.abort()
        await asyncio.gather(*visits, return_exceptions=True)

    async def _serve_request(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bool:
        head = (await reader.readuntil(b"\r\n\r\n")).decode("latin-1")
        first, *lines = head.split("\r\n")
        method, path, _ = first.split(" ")
        headers = {name.lower(): value.strip() for name, _, value in (line.partition(":") for line in lines if line)}
        size = int(headers.get("content-length", "0"))
        if size > _LARGEST:
            return False
        body = await reader.readexactly(size)
        if self.expire_after is not None and len(self.requests) >= self.expire_after:
            self.expire_after = None
            self._tokens.clear()
        self.requests.append(f"{method} {path}")
        status, answer = self._answer(method, path, headers, body)
        text = json.dumps(answer).encode()
        phrase = HTTPStatus(status).phrase
        writer.write(
            f"HTTP/1.1 {status} {phrase}\r\nContent-Type: application/json\r\nContent-Length: {len(text)}\r\n"
            "Connection: keep-alive\r\n\r\n".encode()
            + text
        )
        await writer.drain()
        return True

    def _answer(self, method: str, path: str, headers: dict[str, str], body: bytes) -> _Reply:
        try:
            request = json.loads(body) if body else None
        except ValueError:
            return HTTPStatus.BAD_REQUEST, _error(100, "Response not implemented", "api-core")
        if path == "/ubus" and method == "POST":
            return self._ubus(request)
        if not self._spec.api or not path.startswith("/api/"):
            return HTTPStatus.NOT_FOUND, _error(101, "No such endpoint", "api-core")
        if path == "/api/login" and method == "POST":
            return self._login(request)
        token = headers.get("authorization", "").removeprefix("Bearer ")
        if self._tokens.get(token, 0.0) < time.monotonic():
            return HTTPStatus.FORBIDDEN, _error(123, "Unauthorized access", "Authorization")
        return self._get_resource(method, path)

    def _get_resource(self, method: str, path: str) -> _Reply:
        pages: dict[str, Any] = {
            "/api/modems/status": lambda: [self._modem.status()],
            "/api/sim_cards/status": _slots,
            "/api/interfaces/basic/status": self._modem.interfaces,
            "/api/system/device/status": lambda: {"mnfinfo": {"serial": self._spec.serial_number}},
        }
        if path in self._spec.hidden_pages:
            return HTTPStatus.FORBIDDEN, _error(122, "Insufficient permissions", "Authorization")
        if path in self._spec.missing or path.startswith("/api/sim_switch"):
            return HTTPStatus.NOT_IMPLEMENTED, _error(100, "Response not implemented", "api-core")
        if path not in pages:
            return HTTPStatus.NOT_FOUND, _error(101, "No such endpoint", "api-core")
        if method != "GET":
            return HTTPStatus.METHOD_NOT_ALLOWED, _error(102, "No action provided", "api-core")
        return HTTPStatus.OK, {"success": True, "data": pages[path]()}

    def _login(self, request: Any) -> _Reply:  # noqa: ANN401 - JSON of any shape
        token = self._issue_token(request)
        if token is None:
            return HTTPStatus.UNAUTHORIZED, _error(121, "Login failed for any reason", "Authorization")
        data = {"username": request["username"], "group": "user", "token": token, "expires": int(self._spec.token_s)}
        return HTTPStatus.OK, {"success": True, "data": data}

    def _issue_token(self, request: Any) -> str | None:  # noqa: ANN401 - JSON of any shape
        who = (request.get("username"), request.get("password")) if isinstance(request, dict) else None
        if who != (self._spec.reader, self._spec.reader_password):
            self.failed_logins += 1
            return None
        token = secrets.token_hex(16)
        self._tokens[token] = time.monotonic() + self._spec.token_s
        return token

    def _ubus(self, request: Any) -> _Reply:  # noqa: ANN401 - JSON of any shape
        parameters = request.get("params") if isinstance(request, dict) and request.get("method") == "call" else None
        if not isinstance(parameters, list) or len(parameters) != 4:  # noqa: PLR2004 - session, object, method, arguments
            return HTTPStatus.OK, {"jsonrpc": "2.0", "id": 1, "error": {"code": -32600, "message": "Invalid request"}}
        session, target, method, arguments = parameters
        if (target, method) == ("session", "login"):
            token = self._issue_token(arguments)
            return HTTPStatus.OK, _result(6) if token is None else _result(0, {"ubus_rpc_session": token})
        if self._tokens.get(str(session), 0.0) < time.monotonic():
            return HTTPStatus.OK, {"jsonrpc": "2.0", "id": 1, "error": {"code": -32002, "message": "Access denied"}}
        calls: dict[tuple[str, str], Any] = {
            ("gsm.modem0", "get_signal_query"): self._modem.signal,
            ("gsm.modem0", "info"): self._modem.info,
        }
        if (target, method) not in calls:
            return HTTPStatus.OK, _result(4)
        return HTTPStatus.OK, _result(0, calls[target, method]())


def _slots() -> list[dict[str, str]]:
    """Return the SIM slots, whether or not they hold cards (devices.md, section 4)."""
    return [
        {"sms_limit_enabled": "0", "modem": "1-1", "sim": str(slot), "section_name": f"cfg0{slot + 1}aa0e"}
        for slot in (1, 2)
    ]


def _result(code: int, data: Any = None) -> dict[str, Any]:  # noqa: ANN401 - JSON of any shape
    return {"jsonrpc": "2.0", "id": 1, "result": [code] if data is None else [code, data]}


def _error(code: int, words: str, source: str) -> dict[str, Any]:
    return {"success": False, "errors": [{"code": code, "error": words, "source": source}]}


_OPTIONS = {
    "network": frozenset(
        (
            *("proto", "modem", "sim", "apn", "auto_apn", "auth", "username", "password"),
            *("pdp", "pdptype", "dhcpv6", "metric", "delay", "mtu", "area_type"),
        )
    ),
    "simcard": frozenset(["modem", "position", "primary", "deny_roaming", "pincode", "volte", "service"]),
}
_NAME = re.compile(r"(\w+)\.(@\w+\[\d+\]|\w+)(?:\.(\w+))?")
NOT_FOUND = "uci: Entry not found"
INVALID = "uci: Invalid argument"


class UciError(Exception):
    """Error of uci; `str()` is its text on standard error."""


@dataclass(slots=True)
class Section:
    """A section: its type, its options, and the name under which `uci show` prints it."""

    name: str
    kind: str
    options: dict[str, str] = field(default_factory=dict)


class Uci:
    """Packages with sections; uncommitted changes are kept separately."""

    def __init__(self, packages: dict[str, list[Section]]) -> None:
        self._saved = packages
        self._staged: dict[str, list[Section]] = _copy(packages)
        self.commits = 0

    def show(self, package: str) -> str:
        """Return the output of `uci show PACKAGE`, uncommitted changes included. Raises UciError."""
        if package not in self._staged:
            raise UciError(NOT_FOUND)
        lines = []
        for section in self._staged[package]:
            lines.append(f"{package}.{section.name}={section.kind}")
            lines += [f"{package}.{section.name}.{name}={_quote(value)}" for name, value in section.options.items()]
        return "".join(f"{line}\n" for line in lines)

    def saved_sections(self, package: str, kind: str) -> list[dict[str, str]]:
        """Return the committed options of all sections of a type, as a service reads them."""
        return [dict(section.options) for section in self._saved.get(package, ()) if section.kind == kind]

    def batch(self, text: str) -> str:
        """Run the lines of `uci batch`; return the text on standard error."""
        reply = []
        for line in text.splitlines():
            if not line.strip():
                continue
            try:
                self._run_line(line)
            except UciError as refused:
                reply.append(str(refused))
        return "".join(f"{item}\n" for item in reply)

    def _run_line(self, line: str) -> None:
        try:
            words = shlex.split(line)
        except ValueError as error:
            raise UciError("uci: Parse error (unterminated quoted string)") from error
        verb, *rest = words
        if verb == "commit" and len(rest) == 1:
            self._commit(rest[0])
        elif verb == "set" and len(rest) == 1 and "=" in rest[0]:
            name, _, value = rest[0].partition("=")
            section, option = self._find(name)
            section.options[option] = value
        elif verb == "delete" and len(rest) == 1:
            section, option = self._find(rest[0])
            if option not in section.options:
                raise UciError(NOT_FOUND)
            del section.options[option]
        else:
            raise UciError("Unknown command" if verb not in {"commit", "set", "delete"} else INVALID)

    def _find(self, name: str) -> tuple[Section, str]:
        match = _NAME.fullmatch(name)
        if match is None or match[3] is None:
            raise UciError(INVALID)
        package, section_name, option = match.groups()
        target = next((section for section in self._staged.get(package, ()) if section.name == section_name), None)
        if target is None:
            raise UciError(NOT_FOUND)
        if option not in _OPTIONS.get(package, ()):
            raise UciError(INVALID)
        return target, option

    def _commit(self, package: str) -> None:
        if package not in self._staged:
            raise UciError(NOT_FOUND)
        self._saved[package] = _copy({package: self._staged[package]})[package]
        self.commits += 1


def factory(*, mobile: bool) -> Uci:
    """Return the factory sections of a unit, with one modem and two slots if `mobile`."""
    network = [
        Section("loopback", "interface", {"proto": "static"}),
        Section("lan", "interface", {"proto": "static", "area_type": "lan"}),
    ]
    if mobile:
        for slot in ("1", "2"):
            options = {"proto": "wwan", "modem": "1-1", "sim": slot, "pdp": "1", "auto_apn": "1", "auth": "none"}
            network.append(Section(f"mob1s{slot}a1", "interface", options))
    slots = [
        Section(
            f"@sim[{place}]",
            "sim",
            {"modem": "1-1", "position": str(place + 1)} | ({"primary": "1"} if not place else {}),
        )
        for place in range(2)
    ]
    return Uci({"network": network, "simcard": slots})


def _quote(value: str) -> str:
    return "'" + value.replace("'", "'\\''") + "'"


def _copy(packages: dict[str, list[Section]]) -> dict[str, list[Section]]:
    return {
        name: [Section(section.name, section.kind, dict(section.options)) for section in sections]
        for name, sections in packages.items()
    }


ADDRESS = "100.64.12.34"
"""Address assigned by the network, from the range of carrier-grade NAT (RFC 6598)."""
_NEW = {"state": "data_conn_state", "netstate": "operator_state", "oper": "operator", "signal": "rssi"}
"""Field names recorded in devices.md to those of newer firmware."""


class RutosModem:
    """SIM card, network, and the settings last read by the unit.

    The saved PIN is tried at every reload while the card requires one, which is the worst case for a caller
    (Assumption: rutos-pin). A foreign network with roaming denied leaves it registered (Assumption: rutos-settings).
    """

    def __init__(self, spec: RutosSpec, uci: Uci) -> None:
        self._spec = spec
        self._uci = uci
        self._tries = spec.sim.tries if spec.sim is not None else 0
        self._locked = spec.sim is not None and spec.sim.pin is not None
        self.attempts = 0
        """Number of PINs entered on the card."""
        self.settings: dict[str, str] = {}
        self.reload()

    def reload(self) -> None:
        """Read the committed settings, and try the saved PIN if the card requires one."""
        interface = next(
            (item for item in self._uci.saved_sections("network", "interface") if item.get("sim") == "1"), {}
        )
        slot = next((row for row in self._uci.saved_sections("simcard", "sim") if row.get("position") == "1"), {})
        self.settings = interface | slot
        sim = self._spec.sim
        saved_pin = slot.get("pincode")
        if sim is not None and self._locked and self._tries and saved_pin:
            self.attempts += 1
            if saved_pin == sim.pin:
                self._locked, self._tries = False, 3
            else:
                self._tries -= 1

    def set_network(self, network: RutosNetwork) -> None:
        """Change the surrounding network from now on."""
        self._spec = self._spec.model_copy(update={"network": network})

    @property
    def registration(self) -> str:
        """Registration state in the unit's wording."""
        spec = self._spec
        if spec.sim is None or self._locked or spec.network.silent:
            return "Searching"
        if spec.network.denies:
            return "Denied"
        return "Registered, home" if spec.network.plmn == spec.sim.home else "Roaming"

    @property
    def is_connected(self) -> bool:
        """Whether the data connection is up."""
        sim = self._spec.sim
        if sim is None or self.registration not in ("Registered, home", "Roaming"):
            return False
        if self.registration == "Roaming" and self.settings.get("deny_roaming", "0") != "0":
            return False
        automatic = sim.is_listed and self.settings.get("auto_apn", "1") == "1"
        return sim.apn is None or automatic or self.settings.get("apn") == sim.apn

    @property
    def pin_words(self) -> str:
        """Value of `pinstate`."""
        if self._spec.sim is None:
            return "SIM not inserted"
        if not self._locked:
            return "Inserted"
        return f"Required PIN, {self._tries} attempts left" if self._tries else "Required PUK, 10 attempts left"

    def status(self) -> dict[str, Any]:
        """Return a row of `/api/modems/status`."""
        spec = self._spec
        has_signal = self.registration in ("Registered, home", "Roaming")
        row: dict[str, Any] = {
            "pinstate": self.pin_words,
            "provider": spec.network.operator if has_signal else "N/A",
            "oper": spec.network.operator if has_signal else "N/A",
            "sinr": spec.network.sinr_db if has_signal else "N/A",
            "conntype": "4G (LTE)" if has_signal else "No service",
            "state": "Connected" if self.is_connected else "Disconnected",
            "imei": "000000000000000",
            "active_sim": 1,
            "imsi": "N/A",
            "sim_count": 2,
            "iccid": "N/A",
            "ntype": "LTE" if has_signal else "No service",
            "id": "1-1",
            "primary": True,
            "netstate": self.registration,
            "rsrq": spec.network.rsrq_db if has_signal else "N/A",
            "rsrp": spec.network.rsrp_dbm if has_signal else "N/A",
            "signal": spec.network.rsrp_dbm + 28 if has_signal else "N/A",
            "simstate": "Not inserted" if spec.sim is None else "Inserted",
        }
        if has_signal:
            row |= {
                "band": "LTE B3",
                "cellid": str(spec.network.cell_id),
                "cell_info": [{"mcc": spec.network.plmn[:3], "mnc": spec.network.plmn[3:]}],
            }
        if spec.sim is not None:
            row["pinleft"] = self._tries
        if spec.numbers_as_text:
            row = {name: str(value) if type(value) is int else value for name, value in row.items()}
        return row if spec.old_names else {_NEW.get(name, name): value for name, value in row.items()}

    def interfaces(self) -> list[dict[str, Any]]:
        """Return the rows of `/api/interfaces/basic/status`."""
        mobile = {"id": "mob1s1a1", "name": "mob1s1a1", "network_type": "mobile", "is_up": self.is_connected}
        lan = {"id": "lan", "name": "lan", "network_type": "wired", "is_up": True, "ipaddrs": ["192.168.1.1/24"]}
        return [lan, mobile | {"ipaddrs": [f"{ADDRESS}/32"] if self.is_connected else []}]

    def signal(self) -> dict[str, Any]:
        """Return the response to `ubus call gsm.modem0 get_signal_query`."""
        row = self.status()
        return {name: row[name] for name in ("rsrp", "rsrq", "sinr")} | {"rssi": row.get("signal", row.get("rssi"))}

    def info(self) -> dict[str, Any]:
        """Return the response to `ubus call gsm.modem0 info`."""
        row = self.status()
        cache = {
            "provider_name": row["provider"],
            "reg_stat_str": self.registration,
            "net_mode_str": row["ntype"],
            "band_str": row.get("band", "N/A").replace(" ", "_"),
            "pin_state_str": self.pin_words,
            "sim_state_str": row["simstate"],
        }
        return {"state": row.get("state", row.get("data_conn_state")), "cache": cache}


NOT_REHEARSED = (
    "Teltonika RutOS: the time its modem takes to register; its link, which here is neither slow nor metered",
)


class _Spec(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class RutosSim(_Spec):
    """The card in slot 1."""

    pin: str | None = None
    """PIN of the card; None: it requires none."""
    tries: int = Field(default=3, ge=0)
    home: str = "26803"
    """PLMN of its operator."""
    apn: str | None = None
    """The only APN of its subscription; None: any APN, or none, is accepted."""
    is_listed: bool = True
    """The unit's built-in operator list contains that APN, so that `auto_apn` finds it."""


class RutosNetwork(_Spec):
    """The surrounding mobile network."""

    plmn: str = "26803"
    operator: str = "EXAMPLE-OPERATOR"
    denies: bool = False
    silent: bool = False
    """There is no coverage."""
    cell_id: int = 3103242
    rsrp_dbm: int = -94
    rsrq_db: int = -9
    sinr_db: int = 11


class RutosSpec(_Spec):
    """One emulated Teltonika router."""

    name: str
    serial_number: str = "0000000000"
    reader: str = "reader"
    """Read-only user of the unit's own interface."""
    reader_password: str = ""
    admin: str = "root"
    """User that may log in over SSH."""
    admin_password: str = ""
    sim: RutosSim | None = RutosSim()
    """SIM card; None: the slot is empty."""
    network: RutosNetwork = RutosNetwork()
    api: bool = True
    """The unit has the API of RutOS 7; otherwise only `/ubus`."""
    old_names: bool = True
    """Field names as recorded in devices.md (`netstate`, `state`, `oper`, `signal`), not those of newer firmware."""
    numbers_as_text: bool = False
    hidden_pages: tuple[str, ...] = ()
    """Pages without permission for the reader: HTTP 403."""
    missing: tuple[str, ...] = ()
    """Pages missing in this firmware: HTTP 501."""
    token_s: float = Field(default=299.0, gt=0)
    """Lifetime of a token in seconds; `expires` in the login response."""
    mobile_section: bool = True
    """`/etc/config/network` has the interface `mob1s1a1`."""
