"""Emulated routers for synchronous callers: in a thread of this process, or in a separate process.

Both are context managers with the same interface: `ready` has the addresses, `do` sends control commands (see
control.py). The emulator is imported where it runs: a caller with a separate process does not load it.
"""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
import threading
from concurrent.futures import Future
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Self

from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.core.paths import write_private

if TYPE_CHECKING:
    from pathlib import Path
    from types import TracebackType

    from atlantis_netcfg.emulator.routeros.spec import SiteSpec

_PATIENCE_S = 30.0


_LAST_LINES = 5


class EmulatorError(NetcfgError):
    """The emulators could not be started, or have crashed: an internal error, not a device's."""


class RunningSite:
    """The emulated routers of `spec` in a thread with its own event loop."""

    def __init__(self, spec: SiteSpec, state_dir: Path) -> None:
        from atlantis_netcfg.emulator.routeros.site import EmulatedSite  # noqa: PLC0415 - see above

        self.site = EmulatedSite(spec, state_dir)
        self.ready: dict[str, Any] = {}
        self._started: Future[dict[str, Any]] = Future()
        self._thread = threading.Thread(target=self._run, name=f"twins of {spec.name}", daemon=True)
        self._loop: asyncio.AbstractEventLoop
        self._end: asyncio.Event
        self._failure: BaseException | None = None

    def __enter__(self) -> Self:
        self._thread.start()
        self.ready = self._started.result(_PATIENCE_S)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join(_PATIENCE_S)
        if self._failure is not None:
            raise self._failure

    def do(self, emulator: str, command: str, **arguments: Any) -> Any:  # noqa: ANN401 (JSON of any shape)
        """Send a control command to one router and wait for the result. Raises ControlError."""
        from atlantis_netcfg.emulator.routeros.control import execute  # noqa: PLC0415 - see above

        work = execute(self.site, emulator, command, arguments)
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(_PATIENCE_S)

    def _run(self) -> None:
        try:
            asyncio.run(self._live())
        except BaseException as failure:  # noqa: BLE001 (carried over to the thread that waits)
            if self._started.done():
                self._failure = failure
            else:
                self._started.set_exception(failure)

    async def _live(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._end = asyncio.Event()
        async with self.site:
            self._started.set_result(self.site.describe())
            await self._end.wait()


class SpawnedSite:
    """The emulated routers of a site in a separate process, which ends with this one."""

    def __init__(self, process: subprocess.Popen[str], log: Path) -> None:
        self._process = process
        self._log = log
        self._turn = threading.Lock()
        self.ready: dict[str, Any] = self._start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def do(self, emulator: str, command: str, **arguments: Any) -> Any:  # noqa: ANN401 (JSON of any shape)
        """Send a control command and wait. Raises ControlError, or EmulatorError if the process has ended."""
        with self._turn:
            self._send_command({"twin": emulator, "do": command, **arguments})
            answer = self._read_response()
        if not answer["ok"]:
            from atlantis_netcfg.emulator.routeros.control import ControlError  # noqa: PLC0415 - see above

            raise ControlError(answer["error"], hint=answer.get("hint"))
        return answer["result"]

    def close(self) -> None:
        """Stop the routers after they have saved their state."""
        if self._process.stdin is not None:
            with suppress(BrokenPipeError):  # a command that a dead process has not read
                self._process.stdin.close()
        try:
            self._process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()

    def _start(self) -> dict[str, Any]:
        values = self._read_response()
        if not values["ready"]:
            self.close()
            raise EmulatorError(f"the twins of {values['site']} do not start: {values['error']}")
        emulators: dict[str, Any] = values["twins"]
        return emulators

    def _send_command(self, command: dict[str, Any]) -> None:
        try:
            print(json.dumps(command), file=self._process.stdin, flush=True)
        except (OSError, ValueError) as gone:
            raise self._death() from gone

    def _read_response(self) -> dict[str, Any]:
        line = self._process.stdout.readline() if self._process.stdout is not None else ""
        if not line:
            self.close()
            raise self._death()
        values: dict[str, Any] = json.loads(line)
        return values

    def _death(self) -> EmulatorError:
        """Build the error with the end of the log, which is deleted with the rehearsal."""
        last: list[str] = []
        with suppress(OSError):
            last = self._log.read_text(encoding="utf-8", errors="replace").splitlines()[-_LAST_LINES:]
        hint = "run the same command again" if not last else "\n".join(("the end of its log:", *last))
        return EmulatorError("the process of the emulated devices has ended", hint=hint)


def spawn(spec: SiteSpec, state_dir: Path) -> SpawnedSite:
    """Start the emulated routers of `spec` in a separate process, and wait until they listen."""
    file, log = state_dir / "site.json", state_dir / "twins.log"
    write_private(file, spec.model_dump_json(indent=1).encode())
    emulators = (sys.executable, "-m", "atlantis_netcfg.emulator.routeros", str(file))
    with log.open("ab") as errors:
        process = subprocess.Popen(  # noqa: S603 (our own interpreter and module)
            (*emulators, "--state", str(state_dir), "--owner", str(os.getpid())),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            start_new_session=True,
        )
    return SpawnedSite(process, log)
