"""Tab in real shells: bash, zsh and fish complete lines of `provision` on a terminal, as a person sees it."""

import fcntl
import os
import pty
import re
import select
import shutil
import signal
import struct
import subprocess
import sys
import termios
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import pyte
import pytest
from waiting import HANG_S

from atlantis_netcfg.runs import RunStart, Store

pytestmark = pytest.mark.slow
COLUMNS, ROWS = 120, 40
START = {
    "bash": (("bash", "--norc", "--noprofile", "-i"), "source <(provision help completion bash)"),
    "zsh": (("zsh", "-f", "-i"), "autoload -Uz compinit; compinit -u -D; source <(provision help completion zsh)"),
    "fish": (("fish", "--no-config", "-i"), "provision help completion fish | source"),
}
"""How each shell is started without a person's own settings, and what docs/engineers/completion.md says to type."""


@dataclass
class Terminal:
    """A shell on a pseudo-terminal, with the screen that a person would see."""

    descriptor: int
    screen: pyte.Screen
    stream: pyte.ByteStream

    def type(self, text: str) -> None:
        os.write(self.descriptor, text.encode())

    @property
    def line(self) -> str:
        """The line in which the cursor is, up to the cursor."""
        return str(self.screen.display[self.screen.cursor.y])[: self.screen.cursor.x]

    @property
    def text(self) -> str:
        return "\n".join(row.rstrip() for row in self.screen.display).rstrip()

    def until(self, pattern: str, *, anywhere: bool = False) -> None:
        """Read until the line up to the cursor, or the whole screen, matches."""
        while not re.search(pattern, self.text if anywhere else self.line):
            ready, _, _ = select.select([self.descriptor], [], [], HANG_S)
            assert ready, f"never seen: {pattern}\n{self.text}"
            self.stream.feed(os.read(self.descriptor, 65536))


@contextmanager
def terminal(shell: str, folder: Path) -> Iterator[Terminal]:
    words, source = START[shell]
    program = shutil.which(words[0])
    if program is None:
        pytest.skip(f"{shell} is not installed")
    child, descriptor = pty.fork()
    if child == 0:
        os.chdir(folder)
        os.execve(program, list(words), environment(folder))  # noqa: S606 - a shell on a terminal is what is tested
    screen = pyte.Screen(COLUMNS, ROWS)
    try:
        fcntl.ioctl(descriptor, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
        opened = Terminal(descriptor, screen, pyte.ByteStream(screen))
        opened.until(r"\S", anywhere=True)
        opened.type(f"{source}; echo ready for $((6 * 7))\n" if shell != "fish" else f"{source}; echo ready for 4'2'\n")
        opened.until("ready for 42", anywhere=True)
        opened.until(r"^(\S+ \S+)?[$%#>] ?$")
        yield opened
    finally:
        with suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        os.close(descriptor)


def environment(folder: Path) -> dict[str, str]:
    return {
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "HOME": str(folder),
        "ATLANTIS_STATE": str(folder / "state"),
        "LANG": "C.UTF-8",
        "TERM": "xterm",
        "PS1": "$ ",
        "PROMPT": "%% ",
    }


def run(folder: Path) -> str:
    started = RunStart(site="coastal", revision="", tool="", hosts=(), rehearsed=False, command="provision")
    with Store(folder / "state").start(started) as journal:
        return journal.run


@pytest.mark.smoke("bash")
@pytest.mark.parametrize("shell", START)
def test_a_line_is_completed_word_by_word(shell: str, tmp_path: Path) -> None:
    name = run(tmp_path)
    with terminal(shell, tmp_path) as opened:
        for typed, completed in (
            ("provision rec\t", "provision recover "),
            ("rollb\t", "provision recover rollback "),
            ("si\t", "provision recover rollback site="),
            ("coa\t", "provision recover rollback site=coastal "),
            ("run=2\t", f"provision recover rollback site=coastal run={name} "),
            ("device=coastal-r\t", f"provision recover rollback site=coastal run={name} device=coastal-router "),
            ("--y\t", f"provision recover rollback site=coastal run={name} device=coastal-router --yes "),
        ):
            opened.type(typed)
            opened.until(rf"{re.escape(completed)}$")


@pytest.mark.parametrize("shell", START)
def test_a_list_is_completed_behind_its_comma(shell: str, tmp_path: Path) -> None:
    with terminal(shell, tmp_path) as opened:
        opened.type("provision check site=coastal endpoint=wifi,g\t")
        opened.until(r"site=coastal endpoint=wifi,gps ?$")
        opened.type(" vehicle=girona500,sp\t")
        opened.until(r"endpoint=wifi,gps +vehicle=girona500,sparus ?$")


@pytest.mark.parametrize("shell", START)
def test_double_tab_lists_the_candidates(shell: str, tmp_path: Path) -> None:
    with terminal(shell, tmp_path) as opened:
        opened.type("provision vpn \t\t")
        opened.until(r"(?s)onboard.*status", anywhere=True)
        opened.until(r"provision vpn ")


@pytest.mark.parametrize("shell", START)
def test_relative_program_path_is_completed_too(shell: str, tmp_path: Path) -> None:
    """`./provision` of a checkout is not in the PATH."""
    (tmp_path / "provision").symlink_to(Path(sys.executable).with_name("provision"))
    with terminal(shell, tmp_path) as opened:
        opened.type("./provision report drift site=te\t")
        opened.until(r"\./provision report drift site=te4sea $")


@pytest.mark.parametrize("shell", START)
def test_a_broken_inventory_prints_nothing_into_the_line(shell: str, tmp_path: Path) -> None:
    (tmp_path / "inventory").mkdir()
    (tmp_path / "inventory" / "hosts.yml").write_text("all: [\n", encoding="utf-8")
    with terminal(shell, tmp_path) as opened:
        opened.type("provision report drift inventory=inventory site=zz\t")
        opened.type("9 --js\t")
        opened.until(r"site=zz9 --json $")
        assert not re.search("(?i)error|traceback", opened.text)


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_option_with_a_file_argument_completes_file_names(shell: str, tmp_path: Path) -> None:
    (tmp_path / "answers-of-today.yml").touch()
    with terminal(shell, tmp_path) as opened:
        opened.type("provision check site=coastal --answers ans\t")
        opened.until(r"--answers answers-of-today.yml $")


def test_completion_never_sets_up_the_environment(tmp_path: Path) -> None:
    """In a fresh clone the first start fetches packages; a person who presses Tab has not asked for that."""
    checkout = Path(__file__).parents[4]
    for name in ("provision", "pyproject.toml", "tools/venv.sh", "requirements"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        copy = shutil.copytree if (checkout / name).is_dir() else shutil.copy
        copy(checkout / name, tmp_path / name)
    done = subprocess.run([tmp_path / "provision", "complete", "si"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert not (tmp_path / ".venv").exists()
    assert not (tmp_path / ".venv-setup").exists()
