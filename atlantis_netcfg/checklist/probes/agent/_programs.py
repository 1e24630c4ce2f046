"""A program that only reads; which ones may run is decided before the question leaves."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from contextlib import suppress
from typing import Any

from atlantis_netcfg.checklist.probes.agent._shared import no_answer

__all__ = ["end_all", "run"]

_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
_LONGEST = 65536
_RUNNING: list[subprocess.Popen[bytes]] = []


def run(question: dict[str, Any]) -> dict[str, Any]:
    """Run it without a shell, and give the fields of `Ran`. Raises NoAnswer: missing, denied."""
    began = time.time()
    try:
        program = subprocess.Popen(  # noqa: S603 - of the closed list, and without a shell
            question["argv"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={"PATH": _PATH, "LC_ALL": "C"},
            start_new_session=True,
        )
    except OSError as error:
        raise no_answer(error, question["argv"][0]) from None
    _RUNNING.append(program)
    trouble, words = None, ""
    try:
        out, err = program.communicate(timeout=question["within_s"])
    except subprocess.TimeoutExpired:
        trouble, words = "silent", f"{question['argv'][0]} did not end within {question['within_s']:g} s"
        _end(program)
        out, err = program.communicate()
    _RUNNING.remove(program)
    values = {"out": _text(out), "err": _text(err)}
    return {"trouble": trouble, "words": words, "rc": program.returncode, "began": began, **values}


def end_all() -> None:
    """End what still runs."""
    for program in tuple(_RUNNING):
        _end(program)


def _end(program: subprocess.Popen[bytes]) -> None:
    """The program and what it has started."""
    with suppress(OSError):
        os.killpg(program.pid, signal.SIGKILL)


def _text(data: bytes) -> str:
    return data[:_LONGEST].decode("utf-8", "replace")
