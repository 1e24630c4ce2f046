"""Internal errors: one sentence for the user, the traceback in a log file."""

from __future__ import annotations

import os
import platform
import traceback
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from atlantis_netcfg import __version__
from atlantis_netcfg.core.atomic_files import write_atomically
from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.paths import private_directory

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


class InternalError(NetcfgError):
    """An unexpected internal error; `str()` and `hint` are the parts shown to the user."""


def report_crash(error: BaseException, doing: str, state: Callable[[], Path]) -> InternalError:
    """Write the traceback below the state directory and report it; if that fails, report the cause instead."""
    message = msg(
        f"provision itself failed ({arg(type(error).__name__)}): this is a defect of the program, not your mistake"
    )
    try:
        text = "".join(traceback.format_exception(error))
        hint = msg(f"please send us the log file {arg(write_log(text, doing, state()))}")
    except (NetcfgError, OSError) as no_log:
        hint = msg(f"no log file could be written ({arg(no_log)}); the cause was: {arg(error)}")
    return InternalError(message, hint=hint)


def write_log(text: str, doing: str, state: Path) -> Path:
    """Write a log file below the state directory and return its path. Raises OSError, UsageError."""
    directory = private_directory(state / "log")
    path = directory / f"{datetime.now(UTC):%Y%m%dT%H%M%S.%fZ}-{os.getpid()}.txt"
    head = f"provision {__version__}, Python {platform.python_version()}, {platform.platform()}\n{doing}\n\n"
    write_atomically(path, (head + text).encode(errors="backslashreplace"))
    return path
