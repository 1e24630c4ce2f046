"""Run the programs of the system that containers are made of, and say what went wrong in words for a person."""

from __future__ import annotations

import subprocess
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import NetcfgError

if TYPE_CHECKING:
    from collections.abc import Sequence


class MachineFailed(NetcfgError):
    """A machine could not be built, started, or asked; nothing beyond this computer was touched."""


def output_of(
    words: Sequence[str], *, text: str | None = None, timeout_s: float | None = None, keep: Sequence[int] = ()
) -> subprocess.CompletedProcess[str]:
    """Run a program and give what came of it, whatever that is; `keep`: file descriptors that it inherits."""
    return subprocess.run(  # noqa: S603 - a program of the system, and arguments that are ours
        words,
        input="" if text is None else text,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
        timeout=timeout_s,
        pass_fds=keep,
    )


def program(*words: str) -> str:
    """Run a program that has to succeed; give its output."""
    done = output_of(words)
    if done.returncode:
        raise MachineFailed(f"{' '.join(words)}: {done.stderr.strip() or f'ended with {done.returncode}'}")
    return done.stdout
