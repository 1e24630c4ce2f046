"""Run programs on the computer, and quote their last output lines when they fail."""

from __future__ import annotations

import os
import shutil
import subprocess
from dataclasses import dataclass

from atlantis_netcfg.core.messages import arg

from .errors import ModuleError

_LINES = 8
_TIMEOUT_S = 600
_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"


@dataclass(frozen=True)
class ProgramResult:
    """Exit code and complete output of a program."""

    code: int
    output: str


def run(argv: list[str], timeout_s: float = _TIMEOUT_S) -> ProgramResult:
    """Run a program without a terminal, in English; code 127: it does not exist, 124: timed out after `timeout_s`."""
    environment = dict(os.environ, LC_ALL="C.UTF-8", LANGUAGE="", PATH=_PATH, DEBIAN_FRONTEND="noninteractive")
    try:
        process = subprocess.run(  # noqa: S603 - what the inventory has made
            argv,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=environment,
            timeout=timeout_s,
            check=False,
        )
    except FileNotFoundError:
        return ProgramResult(127, f"{argv[0]}: not found")
    except subprocess.TimeoutExpired as late:
        return ProgramResult(
            124, (late.stdout or b"").decode(errors="replace") + f"\ntimed out after {timeout_s:.0f} s"
        )
    except OSError as error:
        return ProgramResult(126, f"{argv[0]}: {error.strerror}")
    return ProgramResult(process.returncode, process.stdout.decode(errors="replace"))


def is_there(program: str) -> bool:
    """Return whether a program is installed."""
    return shutil.which(program, path=_PATH) is not None


def last_lines(text: str) -> str:
    """Return the last lines of a program's output, for an error message."""
    lines = [line.rstrip() for line in text.splitlines() if line.strip()]
    return "\n".join(lines[-_LINES:])


def require_success(result: ProgramResult, what: str, hint: str = "") -> None:
    """Raise ModuleError with the last output lines unless the program succeeded."""
    if result.code != 0:
        text = last_lines(result.output)
        raise ModuleError(
            f"{arg(what)} (exit {arg(result.code)})" + (f":\n{arg(text)}" if text else " without output"), hint
        )
