"""The unit's own interface: HTTPS with a self-signed certificate, the API of RutOS 7, and ubus over JSON-RPC.

Status codes and error texts of the API are [memory] of Teltonika's published description; a page that a firmware does
not have answers with HTTP 501 (devices.md, section 4: `sim_switch`).
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
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.rutos._modem import Modem
    from atlantis_netcfg.emulator.rutos._spec import RutosSpec


_LARGEST = 65536
_Reply = tuple[int, Any]


class Web:
    """Answers requests; `requests` is what was asked for, in order."""

    def __init__(self, spec: RutosSpec, modem: Modem) -> None:
        self._spec = spec
        self._modem = modem
        self._tokens: dict[str, float] = {}
        self._visits: dict[asyncio.Task[None], asyncio.StreamWriter] = {}
        self.requests: list[str] = []
        self.failed_logins = 0
        self.expire_after: int | None = None
        """Knob: after so many requests every token has run out, once."""

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """One connection, kept open between requests."""
        visit = asyncio.current_task()
        assert visit is not None  # noqa: S101 - asyncio's servers make one for each connection
        self._visits[visit] = writer
        try:
            with suppress(asyncio.IncompleteReadError, ConnectionError, asyncio.LimitOverrunError, ValueError):
                while await self._item(reader, writer):
                    pass
        finally:
            writer.close()
            with suppress(OSError):
                await writer.wait_closed()
            del self._visits[visit]

    async def hang_up(self) -> None:
        """Close every connection that is left."""
        visits = tuple(self._visits)
        for writer in self._visits.values():
            writer.transport.abort()
        await asyncio.gather(*visits, return_exceptions=True)

    async def _item(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bool:
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
            requested = json.loads(body) if body else None
        except ValueError:
            return HTTPStatus.BAD_REQUEST, _error(100, "Response not implemented", "api-core")
        if path == "/ubus" and method == "POST":
            return self._ubus(requested)
        if not self._spec.api or not path.startswith("/api/"):
            return HTTPStatus.NOT_FOUND, _error(101, "No such endpoint", "api-core")
        if path == "/api/login" and method == "POST":
            return self._login(requested)
        token = headers.get("authorization", "").removeprefix("Bearer ")
        if self._tokens.get(token, 0.0) < time.monotonic():
            return HTTPStatus.FORBIDDEN, _error(123, "Unauthorized access", "Authorization")
        return self._page(method, path)

    def _page(self, method: str, path: str) -> _Reply:
        pages: dict[str, Any] = {
            "/api/modems/status": lambda: [self._modem.status()],
            "/api/sim_cards/status": _slots,
            "/api/interfaces/basic/status": self._modem.interfaces,
            "/api/system/device/status": lambda: {"mnfinfo": {"serial": self._spec.serial_number}},
        }
        if path in self._spec.hidden:
            return HTTPStatus.FORBIDDEN, _error(122, "Insufficient permissions", "Authorization")
        if path in self._spec.missing or path.startswith("/api/sim_switch"):
            return HTTPStatus.NOT_IMPLEMENTED, _error(100, "Response not implemented", "api-core")
        if path not in pages:
            return HTTPStatus.NOT_FOUND, _error(101, "No such endpoint", "api-core")
        if method != "GET":
            return HTTPStatus.METHOD_NOT_ALLOWED, _error(102, "No action provided", "api-core")
        return HTTPStatus.OK, {"success": True, "data": pages[path]()}

    def _login(self, requested: Any) -> _Reply:  # noqa: ANN401 - JSON of any shape
        token = self._enter(requested)
        if token is None:
            return HTTPStatus.UNAUTHORIZED, _error(121, "Login failed for any reason", "Authorization")
        data = {"username": requested["username"], "group": "user", "token": token, "expires": int(self._spec.token_s)}
        return HTTPStatus.OK, {"success": True, "data": data}

    def _enter(self, requested: Any) -> str | None:  # noqa: ANN401 - JSON of any shape
        who = (requested.get("username"), requested.get("password")) if isinstance(requested, dict) else None
        if who != (self._spec.reader, self._spec.reader_password):
            self.failed_logins += 1
            return None
        token = secrets.token_hex(16)
        self._tokens[token] = time.monotonic() + self._spec.token_s
        return token

    def _ubus(self, requested: Any) -> _Reply:  # noqa: ANN401 - JSON of any shape
        parameters = (
            requested.get("params") if isinstance(requested, dict) and requested.get("method") == "call" else None
        )
        if not isinstance(parameters, list) or len(parameters) != 4:  # noqa: PLR2004 - session, object, method, arguments
            return HTTPStatus.OK, {"jsonrpc": "2.0", "id": 1, "error": {"code": -32600, "message": "Invalid request"}}
        session, target, method, arguments = parameters
        if (target, method) == ("session", "login"):
            token = self._enter(arguments)
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
    """Slots, not cards (devices.md, section 4)."""
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


class UciRefused(Exception):
    """`str()` is what uci prints on standard error."""


@dataclass(slots=True)
class Section:
    """A section: its type, its options, and the name under which `uci show` prints it."""

    shown: str
    kind: str
    options: dict[str, str] = field(default_factory=dict)


class Uci:
    """Packages with sections; changes lie beside them until they are committed."""

    def __init__(self, packages: dict[str, list[Section]]) -> None:
        self._saved = packages
        self._staged: dict[str, list[Section]] = _copy(packages)
        self.commits = 0

    def show(self, package: str) -> str:
        """As `uci show PACKAGE` prints it, with what is not committed yet. Raises UciRefused."""
        if package not in self._staged:
            raise UciRefused(NOT_FOUND)
        lines = []
        for section in self._staged[package]:
            lines.append(f"{package}.{section.shown}={section.kind}")
            lines += [f"{package}.{section.shown}.{name}={_quoted(value)}" for name, value in section.options.items()]
        return "".join(f"{line}\n" for line in lines)

    def saved(self, package: str, kind: str) -> list[dict[str, str]]:
        """Committed options of the sections of a type, as a service reads them."""
        return [dict(section.options) for section in self._saved.get(package, ()) if section.kind == kind]

    def batch(self, text: str) -> str:
        """Run the lines of `uci batch`; give what went to standard error."""
        reply = []
        for line in text.splitlines():
            if not line.strip():
                continue
            try:
                self._line(line)
            except UciRefused as refused:
                reply.append(str(refused))
        return "".join(f"{item}\n" for item in reply)

    def _line(self, line: str) -> None:
        try:
            words = shlex.split(line)
        except ValueError as error:
            raise UciRefused("uci: Parse error (unterminated quoted string)") from error
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
                raise UciRefused(NOT_FOUND)
            del section.options[option]
        else:
            raise UciRefused("Unknown command" if verb not in {"commit", "set", "delete"} else INVALID)

    def _find(self, name: str) -> tuple[Section, str]:
        match = _NAME.fullmatch(name)
        if match is None or match[3] is None:
            raise UciRefused(INVALID)
        package, shown, option = match.groups()
        found = next((section for section in self._staged.get(package, ()) if section.shown == shown), None)
        if found is None:
            raise UciRefused(NOT_FOUND)
        if option not in _OPTIONS.get(package, ()):
            raise UciRefused(INVALID)
        return found, option

    def _commit(self, package: str) -> None:
        if package not in self._staged:
            raise UciRefused(NOT_FOUND)
        self._saved[package] = _copy({package: self._staged[package]})[package]
        self.commits += 1


def factory(*, mobile: bool) -> Uci:
    """The sections of a unit with one modem and two slots, as they are before anybody has set anything."""
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


def _quoted(value: str) -> str:
    return "'" + value.replace("'", "'\\''") + "'"


def _copy(packages: dict[str, list[Section]]) -> dict[str, list[Section]]:
    return {
        name: [Section(section.shown, section.kind, dict(section.options)) for section in sections]
        for name, sections in packages.items()
    }
