"""An emulated 4G modem behind a pseudo-terminal: it responds to reads, and counts everything else.

It emulates the dialogue (echo, unsolicited lines, noise, slow bytes, errors as numbers, text or bare) and the states of
a card and a network; the figures are constant. Commands that set something are not executed but counted in `forbidden`:
our driver must never send any.
"""

from __future__ import annotations

import os
import select
import threading
import tty
from typing import TYPE_CHECKING, Self

from pydantic import BaseModel, ConfigDict

if TYPE_CHECKING:
    from types import TracebackType


__all__ = ["NOT_REHEARSED", "AtModemSpec", "RunningModem"]


NOT_REHEARSED = ("an AT modem: USB, its other ports, and programs that try to open it",)


class AtModemSpec(BaseModel):
    """An emulated modem, its card, and the radio conditions."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    maker: str = "Quectel"
    card: str = "READY"
    """Response to `+CPIN?`: READY, SIM PIN, SIM PUK, or a final result like `+CME ERROR: 10`."""
    function: int = 1
    """Response to `+CFUN?`."""
    eps: int | None = 1
    """`<stat>` of `+CEREG?`; None: the modem does not know the command."""
    packet: int | None = 1
    circuit: int | None = 1
    operator: str = '0,0,"EXAMPLE-OPERATOR",7'
    csq: str = "24,99"
    cesq: str = "99,99,255,255,21,46"
    apn: str = "internet"
    """APN of the active context."""
    address: str = "100.64.12.35"
    """Address of the active context; empty: none is active."""
    echo: bool = True
    unsolicited_lines: tuple[str, ...] = ()
    """Lines inserted before each response."""
    noise: bytes = b""
    """Bytes inserted before each response."""
    piecewise: bool = False
    """Output is sent byte by byte."""
    mute_after: int | None = None
    """Number of commands that get a response; later ones get none. None: unlimited."""

    def answer(self, command: str) -> list[str] | None:
        """Return the response lines, final result last; None if the command is no known read."""
        stats = {"AT+CEREG?": self.eps, "AT+CGREG?": self.packet, "AT+CREG?": self.circuit}
        if command in stats:
            stat = stats[command]
            return ["ERROR"] if stat is None else [f"{command[2:-1]}: 0,{stat}", "OK"]
        if command == "AT+CPIN?":
            return [self.card] if self.card.startswith(("+CM", "ERROR")) else [f"+CPIN: {self.card}", "OK"]
        responses = self._fixed_responses()
        if command not in responses:
            return None
        return [*responses[command], "OK"]

    def _fixed_responses(self) -> dict[str, list[str]]:
        up = bool(self.address)
        rdp = f'+CGCONTRDP: 1,5,"{self.apn}.mnc003.mcc268.gprs","{self.address}.255.255.255.255"'
        responses = {
            "ATI": [self.maker, "EXAMPLE-MODEM"],
            "AT+CGMI": [self.maker],
            "AT+CGMM": ["EXAMPLE-MODEM"],
            "AT+CGMR": ["EXAMPLE-1.0"],
            "AT+CFUN?": [f"+CFUN: {self.function}"],
            "AT+COPS?": [f"+COPS: {self.operator}"],
            "AT+CSQ": [f"+CSQ: {self.csq}"],
            "AT+CESQ": [f"+CESQ: {self.cesq}"],
            "AT+CGACT?": [f"+CGACT: 1,{int(up)}", "+CGACT: 2,0"],
            "AT+CGPADDR": [f'+CGPADDR: 1,"{self.address}"'] if up else ['+CGPADDR: 1,"0.0.0.0"'],
            "AT+CGDCONT?": [f'+CGDCONT: 1,"IP","{self.apn}","0.0.0.0",0,0', '+CGDCONT: 2,"IPV4V6","ims","",0,0'],
            "AT+CGCONTRDP": [rdp] if up else [],
        }
        if self.maker == "Quectel":
            responses["AT+QNWINFO"] = ['+QNWINFO: "FDD LTE","26803","LTE BAND 3",1300']
        return responses


class RunningModem:
    """The modem, running in a thread; `path` is its port during the context."""

    def __init__(self, spec: AtModemSpec) -> None:
        self.spec = spec
        self.path = ""
        self.inputs: list[str] = []
        """All lines received."""
        self.forbidden: list[str] = []
        """Received lines that are not a known read command."""
        self._thread = threading.Thread(target=self._run, name="twin of a modem", daemon=True)

    def __enter__(self) -> Self:
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        self.path = os.ttyname(self._theirs)
        self._stop, self._stopper = os.pipe()
        # Our own hold on the far end would look like somebody who has the port; the near end survives without it.
        os.close(self._theirs)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._stopper)
        self._thread.join()
        os.close(self._stop)
        os.close(self._ours)

    def _run(self) -> None:
        waiting = b""
        poll = select.poll()
        poll.register(self._stop, select.POLLIN)
        poll.register(self._ours, select.POLLIN)
        while True:
            ready = dict(poll.poll())
            if self._stop in ready:
                return
            if not ready.get(self._ours, 0) & select.POLLIN:
                self._nobody()
                continue
            waiting += os.read(self._ours, 4096)
            *lines, waiting = waiting.split(b"\r")
            for line in lines:
                self._answer_line(line.decode("ascii", "replace").strip("\n"))

    def _nobody(self) -> None:
        """Pause briefly: with a closed far end, poll returns at once every time."""
        select.select([self._stop], [], [], 0.01)

    def _answer_line(self, line: str) -> None:
        if not line:
            return
        self.inputs.append(line)
        answer = self.spec.answer(line)
        if answer is None:
            self.forbidden.append(line)
            answer = ["ERROR"]
        if self.spec.mute_after is not None and len(self.inputs) > self.spec.mute_after:
            return
        out = f"{line}\r".encode() if self.spec.echo else b""
        out += self.spec.noise
        out += b"".join(f"\r\n{each}\r\n".encode() for each in (*self.spec.unsolicited_lines, *answer))
        for piece in [out[place : place + 1] for place in range(len(out))] if self.spec.piecewise else [out]:
            os.write(self._ours, piece)
