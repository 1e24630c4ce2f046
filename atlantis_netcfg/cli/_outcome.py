"""How a command that did not succeed ends: words for a person or one JSON object, and a log file for us."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from atlantis_netcfg.errors import ExitCode, NetcfgError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from atlantis_netcfg.cli._arguments import Command

__all__ = ["crashed", "failed", "interrupted"]


def failed(error: NetcfgError, *, as_json: bool) -> ExitCode:
    """Tell an error that has words of its own; one that carries `errors` is told as each of them."""
    errors: Sequence[NetcfgError] = getattr(error, "errors", None) or (error,)
    _tell([(str(one), one.hint) for one in errors], error.exit, as_json=as_json)
    return error.exit


def interrupted(command: Command | None, typed: Sequence[str], *, as_json: bool) -> ExitCode:
    """Tell that Ctrl-C was obeyed, and whether a device may have been changed by then."""
    if command is not None and command.changes and not _harmless(command, typed):
        message = "stopped by Ctrl-C; what a device kept is not known here"
        hint = "`provision runs` shows what was confirmed, `provision resume` goes on from there"
        _tell([(message, hint)], ExitCode.UNKNOWN, as_json=as_json)
        return ExitCode.UNKNOWN
    _tell([("stopped by Ctrl-C; nothing was changed", None)], ExitCode.FAILED, as_json=as_json)
    return ExitCode.FAILED


def _harmless(command: Command, typed: Sequence[str]) -> bool:
    return any(flag.harmless and f"--{flag.name}" in typed for flag in command.flags)


def crashed(error: BaseException, typed: Sequence[str], *, as_json: bool) -> ExitCode:
    """Tell an error that nobody foresaw in one sentence; the traceback goes to a log file."""
    message = f"provision itself failed ({type(error).__name__}): this is our fault, not a mistake of yours"
    try:
        hint = f"please send us the log file {_write_log(error, typed)}"
    except (NetcfgError, OSError) as no_log:
        hint = f"no log file could be written ({no_log}); the cause was: {error}"
    _tell([(message, hint)], ExitCode.OUR_FAULT, as_json=as_json)
    return ExitCode.OUR_FAULT


def _write_log(error: BaseException, typed: Sequence[str]) -> Path:
    import os
    import platform
    import traceback
    from datetime import UTC, datetime

    from atlantis_netcfg import __version__
    from atlantis_netcfg.paths import private_directory, state_dir

    directory = private_directory(state_dir() / "log")
    path = directory / f"{datetime.now(UTC):%Y%m%dT%H%M%S.%fZ}-{os.getpid()}.txt"
    text = f"provision {__version__}, Python {platform.python_version()}, {platform.platform()}\n{list(typed)!r}\n\n"
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as log:
        log.write(text + "".join(traceback.format_exception(error)))
    return path


def _tell(errors: Sequence[tuple[str, str | None]], code: ExitCode, *, as_json: bool) -> None:
    if as_json:
        import json

        rows = [{"message": message, "hint": hint} for message, hint in errors]
        print(json.dumps({"exit": int(code), "errors": rows}, ensure_ascii=False))
        return
    for message, hint in errors:
        lines = message.splitlines() + (hint.splitlines() if hint else [])
        print(
            "\n".join(f"{'       ' if place else 'error: '}{line}" for place, line in enumerate(lines)), file=sys.stderr
        )
