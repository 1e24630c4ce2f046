"""Faults of ours: one sentence for the person, the traceback in a log file."""

from __future__ import annotations

import os
import platform
import traceback
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from atlantis_netcfg import __version__
from atlantis_netcfg.core.atomic_files import write_atomically
from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.core.paths import private_directory

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


class InternalError(NetcfgError):
    """Something that nobody foresaw; `str()` and `hint` are what a person may see of it."""


def report_crash(error: BaseException, doing: str, state: Callable[[], Path]) -> InternalError:
    """Write the traceback below the state directory and say so; without a place for it, name the cause instead."""
    message = f"provision itself failed ({type(error).__name__}): this is our fault, not a mistake of yours"
    try:
        text = "".join(traceback.format_exception(error))
        hint = f"please send us the log file {write_log(text, doing, state())}"
    except (NetcfgError, OSError) as no_log:
        hint = f"no log file could be written ({no_log}); the cause was: {error}"
    return InternalError(message, hint=hint)


def write_log(text: str, doing: str, state: Path) -> Path:
    """Keep a text for us in a file below the state directory and name it. Raises OSError, UsageError."""
    directory = private_directory(state / "log")
    path = directory / f"{datetime.now(UTC):%Y%m%dT%H%M%S.%fZ}-{os.getpid()}.txt"
    head = f"provision {__version__}, Python {platform.python_version()}, {platform.platform()}\n{doing}\n\n"
    write_atomically(path, (head + text).encode(errors="backslashreplace"))
    return path
