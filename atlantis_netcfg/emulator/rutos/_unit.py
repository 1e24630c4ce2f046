"""The whole unit on loopback, with SSH and a small `uci` shell; in a thread for synchronous programs."""

from __future__ import annotations

import asyncio
import hashlib
import ssl
import threading
from concurrent.futures import Future
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any, Self

import asyncssh
from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding

from atlantis_netcfg.core.paths import write_private
from atlantis_netcfg.emulator.routeros.certificates import issue
from atlantis_netcfg.emulator.routeros.shell.ssh import fingerprint, host_key
from atlantis_netcfg.emulator.rutos import _web

if TYPE_CHECKING:
    from pathlib import Path
    from types import TracebackType


class Gate(asyncssh.SSHServer):
    """SSH authentication: one user, by password."""

    def __init__(self, spec: _web.RutosSpec, there: set[asyncssh.SSHServerConnection]) -> None:
        self._spec = spec
        self._there = there
        self._connection: asyncssh.SSHServerConnection | None = None

    def connection_made(self, conn: asyncssh.SSHServerConnection) -> None:
        """Register the connection."""
        self._connection = conn
        self._there.add(conn)

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - asyncssh's signature
        """Unregister the connection."""
        if self._connection is not None:
            self._there.discard(self._connection)

    def begin_auth(self, username: str) -> bool:  # noqa: ARG002 - asyncssh's signature
        """Require authentication."""
        return True

    def password_auth_supported(self) -> bool:
        """Allow authentication by password."""
        return True

    def validate_password(self, username: str, password: str) -> bool:
        """Accept only the administrator."""
        return (username, password) == (self._spec.admin, self._spec.admin_password)


class Shell:
    """Runs `uci show …`, `uci batch`, `uci export …` and `reload_config`, joined by `&&`."""

    def __init__(self, uci: _web.Uci, modem: _web.RutosModem) -> None:
        self._uci = uci
        self._modem = modem
        self.commands: list[str] = []
        self.reloads = 0
        self.mute = False
        """Test setting: batches are accepted and discarded, as by a unit with a read-only flash."""
        self.drops_on_reload = False
        """Test setting: the session is lost while the network reloads."""

    async def serve(self, process: asyncssh.SSHServerProcess[str]) -> None:
        """Run one command."""
        command = process.command or ""
        self.commands.append(command)
        batch = await process.stdin.read() if command == "uci batch" else ""
        code = 0
        for part in command.split("&&"):
            out, error, code = self._run(part.split(), batch)
            process.stdout.write(out)
            process.stderr.write(error)
            if code:
                break
        if command == "reload_config" and self.drops_on_reload:
            process.channel.get_connection().abort()
            return
        process.exit(code)

    def _run(self, words: list[str], batch: str) -> tuple[str, str, int]:
        match words:
            case ["uci", "show", package]:
                try:
                    return self._uci.show(package), "", 0
                except _web.UciError as refused:
                    return "", f"{refused}\n", 1
            case ["uci", "batch"]:
                return "", "" if self.mute else self._uci.batch(batch), 0
            case ["reload_config"]:
                self.reloads += 1
                self._modem.reload()
                return "", "", 0
            case [first, *_]:
                return "", f"-ash: {first}: not found\n", 127
            case _:
                return "", "", 0


_DER = Encoding.DER
_HOST = "127.0.0.1"
_PATIENCE_S = 30.0


class Rutos:
    """One emulated unit; its flash is the folder `state_dir`."""

    def __init__(self, spec: _web.RutosSpec, *, state_dir: Path) -> None:
        self.spec = spec
        self.uci = _web.factory(mobile=spec.mobile_section)
        self.modem = _web.RutosModem(spec, self.uci)
        self.web = _web.Web(spec, self.modem)
        self.shell = Shell(self.uci, self.modem)
        self._flash = state_dir
        self._servers: list[asyncio.Server] = []
        self._ssh: asyncssh.SSHAcceptor | None = None
        self._visitors: set[asyncssh.SSHServerConnection] = set()
        self.https_port = 0
        self.ssh_port = 0
        self.pin = ""
        """SHA-256 of its certificate."""
        self.host_key = ""
        """Fingerprint of the host key, as OpenSSH prints it."""

    async def start(self) -> None:
        """Listen."""
        self._flash.mkdir(parents=True, exist_ok=True)
        server = await asyncio.start_server(self.web.serve, _HOST, 0, ssl=self._tls())
        self._servers.append(server)
        self.https_port = server.sockets[0].getsockname()[1]
        key = self._flash / "ssh_host_key"
        self._ssh = await asyncssh.create_server(
            lambda: Gate(self.spec, self._visitors),
            _HOST,
            0,
            server_host_keys=[asyncssh.import_private_key(host_key(key))],
            process_factory=self.shell.serve,
        )
        self.ssh_port = self._ssh.get_port()
        self.host_key = fingerprint(key)

    async def stop(self) -> None:
        """Stop all servers and connections."""
        for server in self._servers:
            server.close()
        await self.web.hang_up()
        if self._ssh is not None:
            self._ssh.close()
            for visitor in tuple(self._visitors):
                visitor.abort()
                await visitor.wait_closed()
            await self._ssh.wait_closed()

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.stop()

    def describe(self) -> dict[str, Any]:
        """Return the unit's addresses, ports and pins."""
        return {
            "host": _HOST,
            "https": self.https_port,
            "ssh": self.ssh_port,
            "pin": self.pin,
            "host_key": self.host_key,
        }

    def export(self) -> str:
        """Return the configuration as `uci show` prints it."""
        return self.uci.show("network") + self.uci.show("simcard")

    def _tls(self) -> ssl.SSLContext:
        path = self._flash / "certificate.pem"
        if not path.exists():
            template = {"common-name": self.spec.name, "key-size": "prime256v1", "key-usage": "tls-server"}
            write_private(path, issue(template, now=datetime.now(UTC) - timedelta(days=1)).encode())
        certificate = x509.load_pem_x509_certificate(path.read_bytes())
        self.pin = hashlib.sha256(certificate.public_bytes(_DER)).hexdigest()
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(path)
        return context


class RunningRutos:
    """A unit in a thread with its own event loop."""

    def __init__(self, spec: _web.RutosSpec, state_dir: Path) -> None:
        self.unit = Rutos(spec, state_dir=state_dir)
        self.ready: dict[str, Any] = {}
        self._started: Future[dict[str, Any]] = Future()
        self._thread = threading.Thread(target=self._run, name=f"twin of {spec.name}", daemon=True)
        self._loop: asyncio.AbstractEventLoop
        self._end: asyncio.Event

    def __enter__(self) -> Self:
        self._thread.start()
        self.ready = self._started.result(_PATIENCE_S)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join(_PATIENCE_S)

    def _run(self) -> None:
        try:
            asyncio.run(self._run_until_stopped())
        except BaseException as failure:
            if self._started.done():
                raise
            self._started.set_exception(failure)

    async def _run_until_stopped(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._end = asyncio.Event()
        async with self.unit:
            self._started.set_result(self.unit.describe())
            await self._end.wait()
