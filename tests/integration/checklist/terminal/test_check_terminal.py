"""`provision check --rehearse` on a terminal: Ctrl+C at a question, and the same command goes on to a signature."""

import os
import select
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import pytest
from waiting import HANG_S

from atlantis_netcfg.cli import main

pytestmark = pytest.mark.slow

WORDS = ("check", "site=coastal", "vehicle=eca-rov", "endpoint=usbl,ethernet", "--rehearse")
AGAIN_S = 5
"""After so long somebody presses it once more."""
AT_A_TERMINAL = """
import fcntl, os, signal, sys, termios
signal.signal(signal.SIGINT, signal.SIG_DFL)  # tests that a shell runs in the background hand on that it is ignored
os.setsid()
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.executable, [sys.executable, "-m", "atlantis_netcfg", *sys.argv[1:]])
"""


class Terminal:
    """Somebody who types when they have read what is asked."""

    def __init__(self, *words: str) -> None:
        self.ours, theirs = os.openpty()
        command = [sys.executable, "-c", AT_A_TERMINAL, *words]
        self.process = subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs)
        os.close(theirs)
        self.seen = ""

    def answers(self, question: str, answer: str) -> None:
        while question not in self.seen:
            ready, _, _ = select.select([self.ours], [], [], HANG_S)
            assert ready, f"`{question}` was never asked: {self.seen}"
            self.seen += self._read()
        self.seen = self.seen.partition(question)[2]
        os.write(self.ours, answer.encode())

    def interrupted(self) -> None:
        """Press Ctrl+C until it is heard: one between a prompt and the reading of its answer waits for that answer."""
        while self.process.poll() is None and "interrupted" not in self.seen:
            os.write(self.ours, b"\x03")
            until = time.monotonic() + AGAIN_S
            while "interrupted" not in self.seen and self._told(until):
                more = self._read()
                if not more:
                    return
                self.seen += more

    def _told(self, until: float) -> bool:
        return bool(select.select([self.ours], [], [], max(0.0, until - time.monotonic()))[0])

    def ends(self) -> tuple[int, str]:
        """Exit code, and what was said to the end."""
        while more := self._read():
            self.seen += more
        os.close(self.ours)
        return self.process.wait(HANG_S), self.seen.replace("\r\n", "\n")

    def _read(self) -> str:
        try:
            return os.read(self.ours, 4096).decode(errors="replace")
        except OSError:  # Linux tells so that nobody has it open any more
            return ""


@pytest.fixture
def terminals() -> Iterator[Callable[[], Terminal]]:
    """Open terminals with the command; whatever still runs is ended."""
    opened: list[Terminal] = []

    def one() -> Terminal:
        opened.append(Terminal(*WORDS))
        return opened[-1]

    yield one
    for terminal in opened:
        terminal.process.kill()
        terminal.process.wait()


def test_interrupted_checklist_resumes_until_it_is_signed(
    monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory, terminals: Callable[[], Terminal]
) -> None:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path_factory.mktemp("terminal")))
    first = terminals()
    first.answers("Is it so?", "yes\n")
    first.answers("Note (may be empty):", "")
    first.interrupted()
    code, said = first.ends()
    assert code == 4, said
    assert "interrupted by Ctrl-C; results and answers so far are saved" in said
    assert f"continue with `provision {' '.join(WORDS)}`" in " ".join(said.split()), "it is broken where the line ends"
    again = terminals()
    again.answers("1 of 2 items are complete, 1 are open.", "")
    for question, answer in (
        ("Is it so?", "yes\n"),
        ("Note (may be empty):", "it followed us\n"),
        ("Your name, as it should appear in the report:", "A. Technician\n"),
        ("Photo or file as evidence (a path", "\n"),
        ("No item is open. Sign the checklist as it is?", "yes\n"),
    ):
        again.answers(question, answer)
    code, said = again.ends()
    assert code == 0, said
    assert "Signed by A. Technician" in said
    assert main(["report", "verify", "site=coastal"]) == 0
