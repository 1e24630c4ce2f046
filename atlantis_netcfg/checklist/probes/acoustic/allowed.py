"""What may be sent to an acoustic modem: two tables, and the only functions that make a saying for one.

Sources: the makers' commands as public drivers name them (devices.md 5.1 and 5.2). Everything that is not on a table is
refused, and so is whatever a table names as never to be sent; `refused` looks at the finished bytes, so that no saying
that was made elsewhere passes either. An EvoLogics modem in data mode transmits what does not begin with `+++AT`: no
command is ever sent without.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes.acoustic import seatrac
from atlantis_netcfg.checklist.probes.requests import Say
from atlantis_netcfg.core.errors import NetcfgError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.checklist.probes.step import Consent

__all__ = ["EVOLOGICS", "SEATRAC", "Command", "NeverSaid", "Use", "ask_at", "ask_seatrac", "message", "ping", "refused"]

_IN_WATER = "in the water"


class Use(StrEnum):
    """What sending a command does."""

    READ = "read"
    NEVER = "never"
    """It changes a setting, takes control or ends a session."""
    ACTIVE = "active"
    """It transmits: one step each, and only with a person's consent."""


@dataclass(frozen=True, slots=True)
class Command:
    """A line of a table."""

    use: Use
    what: str
    """What it does."""


class NeverSaid(NetcfgError, ValueError):
    """A command that is on no list: it has not left this computer."""


EVOLOGICS: Mapping[bytes, Command] = {
    rb"AT\?(S|E|I|T|V|P|BL|BR|BV|CLOCK|CA|AL|AR|L|ZU)": Command(Use.READ, "a query"),
    rb"ATI[0-9]": Command(Use.READ, "who the modem is"),
    rb"AT&V": Command(Use.READ, "all settings"),
    rb"AT\*SENDIM,[0-9]{1,2},[0-9]{1,3},ack,[!-~]{1,64}": Command(Use.ACTIVE, "transmits an instant message"),
    rb"AT!.*": Command(Use.NEVER, "changes a setting"),
    rb"AT@.*": Command(Use.NEVER, "takes control, or changes a setting"),
    rb"AT&W.*": Command(Use.NEVER, "stores settings"),
    rb"AT&F.*": Command(Use.NEVER, "goes back to the factory's settings"),
    rb"ATZ.*": Command(Use.NEVER, "drops data, connections or settings"),
    rb"AT[ANDHCO].*": Command(Use.NEVER, "begins or ends a connection, or changes the mode"),
    rb"AT\*SEND.*": Command(Use.NEVER, "transmits"),
    rb"": Command(Use.NEVER, "switches to command mode"),
}
"""Full match of a command between `+++` and the end of the line."""

SEATRAC: Mapping[int, Command] = {
    0x01: Command(Use.READ, "alive"),
    0x02: Command(Use.READ, "part, serial number, firmware"),
    0x10: Command(Use.READ, "status: supply, depth, sound speed, attitude"),
    0x11: Command(Use.READ, "status output"),
    0x15: Command(Use.READ, "settings"),
    0x21: Command(Use.READ, "calibration"),
    0x3A: Command(Use.READ, "transceiver"),
    0x03: Command(Use.NEVER, "restarts the beacon"),
    0x0D: Command(Use.NEVER, "writes firmware"),
    0x0E: Command(Use.NEVER, "writes firmware"),
    0x0F: Command(Use.NEVER, "writes firmware"),
    0x12: Command(Use.NEVER, "changes the status output"),
    0x16: Command(Use.NEVER, "changes settings"),
    0x17: Command(Use.NEVER, "changes settings"),
    0x18: Command(Use.NEVER, "stores settings"),
    0x19: Command(Use.NEVER, "resets settings"),
    0x20: Command(Use.NEVER, "calibrates"),
    0x22: Command(Use.NEVER, "calibrates"),
    0x40: Command(Use.ACTIVE, "transmits a ping"),
    0x48: Command(Use.ACTIVE, "transmits"),
    0x50: Command(Use.ACTIVE, "transmits"),
    0x5B: Command(Use.ACTIVE, "transmits"),
    0x60: Command(Use.ACTIVE, "transmits"),
}
"""Command of a beacon by its number."""

_PING = 0x40
_WITH_USBL = 0x04
"""MSG_REQU: the answer is asked for, and its direction measured."""
_BEACONS = range(1, 16)
_ADDRESSES = range(1, 255)
_LONGEST = 64
_READ_S = 3.0


def refused(data: bytes, *, active: bool) -> str | None:
    """Say why bytes must not be sent to a modem; None: they may. `active`: a person has consented to a transmission."""
    if data.startswith(b"#"):
        return _refused_seatrac(data, active=active)
    if data.startswith(b"+++"):
        return _refused_evologics(data, active=active)
    return f"{data!r} is on no list of what may be said"


def _refused_evologics(data: bytes, *, active: bool) -> str | None:
    body = data.removeprefix(b"+++").removesuffix(b"\n")
    known = next((command for pattern, command in EVOLOGICS.items() if re.fullmatch(pattern, body)), None)
    if known is None or data != b"+++" + body + b"\n":
        return f"{data!r} is on no list of what may be said to an EvoLogics modem"
    if known.use is Use.ACTIVE and not _whole_message(body):
        return f"{data!r} is not one whole message to one modem"
    return _unless(known, data, active=active)


def _whole_message(body: bytes) -> bool:
    _, length, to, _, text = body.split(b",", 4)
    return int(length) == len(text) <= _LONGEST and int(to) in _ADDRESSES


def _refused_seatrac(data: bytes, *, active: bool) -> str | None:
    payload = seatrac.payload_of(data)
    known = SEATRAC.get(payload[0]) if payload else None
    if payload is None or known is None:
        return f"{data!r} is on no list of what may be said to a SeaTrac beacon"
    if known.use is Use.READ and len(payload) > 1:
        return f"{data!r} asks with a parameter, and no question needs one"
    if known.use is Use.ACTIVE and not _one_ping(payload):
        return f"{data!r} transmits, and is no ping of one beacon"
    return _unless(known, data, active=active)


def _one_ping(payload: bytes) -> bool:
    return payload[0] == _PING and len(payload) == 3 and payload[1] in _BEACONS and payload[2] == _WITH_USBL  # noqa: PLR2004 - number, beacon, kind


def _unless(known: Command, data: bytes, *, active: bool) -> str | None:
    if known.use is Use.READ or (known.use is Use.ACTIVE and active):
        return None
    if known.use is Use.ACTIVE:
        return f"{data!r} {known.what}, and nobody has consented to it"
    return f"{data!r} {known.what}: it is never sent"


def _say(data: bytes, until: bytes, within_s: float, *, active: bool) -> Say:
    """Make the only kind of saying that a modem gets. Raises NeverSaid."""
    if reason := refused(data, active=active):
        raise NeverSaid(reason, hint="a probe sends what `checklist/probes/acoustic/allowed.py` lists, nothing else")
    return Say(data, until, within_s)


def ask_at(query: str, until: bytes, *, within_s: float = _READ_S) -> Say:
    """Ask an EvoLogics modem something that only reads: `AT?S`. Raises NeverSaid."""
    return _say(b"+++" + query.encode() + b"\n", until, within_s, active=False)


def ask_seatrac(number: int, until: bytes, *, within_s: float = _READ_S) -> Say:
    """Ask a SeaTrac beacon something that only reads. Raises NeverSaid."""
    return _say(seatrac.command(bytes([number])), until, within_s, active=False)


def message(text: str, to: int, consent: Consent | None, until: bytes, *, within_s: float) -> Say:
    """Transmit a message by an EvoLogics modem, which only a step can that asks for consent. Raises NeverSaid."""
    data = f"+++AT*SENDIM,{len(text)},{to},ack,{text}\n".encode()
    return _say(data, until, within_s, active=_asks(consent))


def ping(beacon: int, consent: Consent | None, until: bytes, *, within_s: float) -> Say:
    """Ping another beacon by a SeaTrac one, which only a step can that asks for consent. Raises NeverSaid."""
    return _say(seatrac.command(bytes([_PING, beacon, _WITH_USBL])), until, within_s, active=_asks(consent))


def _asks(consent: Consent | None) -> bool:
    """Whether a person is asked, and asked whether the modem is in the water."""
    return consent is not None and _IN_WATER in consent.question
