"""A RouterOS console in a few lines, for the client's tests: echo, prompt, a table of answers, questions of a login.

It is written from the manual's transcripts and repaints its prompt as a device does; the twin is the other counterpart.
"""

import os
import re
import threading
import tty
from collections.abc import Iterator
from dataclasses import dataclass, field

from waiting import HANG_S

from atlantis_netcfg.routeros.console.types import WireLost

ERROR = "\0"
"""Before an answer of the table: the line stops there."""


@dataclass(slots=True)
class Desk:
    """What is typed goes into `feed`, what is shown comes out of it."""

    answers: dict[str, str] = field(default_factory=dict)
    questions: list[str] = field(default_factory=list)
    """Asked one after another before the first prompt; any key answers."""
    password: str | None = None
    """With one it begins at a login prompt, as a serial line does."""
    held: bool = False
    """Somebody else holds safe mode."""
    safe: bool = False
    logged_in: bool = True
    lost_at: str | None = None
    """The line goes dead when this is typed."""
    typed: list[str] = field(default_factory=list)
    undone: bool = False
    mute: bool = False
    _line: str = ""
    _state: str = "shell"
    _name: str = ""

    def begin(self) -> str:
        if self.password is not None and not self.logged_in:
            self._state = "login"
            return "\r\nMikroTik 7.18.2 (stable)\r\nMikroTik Login: "
        return "\r\n\r\n  MikroTik RouterOS 7.18.2\r\n\r\n" + self._enter()

    @property
    def prompt(self) -> str:
        return f"[admin@MikroTik] {'<SAFE>' if self.safe else ''}> "

    def feed(self, data: str) -> str:
        return "" if self.mute else "".join(map(self._key, data))

    def _enter(self) -> str:
        if self.questions:
            self._state = "question"
            return self.questions[0]
        self._state = "shell"
        return f"\r\x1b[K{self.prompt}"

    def _key(self, key: str) -> str:  # noqa: PLR0911 - one a key
        if self._state == "question":
            self.typed.append(key)
            self.questions.pop(0)
            return "\r\n" + self._enter()
        if self._state == "hijack":
            self._state = "shell"
            self.typed.append(key)
            return f"{key}\r\n{self.prompt}"
        if key == "\x18":
            return self._safe()
        if key == "\x04" and self._state == "shell":
            self.undone, self.safe, self.logged_in = self.safe, False, False
            return self.begin()
        if key == "\x03":
            self._line = ""
            return f"\r\n{self.prompt}" if self._state == "shell" else self.begin() if self.password else ""
        if key == "\r":
            line, self._line = self._line, ""
            return self._enter_line(line)
        self._line += key
        return key if self._state != "password" else ""

    def _safe(self) -> str:
        if self.held:
            self._state = "hijack"
            return "\r\nHijacking Safe Mode from someone - unroll/release/don't take it [u/r/d]: "
        self.safe = not self.safe
        said = "taken" if self.safe else "released"
        return f"\r\n[Safe Mode {said}]\r\n{self.prompt}"

    def _enter_line(self, line: str) -> str:
        if self._state == "login" and not line:
            return "\r\nMikroTik Login: "
        if self._state == "login":
            self._name, self._state = line, "password"
            return "\r\nPassword: "
        if self._state == "password":
            if line == self.password:
                self.logged_in = True
                return "\r\n" + self._enter()
            self._state = "login"
            return "\r\nLogin failed, incorrect username or password\r\n\r\nMikroTik Login: "
        self.typed.append(line)
        if line == self.lost_at:
            raise WireLost
        if line == "/quit":
            self.logged_in = False
            return self.begin() if self.password is not None else ""
        repainted = f"\r{self.prompt}{line}\r\n"
        return repainted + "".join(self._run(line)) + f"\r\n\r{self.prompt}\r\x1b[K{self.prompt}"

    def _run(self, line: str) -> Iterator[str]:
        for part in line.split("; "):
            if put := re.fullmatch(r':put "(.*)"', part):
                yield f"{put[1]}\r\n"
                continue
            answer = self.answers.get(part, f"{ERROR}bad command name {part} (line 1 column 1)")
            yield answer.removeprefix(ERROR).replace("\n", "\r\n") + ("\r\n" if answer else "")
            if answer.startswith(ERROR):
                return


class DeskWire:
    """A desk at the end of a wire, `piece` bytes at a time."""

    def __init__(self, desk: Desk, piece: int = 65536) -> None:
        self._desk = desk
        self._piece = piece
        self._out = desk.begin().encode()
        self.closed = self.hung_up = False

    def read(self, timeout_s: float) -> bytes:
        del timeout_s  # nothing comes later by itself
        piece, self._out = self._out[: self._piece], self._out[self._piece :]
        return piece

    def write(self, data: bytes) -> None:
        if self.closed:
            raise WireLost
        self._out += self._desk.feed(data.decode()).encode()

    def close(self) -> None:
        self.closed = True

    def hang_up(self) -> None:
        self.hung_up = True


class DeskLine:
    """A desk at the end of a serial line; a context manager that gives the path of the tty."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> str:
        self._thread.start()
        return os.ttyname(self._theirs)

    def __exit__(self, *_: object) -> None:
        os.write(self._theirs, b"")
        os.close(self._theirs)
        self._thread.join(HANG_S)
        os.close(self._ours)

    def _serve(self) -> None:
        while True:
            try:
                data = os.read(self._ours, 1024)
            except OSError:
                return
            if not data:
                return
            os.write(self._ours, self._desk.feed(data.decode()).encode())
