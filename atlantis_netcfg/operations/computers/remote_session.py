"""The connection to the VPN server during a command: one remote process, one round trip per request.

`SshLink` opens the same connection as Ansible (OpenSSH, with the same options), and shares an open one. It starts the
live tool, which is sent once and stored on the server under its SHA-256.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
import select
import shlex
import subprocess
import tempfile
import time
import zlib
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol, Self

from atlantis_netcfg.core import errors, remote_messages
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.processes import remote_bundle
from atlantis_netcfg.operations.computers._access import key_trouble

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from types import TracebackType


class ServerAway(errors.OutcomeUnknown):
    """The server was not reached; nothing was changed on it."""


class HostKeyMismatch(ServerAway):
    """The server's address presents another host key; nothing was sent to it."""


class AnswerLost(errors.OutcomeUnknown):
    """A request was sent, and its response was not received completely."""


class ServerRefusal(errors.DeviceError):
    """The server refused a request and gave the reason."""


class StaleRecord(errors.NetcfgError):
    """The server is newer than this record: a restored copy would bring back a revoked member."""

    exit = errors.ExitCode.FAILED

    def __init__(self, why: str) -> None:
        super().__init__(
            msg(f"this record is older than the server's: {arg(why)}"),
            hint=(
                "use the newest copy of the authority with `authority=FOLDER`; with this one nothing was signed or "
                "sent. If that copy is lost: `provision vpn sync --sign --take-list`"
            ),
        )


_SSH_OPTIONS: Final = "-o ControlMaster=auto -o ControlPersist=30m -o ServerAliveInterval=20 -o ServerAliveCountMax=6"
"""As in ansible.cfg: 6 unanswered keep-alives of 20 s outlast a gap of 70 s."""
_CONNECT_S: Final = 120
"""Connection timeout in seconds, as `timeout` in ansible.cfg."""
_NOT_FOUND: Final = 127


def ssh_command(access: Mapping[str, Any]) -> Sequence[str]:
    """Return ssh with its options up to the host; Ansible's environment variables apply."""
    ssh_options = os.environ.get("ANSIBLE_SSH_ARGS", _SSH_OPTIONS)
    words = ["ssh", "-T", "-o", "BatchMode=yes", *shlex.split(access["ssh_args"]), *shlex.split(ssh_options)]
    if "ControlPersist" in ssh_options:
        words += ["-o", f"ControlPath={control_path(access['host'], access['port'], access['user'])}"]
    if key := os.environ.get("ANSIBLE_PRIVATE_KEY_FILE"):
        words += ["-o", f"IdentityFile={key}"]
    words += ["-o", f"ConnectTimeout={_CONNECT_S}", *shlex.split(os.environ.get("ANSIBLE_SSH_EXTRA_ARGS", ""))]
    return [*words, "-p", str(access["port"]), f"{access['user']}@{access['host']}"]


def control_path(host: str, port: int, user: str) -> str:
    """Return the control socket of Ansible's connection to a computer, creating its folder."""
    folder = Path(os.environ.get("ANSIBLE_SSH_CONTROL_PATH_DIR", "~/.ansible/cp")).expanduser()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    digest = hashlib.sha1(f"{host}-{port}-{user}".encode(), usedforsecurity=False).hexdigest()
    return str(folder / digest[:10])


def ssh_error(name: str, access: Mapping[str, Any], code: int | None, text: str) -> ServerAway:
    """Convert the last output of ssh to an error."""
    where = msg(f"{arg(access['user'])}@{arg(access['host'])}, port {arg(access['port'])}")
    last = next((line.strip() for line in reversed(text.splitlines()) if line.strip()), msg(f"exit {arg(code)}"))
    if (trouble := key_trouble(name, text)) is not None:
        return HostKeyMismatch(msg(f"{arg(name)} at {arg(access['host'])}: {arg(trouble[0])}"), hint=trouble[1])
    if "Permission denied" in text:
        return ServerAway(
            f"{arg(name)} was reached, but refused the login as {arg(access['user'])}: {arg(last)}",
            hint=f"copy your key there: `ssh-copy-id -p {arg(access['port'])} "
            f"{arg(access['user'])}@{arg(access['host'])}`",
        )
    if "sudo" in last:
        return ServerAway(
            f"{arg(name)}: {arg(access['user'])} cannot become root without a password: {arg(last)}",
            hint=f"on {arg(name)}: `echo '{arg(access['user'])} ALL=(ALL) NOPASSWD: ALL' > /etc/sudoers.d/atlantis`",
        )
    if code == _NOT_FOUND:
        return ServerAway(f"{arg(name)} has no python3: {arg(last)}", hint=f"on {arg(name)}: `apt-get install python3`")
    return ServerAway(
        f"{arg(name)} was not reached ({arg(where)}): {arg(last)}",
        hint=(
            "check its power and your connection to it; recorded changes are pending, and `provision vpn sync` "
            "continues"
        ),
    )


FOLDER: Final = "/var/lib/atlantis/live"
"""Server folder of the live tool; the modules' tool has another one, because each removes older versions."""
PYTHON: Final = (3, 8)
_MARK: Final = b"ATLANTIS-VPN "
"""Prefix of each response, because shells print greetings (`vpn_serve.py`)."""
_ASKS: Final = "ATLANTIS-PYTHON "
_INSTALL_MARK: Final = "ATLANTIS-RESULT "
"""Prefix of the installing program's output, which it writes only on failure."""
_VERSION: Final = f'import sys; print("\\n{_ASKS}%d %d" % sys.version_info[:2])'
_START_S: Final = 150.0
"""Timeout for the first line: a connection may begin in a gap of 70 s, and then the tool is transferred."""
_ANSWER_S: Final = 300.0
_MOST: Final = 64 * 1024 * 1024
"""Maximum number of bytes in one line."""


class ServerLink(Protocol):
    """A connection to the running server; `round_trips` counts its requests, including the start."""

    round_trips: int

    def ask(self, do: str, **what: Any) -> dict[str, Any]:  # noqa: ANN401 - JSON
        """Execute one request; raise ServerAway, AnswerLost or ServerRefusal."""

    def close(self) -> None:
        """Close the connection; requests already sent are completed."""


class _RemoteLink:
    """A connection by one process, with a line per request and response."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.round_trips = 0
        self._number = 0
        self._process: subprocess.Popen[bytes] | None = None
        self._buffer = b""
        self._stderr = tempfile.TemporaryFile()  # noqa: SIM115 - it is closed with the link

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self.close()

    def ask(self, do: str, **what: Any) -> dict[str, Any]:  # noqa: ANN401 - JSON
        """Execute one request; the first starts the process. Raise ServerAway, AnswerLost or ServerRefusal."""
        if self._process is None:
            self._start()
        self._number += 1
        self._send(_pack({"id": self._number, "do": do, **what}) + b"\n")
        self.round_trips += 1
        answer = self._answer(do)
        if "refused" in answer:
            raise ServerRefusal(f"{arg(self.name)}: {arg(answer['refused'])}", hint=answer.get("hint") or None)
        if "broken" in answer:
            raise AnswerLost(
                f"{arg(self.name)}: the toolkit's program failed there at `{arg(do)}`: {arg(answer['broken'])}",
                hint="this is a bug: please report it; its progress is unknown",
            )
        result = answer.get("done")
        if not isinstance(result, dict):
            raise self._loss_error(do)
        return result

    def close(self) -> None:
        """Close the pipes and wait for the process to end."""
        process, self._process = self._process, None
        if process is not None:
            assert process.stdin is not None  # noqa: S101 - it was started so
            assert process.stdout is not None  # noqa: S101 - as above
            with suppress(OSError):
                process.stdin.close()
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            process.stdout.close()
        self._stderr.close()

    def _words(self, command: str) -> Sequence[str]:
        """Return the arguments that run a shell command on the server."""
        raise NotImplementedError

    def _trouble(self, code: int | None, text: str) -> ServerAway:
        """Return the error for a process that ended before its first line."""
        raise NotImplementedError

    def _start(self) -> None:
        tool = remote_bundle.build_live()
        self._process = subprocess.Popen(  # noqa: S603 - our own words
            self._words(_command(tool)), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._stderr, bufsize=0
        )
        self.round_trips += 1
        end = time.monotonic() + _START_S
        while True:
            line = self._line(end)
            if line is None:
                raise self._end_error()
            if line.startswith(_ASKS.encode()):
                self._install(tool, line)
            elif line.startswith(_INSTALL_MARK.encode()):
                raise _install_error(self.name, line)
            elif line.startswith(_MARK):
                return

    def _install(self, tool: remote_bundle.Tool, line: bytes) -> None:
        python_release = tuple(int(number[:9]) for number in line.split()[1:] if number.isdigit())
        if python_release < PYTHON:
            is_there, minimum = (".".join(map(str, version)) for version in (python_release, PYTHON))
            raise ServerAway(
                f"{arg(self.name)} has Python {arg(is_there)}, but at least {arg(minimum)} is required",
                hint="included in Debian 11 and Ubuntu 20.04",
            )
        self._send(remote_bundle.INSTALL.read_bytes() + tool.payload)
        self.round_trips += 1

    def _send(self, data: bytes) -> None:
        assert self._process is not None  # noqa: S101 - callers have started it
        assert self._process.stdin is not None  # noqa: S101 - as above
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[os.write(self._process.stdin.fileno(), rest) :]
        except OSError as error:
            raise self._loss_error() from error

    def _answer(self, do: str) -> dict[str, Any]:
        end = time.monotonic() + _ANSWER_S
        while (line := self._line(end)) is not None:
            if not line.startswith(_MARK):
                continue
            try:
                answer = _unpack(line[len(_MARK) :])
            except ValueError:
                break
            if answer.get("id") == self._number:
                return remote_messages.unpack(answer)
        raise self._loss_error(do)

    def _line(self, end: float) -> bytes | None:
        """Return the next line; None if the process ended or the time is up."""
        assert self._process is not None  # noqa: S101 - callers have started it
        assert self._process.stdout is not None  # noqa: S101 - as above
        while b"\n" not in self._buffer:
            ready, _, _ = select.select([self._process.stdout], [], [], max(0.0, end - time.monotonic()))
            got = os.read(self._process.stdout.fileno(), 65536) if ready else b""
            if not got or len(self._buffer) > _MOST:
                return None
            self._buffer += got
        line, _, self._buffer = self._buffer.partition(b"\n")
        return line.strip()

    def _end_error(self) -> ServerAway:
        code = self._code()
        return self._trouble(code, self._stderr_tail())

    def _loss_error(self, do: str = "") -> AnswerLost:
        code = self._code()
        why = self._stderr_tail().strip().splitlines()[-1:] or [
            msg(f"exit {arg(code)}" if code is not None else "no response")
        ]
        return AnswerLost(
            f"{arg(self.name)}: the connection was lost before a response{f' to `{arg(do)}`' if do else ''} "
            f"({arg(why[0])})",
            hint="the request may have been completed: `provision vpn sync` checks and continues",
        )

    def _code(self) -> int | None:
        """Return the process's exit code; kill it if it hangs."""
        process, self._process = self._process, None
        assert process is not None  # noqa: S101 - callers have started it
        for pipe in (process.stdin, process.stdout):
            assert pipe is not None  # noqa: S101 - it was started so
            with suppress(OSError):
                pipe.close()
        try:
            return process.wait(2)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            return None

    def _stderr_tail(self) -> str:
        self._stderr.seek(0)
        return self._stderr.read()[-4000:].decode(errors="replace")


class SshLink(_RemoteLink):
    """A connection over SSH with the account, port and options of Ansible's connection to that computer."""

    def __init__(self, name: str, access: Mapping[str, Any]) -> None:
        """Set up the connection; `access` is the result of `computer_access`."""
        super().__init__(name)
        self._access = access

    def _words(self, command: str) -> Sequence[str]:
        if self._access["become"]:
            command = f"sudo -H -S -n sh -c {shlex.quote(command)}"
        return [*ssh_command(self._access), command]

    def _trouble(self, code: int | None, text: str) -> ServerAway:
        return ssh_error(self.name, self._access, code, text)


def _command(tool: remote_bundle.Tool) -> str:
    """Return the command that runs the tool if present and intact; otherwise it reports Python and awaits the tool."""
    path = f"{FOLDER}/{tool.sha256}.pyz"
    program = f"import sys; exec(sys.stdin.buffer.read({remote_bundle.INSTALL.stat().st_size}))"
    words = (FOLDER, tool.sha256, str(len(tool.payload)), _INSTALL_MARK, "serve")
    return (
        f"if echo '{tool.sha256}  {path}' | sha256sum -c --status 2>/dev/null; then exec python3 -I {path}; fi; "
        f"python3 -I -c {shlex.quote(_VERSION)} && "
        f"exec python3 -I -c {shlex.quote(program)} {shlex.join(words)}"
    )


def _pack(values: dict[str, Any]) -> bytes:
    return base64.b64encode(zlib.compress(json.dumps(values, separators=(",", ":")).encode(), 6))


def _unpack(line: bytes) -> dict[str, Any]:
    """Decode a line; raise ValueError if it is damaged."""
    try:
        result = json.loads(zlib.decompressobj().decompress(base64.b64decode(line, validate=True), _MOST))
    except (zlib.error, RecursionError) as error:
        raise ValueError(str(error)) from error
    if not isinstance(result, dict):
        raise ValueError("no response")  # noqa: TRY004 - as any other that is torn
    return result


def _install_error(name: str, line: bytes) -> ServerRefusal:
    try:
        result = remote_messages.unpack(json.loads(line[len(_INSTALL_MARK) :]))
        return ServerRefusal(f"{arg(name)}: {arg(result['msg'])}", hint=result.get("hint") or None)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return ServerRefusal(f"{arg(name)}: the toolkit's program was not installed, for an unknown reason")
