"""A command of a page at a pseudo-terminal, and somebody who types what the page shows when a question is asked."""

import fcntl
import os
import select
import struct
import subprocess
import termios
import time
from collections.abc import Mapping
from pathlib import Path

from docs_console import Shown

ANSWER_S = 120
"""A rehearsal is quieter for less than that before its next question."""


def at_a_terminal(
    command: Shown, cwd: Path, environment: Mapping[str, str], rows: int = 0, columns: int = 0
) -> tuple[int, str]:
    """The exit code, and all that was seen. Fails where a question of the page is never asked, or another one is.

    A terminal of 0 columns is one of unknown width: no line is wrapped.
    """
    ours, theirs = os.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
    with subprocess.Popen(
        # setsid makes the pseudo-terminal the one from which a password would be read, too.
        ["setsid", "--ctty", "--wait", "bash", "-c", command.command],
        cwd=cwd,
        env=environment,
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
    ) as process:
        os.close(theirs)
        try:
            seen = _answer_all(ours, command)
        finally:
            os.close(ours)
            if process.poll() is None:
                process.terminate()
    return process.returncode, seen.replace("\r\n", "\n")


def _answer_all(terminal: int, command: Shown) -> str:
    """Type each answer once, whatever the order of the questions; all that was seen until the command ended."""
    seen, left, typed_until = "", list(command.answers), 0
    until = time.monotonic() + ANSWER_S
    while True:
        ready, _, _ = select.select([terminal], [], [], max(0.0, until - time.monotonic()))
        assert ready, f"{command.place}: it waits; not asked yet: {[question for question, _ in left]}; seen:\n{seen}"
        more = _read(terminal)
        if not more:
            break
        seen += more
        until = time.monotonic() + ANSWER_S
        answer = next((row for row in left if row[0] in _question(seen[typed_until:])), None)
        if answer is not None:
            left.remove(answer)
            os.write(terminal, f"{answer[1]}\n".encode())
            typed_until = len(seen)
    assert left == [], f"{command.place}: never asked: {[question for question, _ in left]}; seen:\n{seen}"
    return seen


def _question(text: str) -> str:
    """What stands where the cursor is: a question waits at the end of its line, which may be its second one."""
    above_and_last = text.split("\n")[-2:]
    return " ".join(" ".join(above_and_last).split()) if above_and_last[-1].strip() else ""


def _read(terminal: int) -> str:
    try:
        return os.read(terminal, 4096).decode(errors="replace")
    except OSError:  # Linux tells so that nobody has it open any more
        return ""
