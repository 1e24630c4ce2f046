"""A modem on a serial port that nothing owns: asked with reads only, never set."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers.lte.at._commands import ALLOWED, READS, VENDOR_READS, CommandForbidden, checked
from atlantis_netcfg.bearers.lte.at._line import ANSWER_S, Answer, AtSilent, AtUnreachable, Modem
from atlantis_netcfg.bearers.lte.at._owner import PortOwned, require_free
from atlantis_netcfg.bearers.lte.at._parse import reading_of

if TYPE_CHECKING:
    from atlantis_netcfg.bearers.lte.record import LteReading

__all__ = [
    "ALLOWED",
    "ANSWER_S",
    "READS",
    "VENDOR_READS",
    "Answer",
    "AtLook",
    "AtSilent",
    "AtUnreachable",
    "CommandForbidden",
    "Modem",
    "PortOwned",
    "checked",
    "read",
    "reading_of",
    "require_free",
]


@dataclass(frozen=True, slots=True)
class AtLook:
    """What one look at a modem has given."""

    reading: LteReading
    commands: int
    """Sent, and answered."""


def read(port: str, *, answer_s: float = ANSWER_S) -> AtLook:
    """Ask the modem at `port`. Raises PortOwned and AtUnreachable (nothing was sent), AtSilent."""
    with Modem(port, answer_s=answer_s) as modem:
        answers = {command: modem.ask(command) for command in READS}
        maker = " ".join(answers["AT+CGMI"].lines).lower()
        for word, commands in VENDOR_READS.items():
            if word in maker:
                answers |= {command: modem.ask(command) for command in commands}
        return AtLook(reading_of(answers), len(modem.sent))
