"""The Python in which the peers are installed, apart from ours: `tools/strangers` makes it."""

from __future__ import annotations

import subprocess
from functools import cache
from pathlib import Path

from bench.declared import CHECKOUT

__all__ = ["absent", "python", "script", "version"]

_SCRIPTS = Path(__file__).with_name("scripts")
_VERSION = "import sys; from importlib.metadata import version; print(version(sys.argv[1]))"
_FOLDER = CHECKOUT / ".venv-strangers"


def python() -> str:
    """The strangers' interpreter."""
    return str(_FOLDER / "bin" / "python")


def script(name: str) -> str:
    """One of the programs that are run there."""
    return str(_SCRIPTS / name)


def absent(package: str) -> str | None:
    """Why a peer cannot be measured: None if its package is there."""
    return None if version(package) else f"{package} is not installed in {_FOLDER.name}: tools/strangers makes it"


@cache
def version(package: str) -> str:
    """The installed version; empty if there is none."""
    if not Path(python()).exists():
        return ""
    process = subprocess.run(  # noqa: S603 - our own program text
        [python(), "-c", _VERSION, package], capture_output=True, text=True, check=False
    )
    return process.stdout.strip()
