"""SSH of the unit: commands without a terminal, of which the twin has the few that a setting needs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import asyncssh

from atlantis_netcfg.emulator.rutos._uci import UciRefused

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.rutos._modem import Modem
    from atlantis_netcfg.emulator.rutos._spec import RutosSpec
    from atlantis_netcfg.emulator.rutos._uci import Uci

__all__ = ["Gate", "Shell"]


class Gate(asyncssh.SSHServer):
    """Who may in: one user, by password."""

    def __init__(self, spec: RutosSpec, there: set[asyncssh.SSHServerConnection]) -> None:
        self._spec = spec
        self._there = there
        self._connection: asyncssh.SSHServerConnection | None = None

    def connection_made(self, conn: asyncssh.SSHServerConnection) -> None:
        """Somebody has come."""
        self._connection = conn
        self._there.add(conn)

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - asyncssh's signature
        """And is gone."""
        if self._connection is not None:
            self._there.discard(self._connection)

    def begin_auth(self, username: str) -> bool:  # noqa: ARG002 - asyncssh's signature
        """Nobody enters without proof."""
        return True

    def password_auth_supported(self) -> bool:
        """By password."""
        return True

    def validate_password(self, username: str, password: str) -> bool:
        """The one who may set things."""
        return (username, password) == (self._spec.admin, self._spec.admin_password)


class Shell:
    """Runs `uci show …`, `uci batch`, `uci export …` and `reload_config`, joined by `&&`."""

    def __init__(self, uci: Uci, modem: Modem) -> None:
        self._uci = uci
        self._modem = modem
        self.commands: list[str] = []
        self.reloads = 0
        self.mute = False
        """Knob: batches are taken and forgotten, as by a unit whose flash is read-only."""
        self.drops_on_reload = False
        """Knob: the session is lost while the network reloads."""

    async def serve(self, process: asyncssh.SSHServerProcess[str]) -> None:
        """One command."""
        command = process.command or ""
        self.commands.append(command)
        given = await process.stdin.read() if command == "uci batch" else ""
        code = 0
        for part in command.split("&&"):
            out, error, code = self._run(part.split(), given)
            process.stdout.write(out)
            process.stderr.write(error)
            if code:
                break
        if command == "reload_config" and self.drops_on_reload:
            process.channel.get_connection().abort()
            return
        process.exit(code)

    def _run(self, words: list[str], given: str) -> tuple[str, str, int]:
        match words:
            case ["uci", "show", package]:
                try:
                    return self._uci.show(package), "", 0
                except UciRefused as refused:
                    return "", f"{refused}\n", 1
            case ["uci", "batch"]:
                return "", "" if self.mute else self._uci.batch(given), 0
            case ["reload_config"]:
                self.reloads += 1
                self._modem.reload()
                return "", "", 0
            case [first, *_]:
                return "", f"-ash: {first}: not found\n", 127
            case _:
                return "", "", 0
