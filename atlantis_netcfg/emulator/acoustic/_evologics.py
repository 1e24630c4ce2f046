"""An emulated EvoLogics S2C modem: framing, queries, settings and notifications."""

from __future__ import annotations

import re
import time

from pydantic import Field

from atlantis_netcfg.emulator.acoustic._line import LineSpec, ModemLine

_WATER_MPS = 1500.0
_READS = re.compile(rb"AT\?(?:S|E|I|T|V|P|BL|BR|BV|CLOCK|CA|AL|AR|L|ZU)|ATI[0-9]|AT&V")
_SEND = re.compile(rb"\+\+\+(AT\*SENDIM,(\d{1,2}),(\d{1,3}),(?:ack|noack),)")
_MULTIPATH = "10    10   \n11    12   \n12    14   \n13    16   \n15    18   \n16    20   \n17    22   \n100   240  \n"


class EvologicsSpec(LineSpec):
    """Settings of a modem and its surroundings; default: healthy, power low enough for air, another modem in range."""

    local_address: int = 1
    highest_address: int = 14
    source_level: int = 3
    carrier: int = 2
    packet_time_ms: int = 750
    sound_speed_mps: int = 1500
    old_spelling: bool = True
    """Firmware 1.7 writes `IM Rerty Count`."""
    pending: tuple[str, ...] = ()
    """Names of settings shown with the prefix `[*]`."""
    more_settings: tuple[tuple[str, str], ...] = ()
    """Additional lines of the listing, unknown to every driver."""
    state: str = "INITIATION LISTEN"
    firmware: str = "EXAMPLE-1.7"
    phy: str = "EXAMPLE-PHY"
    maker: str = "EXAMPLE-MAKER"
    rssi_db: int = -54
    integrity: int = 146
    battery_v: float | None = 24.1
    """Battery voltage; None: the modem does not support the query."""
    busy: tuple[str, ...] = ()
    """Queries to which the modem responds with BUSY."""
    bare: bool = False
    """Responses have no frame, as in command mode."""
    before: tuple[bytes, ...] = ()
    """Sent before each response: whole frames, bare lines, raw data of a connection."""
    tells_fixes: bool = True
    """Response to `AT?ZU`: whether the modem outputs position fixes."""
    hears: tuple[int, ...] = (2,)
    """Remote addresses with position fixes."""
    fix_every_s: float = Field(default=0.05, gt=0)
    fixes: int | None = Field(default=None, ge=0)
    """Number of rounds of fixes for each client; None: unlimited."""
    directions_only: bool = False
    """USBLANGLES instead of USBLLONG."""
    bare_fixes: bool = False
    range_m: float = 14.065
    position_scale: float = 1.0
    """Factor by which the reported position is too far away for the propagation time."""
    fix_rssi_db: int = -54
    fix_integrity: int = 106
    fix_age_s: float = 0.305
    """Seconds between measurement and output on the modem's clock; negative: the measurement is in the future."""
    fix_accuracy: float = 0.1698
    frozen: bool = False
    """The first fix is repeated."""
    clock_ahead_s: float | None = None
    """Seconds by which its clock (since 1970) is ahead of this computer; None: its clock counts from power-on."""
    in_water: bool = False
    """Whether it may transmit; transmitting in air causes damage."""
    reaches: tuple[int, ...] = (2,)
    """Addresses that acknowledge a message."""
    reports: bool = True
    """The modem reports whether a message was delivered."""

    def listing(self) -> bytes:
        """Return the response to `AT&V`, with an empty line at its end when framed."""
        retry = "IM Rerty Count" if self.old_spelling else "IM Retry Count"
        settings: dict[str, object] = {
            "Source Level": self.source_level,
            "Source Level Control": 0,
            "Gain": 0,
            "Carrier Waveform ID": self.carrier,
            "Local Address": self.local_address,
            "Highest Address": self.highest_address,
            "Cluster Size": 10,
            "Packet Time": self.packet_time_ms,
            "Retry Count": 3,
            "Retry Timeout": 1500,
            "Wake Up Active Time": 12,
            "Wake Up Period": 12,
            "Promiscuous Mode": 1,
            "Sound Speed": self.sound_speed_mps,
            retry: 1,
            "Pool Size": 16384,
            "Hold Timeout": 0,
            "Idle Timeout": 120,
        }
        lines = [*settings.items(), *self.more_settings]
        return "".join(f"{'[*]' if n in self.pending else ''}{n}: {value}\r\n" for n, value in lines).encode()

    def values(self) -> dict[str, str]:
        """Return one-line responses by query."""
        responses = {
            "AT?S": f"{self.state} 16384" if self.state == "INITIATION LISTEN" else self.state,
            "AT?E": str(self.rssi_db),
            "AT?I": str(self.integrity),
            "AT?T": f"{self.range_m / _WATER_MPS * 1e6:.0f}",
            "AT?V": "0.03",
            "AT?P": _MULTIPATH,
            "AT?BL": "976",
            "AT?BR": "976",
            "AT?CLOCK": f"{time.monotonic():.6f}",
            "AT?CA": str(self.sound_speed_mps),
            "AT?AL": str(self.local_address),
            "AT?AR": "0",
            "AT?L": f"{'[*]' if 'Source Level' in self.pending else ''}{self.source_level}",
            "AT?ZU": str(int(self.tells_fixes)),
            "ATI0": self.firmware,
            "ATI1": self.phy,
            "ATI7": self.maker,
        }
        return responses if self.battery_v is None else {**responses, "AT?BV": str(self.battery_v)}

    def fix(self, remote: int, clock_s: float) -> bytes:
        """Return one position notification, framed or bare; `clock_s`: time of the modem's clock."""
        head = f"{clock_s:.6f},{clock_s - self.fix_age_s:.6f},{remote}"
        quality = f"{self.fix_rssi_db},{self.fix_integrity},{self.fix_accuracy}"
        if self.directions_only:
            text = f"USBLANGLES,{head},0.2266,0.1234,0.2266,0.1234,0.0000,-0.0000,0.0000,{quality}"
        else:
            # The direction of the first fixture of devices.md.
            x, y, z = (part * self.range_m / 14.065 * self.position_scale for part in (13.6015, 3.1369, 1.7311))
            place = f"{x:.4f},{y:.4f},{z:.4f}"
            time_us = self.range_m / _WATER_MPS * 1e6
            text = f"USBLLONG,{head},{place},{place},0.0000,-0.0000,0.0000,{time_us:.0f},{quality}"
        return f"{text}\r\n".encode() if self.bare_fixes else _frame("AT", text.encode())


def _frame(command: str, body: bytes) -> bytes:
    return b"+++%b:%d:%b\r\n" % (command.encode(), len(body), body)


class _EvologicsTalk:
    """One client's connection, in data mode."""

    def __init__(self, modem: RunningEvologics) -> None:
        self.modem, self.spec = modem, modem.spec
        self.rounds = 0
        ahead_s = self.spec.clock_ahead_s
        self.clock_s = time.monotonic() if ahead_s is None else time.time() + ahead_s
        """Time of the modem's clock when the service starts."""

    def hear(self, waiting: bytes) -> tuple[list[bytes], bytes]:
        answers: list[bytes] = []
        while (pair := self._command(waiting)) is not None:
            command, waiting = pair
            answers.append(b"".join(self.spec.before) + self._answer(command))
        return answers, waiting

    @staticmethod
    def _command(waiting: bytes) -> tuple[bytes, bytes] | None:
        """Return the first complete command and the rest; a message has a length, other commands end with a newline."""
        if send := _SEND.match(waiting):
            end = send.end() + int(send[2])
            return (waiting[:end], waiting[end + 1 :]) if len(waiting) > end else None
        line, newline, rest = waiting.partition(b"\n")
        return (line, rest) if newline else None

    def _answer(self, line: bytes) -> bytes:
        self.modem.inputs.append(line)
        command = line.removeprefix(b"+++")
        if send := _SEND.match(line):
            return self._send(int(send[3]), line[send.end() :])
        if not line.startswith(b"+++") or not _READS.fullmatch(command):
            # Without `+++` it is data for the connection: the modem would transmit it.
            self.modem.forbidden.append(line)
            return self._format_reply("AT", b"ERROR WRONG COMMAND")
        return self._format_reply(command.decode(), self._query_response(command.decode()))

    def _query_response(self, query: str) -> bytes:
        if query in self.spec.busy:
            return b"BUSY EXAMPLE"
        if query == "AT&V":
            return self.spec.listing()
        responses = self.spec.values()
        return responses[query].encode() if query in responses else b"ERROR WRONG QUERY"

    def _format_reply(self, command: str, body: bytes) -> bytes:
        return body + b"\r\n" if self.spec.bare else _frame(command, body)

    def _send(self, to: int, text: bytes) -> bytes:
        self.modem.transmitted.append((to, text))
        if not self.spec.in_water:
            self.modem.transmitted_in_air.append((to, text))
        report = "DELIVEREDIM" if to in self.spec.reaches else "FAILEDIM"
        data = _frame("AT", f"{report},{to}".encode()) if self.spec.reports else b""
        return _frame("AT*SENDIM", b"OK") + _frame("AT", b"SENDSTART,%d,im,182272,0" % to) + data

    def tell(self, now_s: float) -> tuple[bytes, float | None]:
        spec = self.spec
        if not spec.tells_fixes or not spec.hears or spec.fixes == self.rounds:
            return b"", None
        if now_s < (self.rounds + 1) * spec.fix_every_s:
            return b"", (self.rounds + 1) * spec.fix_every_s
        self.rounds += 1
        clock_s = self.clock_s + (spec.fix_every_s if spec.frozen else now_s)
        data = b"".join(spec.fix(remote, clock_s) for remote in spec.hears)
        return data, (self.rounds + 1) * spec.fix_every_s


class RunningEvologics(ModemLine):
    """The modem in a thread."""

    def __init__(self, spec: EvologicsSpec) -> None:
        super().__init__(spec)
        self.spec = spec
        self.inputs: list[bytes] = []
        """All commands received."""
        self.forbidden: list[bytes] = []
        """Received commands that are neither reads nor messages."""
        self.transmitted: list[tuple[int, bytes]] = []
        """Transmitted messages: address and content."""
        self.transmitted_in_air: list[tuple[int, bytes]] = []
        """Messages transmitted while the modem was not in the water, which would damage it."""

    def talker(self) -> _EvologicsTalk:
        """Return a handler for the AT protocol in data mode."""
        return _EvologicsTalk(self)
