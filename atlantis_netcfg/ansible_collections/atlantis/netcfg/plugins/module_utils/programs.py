"""Programs that are run on the computer, and what they said last where they failed."""

from __future__ import annotations

import os
import shutil
import subprocess
from dataclasses import dataclass

from .errors import ModuleError

_LINES = 8
_TIMEOUT_S = 600
_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"


@dataclass(frozen=True)
class ProgramResult:
    """How a program ended, and all that it said, in order."""

    code: int
    output: str


def run(argv: list[str], timeout_s: float = _TIMEOUT_S) -> ProgramResult:
    """Run a program without a terminal, in English; 127: it is not there, 124: it took longer than `timeout_s`."""
    environment = dict(os.environ, LC_ALL="C.UTF-8", LANGUAGE="", PATH=_PATH, DEBIAN_FRONTEND="noninteractive")
    try:
        process = subprocess.run(  # noqa: S603 - what the declaration has made
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
        return ProgramResult(124, (late.stdout or b"").decode(errors="replace") + f"\nno end after {timeout_s:.0f} s")
    except OSError as error:
        return ProgramResult(126, f"{argv[0]}: {error.strerror}")
    return ProgramResult(process.returncode, process.stdout.decode(errors="replace"))


def is_there(program: str) -> bool:
    """Whether a program can be started."""
    return shutil.which(program, path=_PATH) is not None


def last_lines(text: str) -> str:
    """What a person has to read of it."""
    lines = [line.rstrip() for line in text.splitlines() if line.strip()]
    return "\n".join(lines[-_LINES:])


def require_success(result: ProgramResult, what: str, hint: str = "") -> None:
    """Raise with the last lines unless the program succeeded."""
    if result.code != 0:
        text = last_lines(result.output)
        raise ModuleError(f"{what} (exit {result.code})" + (f":\n{text}" if text else " without a word"), hint)
