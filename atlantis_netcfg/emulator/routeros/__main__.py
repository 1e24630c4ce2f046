"""`python -m atlantis_netcfg.emulator.routeros SITE.json --state DIR`: the emulated routers of a site as a process.

It prints one JSON line on stdout when all listen (or cannot), then one for each command on stdin (see control.py). It
ends when stdin closes, when the process `--owner` ends (a fork of it may hold stdin open) or on SIGTERM; the state is
then saved to flash.
"""

from __future__ import annotations

import argparse
import asyncio
import atexit
import gc
import json
import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.emulator.routeros.control import ControlError, execute
from atlantis_netcfg.emulator.routeros.site import EmulatedSite
from atlantis_netcfg.emulator.routeros.spec import SiteSpec

_STDIN = 0
_OBJECTS = 50_000
"""Threshold of the garbage collector; none runs at exit. As in the command line: a rehearsal would wait for it."""


def main() -> int:
    """Run until stdin closes, the owner ends, or SIGTERM."""
    parser = argparse.ArgumentParser(
        prog="python -m atlantis_netcfg.emulator.routeros", description="emulated routers of a site"
    )
    parser.add_argument("site", type=Path, help="specification of the site's twins (JSON)")
    parser.add_argument("--state", type=Path, required=True, help="folder that stands for the routers' flash")
    parser.add_argument("--owner", type=int, help="the parent process, with whose end the twins end")
    arguments = parser.parse_args()
    gc.set_threshold(_OBJECTS)
    atexit.register(gc.freeze)
    try:
        spec = SiteSpec.model_validate_json(arguments.site.read_bytes())
    except (OSError, ValidationError) as error:
        sys.stderr.write(f"{arguments.site}: {error}\n")
        return ExitCode.USAGE
    return asyncio.run(_serve(spec, arguments.state, arguments.owner))


async def _serve(spec: SiteSpec, state_dir: Path, owner: int | None) -> ExitCode:
    lines: asyncio.Queue[str | None] = asyncio.Queue()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, lines.put_nowait, None)
    if owner is not None:
        _end_with(owner, loop, lines)
    site = EmulatedSite(spec, state_dir)
    try:
        await site.start()
    except (OSError, ValueError) as refused:
        _write_answer({"ready": False, "site": spec.name, "error": f"{type(refused).__name__}: {refused}"})
        return ExitCode.USAGE
    try:
        _write_answer({"ready": True, "site": spec.name, "twins": site.describe(), "control": "stdin"})
        threading.Thread(target=_listen, args=(loop, lines), daemon=True).start()
        while (line := await lines.get()) is not None:
            if line.strip():
                _write_answer(await _answer_line(site, line))
    finally:
        await site.stop()
    return ExitCode.DONE


def _end_with(owner: int, loop: asyncio.AbstractEventLoop, lines: asyncio.Queue[str | None]) -> None:
    """Treat the end of the owner process like the end of stdin."""
    try:
        handle = os.pidfd_open(owner)
    except ProcessLookupError:
        lines.put_nowait(None)
        return
    if os.getppid() != owner:  # it is dead, and its number another's
        lines.put_nowait(None)
    else:
        loop.add_reader(handle, _end_input, loop, handle, lines)


def _end_input(loop: asyncio.AbstractEventLoop, handle: int, lines: asyncio.Queue[str | None]) -> None:
    loop.remove_reader(handle)
    lines.put_nowait(None)


def _listen(loop: asyncio.AbstractEventLoop, lines: asyncio.Queue[str | None]) -> None:
    """Read stdin in a thread: it may be a pipe, a terminal, a file or /dev/null, which asyncio cannot all watch."""
    with os.fdopen(os.dup(_STDIN), "r", encoding="utf-8") as stdin:
        for line in stdin:
            loop.call_soon_threadsafe(lines.put_nowait, line)
    loop.call_soon_threadsafe(lines.put_nowait, None)


async def _answer_line(site: EmulatedSite, line: str) -> dict[str, Any]:
    try:
        command = dict(json.loads(line))
        emulator, do = command.pop("twin"), command.pop("do")
        return {"ok": True, "twin": emulator, "do": do, "result": await execute(site, emulator, do, command)}
    except ControlError as refused:
        return {"ok": False, "error": str(refused), "hint": refused.hint}
    except (KeyError, TypeError, ValueError) as error:
        return {"ok": False, "error": f'not a command like {{"twin": ..., "do": ...}}: {error}', "hint": None}


def _write_answer(answer: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
