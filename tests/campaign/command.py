"""One `provision` as a person starts it: its processes, its output, and what is left of it."""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

from campaign.site import ADDRESSES

_MARK = "ATLANTIS_CAMPAIGN"
SILENCE_S = 30.0
ORPHAN_S = 3.0
"""What a process may need to notice that it is not wanted any more."""
ANSWERS = 12
"""To so many questions of one command."""
_POLL_S = 0.02
_REMINDER = b"  still running, "
"""How `provision` begins what it says while it waits (`cli/base/output.py`)."""
_NO_RESULT = ("not supported yet", "SKIP")
_EXEMPT = (signal.SIGKILL, signal.SIGSTOP)
"""Who was struck by these cannot speak."""


@dataclass
class Ended:
    typed: tuple[str, ...]
    code: int | None
    """None: it had to be killed by us."""
    out: str
    err: str
    seconds: float
    silent_s: float
    """The longest time without a word, while it was not stopped."""
    orphans: list[int]
    """Processes of it that lived on after a fair while."""
    struck: bool = False
    """A fault killed or stopped the process that the person started."""
    closed: bool = False
    """Nobody has read its output to its end."""

    @property
    def output(self) -> str:
        return f"{self.err}\n{self.out}"

    @property
    def told(self) -> dict[str, Any]:
        """The object of `--json`; empty: there is none."""
        try:
            found: object = json.loads(self.out.strip().splitlines()[-1])
        except (IndexError, ValueError):
            return {}
        return found if isinstance(found, dict) else {}

    @property
    def devices(self) -> dict[str, Any] | None:
        """What `--json` says of each device, or of its only one; None: no such object."""
        if "device" in self.told:
            return {self.told["device"]: self.told}
        found: dict[str, Any] | None = self.told.get("devices")
        return found

    @property
    def runs(self) -> list[str]:
        """The names under which it says that it is recorded."""
        if self.told:
            return [*self.told.get("runs", ()), *filter(None, [self.told.get("run")])]
        found = re.findall(r"(?m)^ *record(?:ed as)? +(.+?)(?: in|$)", self.out)
        return [name for names in found for name in names.split(", ")]

    @property
    def changed_nothing(self) -> bool:
        """An upgrade to what runs already, which is no run."""
        return self.told.get("status") == "unchanged" or "unchanged: RouterOS" in self.out

    @property
    def results(self) -> Collection[str]:
        """The hosts that have a result; of an output that nobody has read to its end, all of them."""
        if self.closed:
            return ADDRESSES
        if self.devices is not None:
            return [
                name
                for name, result in self.devices.items()
                if result.get("status", result.get("verdict")) not in _NO_RESULT
            ]
        return re.findall(r"(?m)^(?:  )?([\w-]+)(?: +|: )(?!not handled yet)\S", self.out)

    @property
    def advice_text(self) -> str:
        """What a person reads of it: of JSON, its messages and hints."""
        if not self.told:
            return self.output
        rows = [*self.told.get("errors", []), *([self.told] if "message" in self.told else [])]
        return self.err + "\n" + "\n".join(f"{row.get('message')}\n{row.get('hint') or ''}" for row in rows)


@dataclass
class Command:
    typed: tuple[str, ...]
    environment: Mapping[str, str]
    folder: Path
    closes: bool = False
    """Both outputs are closed by their reader after the first line (`| head -1`)."""
    answer: str = ""
    """A person types it on a terminal, to whatever is asked; without it nobody is there."""
    lines: int = 0
    struck: bool = False
    stopped: bool = False
    _heard: list[tuple[str, str]] = field(default_factory=list)
    _last: float = 0.0
    _news: float = 0.0
    _silent_s: float = 0.0
    on_line: Callable[[int], None] = lambda _count: None

    def start(self, python: str) -> None:
        self.begun = self._last = self._news = time.monotonic()
        keyboard, terminal = os.openpty()
        os.write(keyboard, f"{self.answer}\n".encode() * ANSWERS)
        self.process = subprocess.Popen(
            [python, "-P", "-m", "atlantis_netcfg", *self.typed],
            env={**self.environment, **dict([self.mark.split("=")])},
            cwd=self.folder,
            stdin=terminal if self.answer else subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        os.close(terminal)
        self._keyboard = keyboard
        assert self.process.stdout is not None
        assert self.process.stderr is not None
        self._readers = [
            threading.Thread(target=self._listen, args=(name, pipe), daemon=True)
            for name, pipe in (("out", self.process.stdout), ("err", self.process.stderr))
        ]
        for reader in self._readers:
            reader.start()

    def _listen(self, name: str, pipe: IO[bytes]) -> None:
        with contextlib.suppress(OSError, ValueError):
            before = b""
            for line in pipe:
                self._heard.append((name, line.decode(errors="replace")))
                self._note(news=_REMINDER not in line and line != before)
                before = line
                self.lines += 1
                self.on_line(self.lines)
                if self.closes:
                    self.struck = True  # what it says from now on nobody hears
                    break
            pipe.close()

    def _note(self, *, news: bool) -> None:
        now = time.monotonic()
        self._silent_s = max(self._silent_s, now - self._last)
        self._last = now
        self._news = now if news else self._news

    @property
    def mark(self) -> str:
        """What stands in the environment of its processes, and of no others."""
        return f"{_MARK}={os.getpid()}-{id(self)}"

    @property
    def quiet_s(self) -> float:
        """Seconds since its last word."""
        return time.monotonic() - self._last

    @property
    def idle_s(self) -> float:
        """Seconds since it has told something new: that it is still at work is a word, but no news."""
        return time.monotonic() - self._news

    @property
    def alive(self) -> bool:
        return self.process.poll() is None

    def processes(self) -> list[int]:
        """It and its descendants, parents first."""
        return family(self.process.pid)

    def signal(self, number: signal.Signals, pids: Sequence[int]) -> None:
        self.struck |= number in _EXEMPT and self.process.pid in pids
        for pid in pids:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, number)
        if number == signal.SIGSTOP:
            self.stopped = True
        if number == signal.SIGCONT:
            self.stopped = False
            self._last = self._news = time.monotonic()

    def finish(self, *, killed: bool = False) -> Ended:
        """Gather what it said once it has ended, or end it."""
        if killed:
            for pid in reversed(self.processes()):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
        code = self.process.wait()
        if not self.stopped and not self.closes:
            self._silent_s = max(self._silent_s, self.quiet_s)
        os.close(self._keyboard)
        orphans = living(self.mark, ORPHAN_S)
        for reader in self._readers:
            reader.join(0.5 if orphans else 5)
        return Ended(
            self.typed,
            None if killed else code,
            self._said("out"),
            self._said("err"),
            time.monotonic() - self.begun,
            self._silent_s,
            orphans,
            self.struck,
            self.closes,
        )

    def _said(self, name: str) -> str:
        return "".join(line for heard, line in self._heard if heard == name)


def living(mark: str, seconds: float) -> list[int]:
    until = time.monotonic() + seconds
    while (left := marked(mark)) and time.monotonic() < until:
        time.sleep(_POLL_S)
    return left


def end(pids: Sequence[int]) -> list[str]:
    """End processes that should not be there, so that the next round is not disturbed; what they were."""
    words = [f"{pid} {cmdline(pid)[:100]}" for pid in pids]
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)
            os.kill(pid, signal.SIGKILL)
    return words


def _of_processes(name: str) -> list[Path]:
    """A file of each process; one that has ended meanwhile has none, which a glob would stumble over."""
    return [folder / name for folder in Path("/proc").iterdir() if folder.name.isdecimal()]


def family(pid: int) -> list[int]:
    """A process and all its descendants, parents first."""
    children: dict[int, list[int]] = {}
    for each in _of_processes("stat"):
        with contextlib.suppress(OSError, IndexError):
            text = each.read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
            if text[0] not in "ZX":
                children.setdefault(int(text[1]), []).append(int(each.parent.name))
    found = [pid]
    for one in found:
        found += sorted(children.get(one, ()))
    return found


def marked(mark: str) -> list[int]:
    found = []
    for each in _of_processes("environ"):
        with contextlib.suppress(OSError):
            if mark.encode() in each.read_bytes().split(b"\0") and not _dead(int(each.parent.name)):
                found.append(int(each.parent.name))
    return found


def _dead(pid: int) -> bool:
    text = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace")
    return text.rpartition(")")[2].split()[0] in "ZX"


def cmdline(pid: int) -> str:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace").strip()
    return "?"


PYTHON = str(Path(sys.executable))
