"""One message from modem to modem: only in the water, with a person's consent, and by a modem that is not too loud.

A script cannot decide, but it can stop: the state is asked, whose modem it is, then the source level, and the message
stands behind the answers that allow it, so that nobody else's modem is made to transmit. Those answers must come alone
(notifications that are plain text aside): nothing inside a received message is taken for them, and what is not sure is
not sent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.acoustic import evologics
from atlantis_netcfg.checklist.probes.acoustic.allowed import ask_at, message
from atlantis_netcfg.checklist.probes.acoustic.bands import level_words
from atlantis_netcfg.checklist.probes.acoustic.errors import not_understood, said
from atlantis_netcfg.checklist.probes.acoustic.modem import WATER
from atlantis_netcfg.checklist.probes.step import Consent, Judged
from atlantis_netcfg.checklist.report import Evidence, EvidenceType
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.checklist.probes.acoustic.modem import Modem
    from atlantis_netcfg.checklist.probes.requests import Listen, Question
    from atlantis_netcfg.checklist.probes.results import Answer

__all__ = ["EvologicsMessage", "message_consent"]

TEXT = "ATLANTIS"
_TEXT_ONLY = rb"\A(?:\+{0,2}[\w,.:-]*\r?\n)?(?:\+\+\+AT:\d+:(?!RECV(?!START|END|FAILED))[A-Z]+[^\r\n]*\r\n)*"
"""The rest of a notification that was cut by the last answer, and whole ones; nothing with a message inside."""
_LISTENS = _TEXT_ONLY + rb"\+\+\+AT\?S:\d+:INITIATION LISTEN[^\r\n]*\r\n"
_LEVELS = (1, 2, 3)
"""Not the maximum: nobody needs it within a port."""
_QUIET = _TEXT_ONLY + rb"\+\+\+AT\?L:1:[123]\r\n"
_DELIVERED_S = 20.0
"""A modem tries again by itself before it gives up."""


def message_consent(name: str, partner: int) -> Consent:
    """What a person has to agree to."""
    return Consent(
        question=f"{name} and the modem with the acoustic address {partner} are in the water, nobody dives near them, "
        "and they may transmit one message"
    )


@dataclass(frozen=True, slots=True)
class EvologicsMessage:
    """A message reaches the partner's modem, which acknowledges it."""

    modem: Modem
    name: str
    """The row in words."""
    declared: int | None
    """Acoustic address; None: any modem may be there, which the modem's own item says."""
    partner: int
    """Acoustic address."""
    consent: Consent | None
    """What the step asks a person; without it there is no message to be sent."""

    def asks(self) -> tuple[Question, ...]:
        """State, address, source level, and behind them the message. Raises NeverSaid where no person is asked."""
        return (self._question(),)

    def _question(self) -> Listen:
        ended = (
            rb"(?:DELIVERED|FAILED)IM,%d\r?\n|\+\+\+AT\*SENDIM[^:\r\n]*:\d+:(?:ERROR|BUSY)|(?:\A|\n)(?:ERROR|BUSY)"
            % self.partner
        )
        say = (
            ask_at("AT?S", _LISTENS),
            ask_at("AT?AL", _TEXT_ONLY + rb"\+\+\+AT\?AL:\d+:%s\r\n" % _address(self.declared)),
            ask_at("AT?L", _QUIET),
            message(TEXT, self.partner, self.consent, ended, within_s=_DELIVERED_S),
        )
        return self.modem.listen(f"message from {self.modem.where}", say, listen_s=0.0, turn=WATER)

    def judge(self, results: Mapping[str, Answer]) -> Judged:
        """Judge whether it was sent, and what became of it."""
        transcript = said(self.modem, self.name, results[self._question().name])
        if isinstance(transcript, Judged):
            return transcript
        pieces = evologics.pieces(transcript.data)
        if not any(piece.command for piece in pieces):
            return Judged((not_understood(self.modem, self.name),))
        level = evologics.number(evologics.answer(pieces, "AT?L"))
        evidence = (
            ()
            if level is None
            else (
                Evidence(type=EvidenceType.READ, what="source level before the message", value=level_words(int(level))),
            )
        )
        accepted = evologics.answer(pieces, "AT*SENDIM") == "OK"
        refused = evologics.trouble_words(pieces, "AT*SENDIM")
        if accepted:
            # The vehicle's own software may send as well: only what follows our own message is its report.
            at = next(place for place, entry in enumerate(pieces) if _is_send(entry) and entry.text == "OK")
            reports = tuple(item.text for item in pieces[at:] if item.command == evologics.NOTIFICATION)
            return Judged((self._sent(reports),), evidence)
        return Judged((self._kept(pieces, level, refused),), evidence)

    def _sent(self, lines: tuple[str, ...]) -> Finding:
        to = f"the modem with the address {self.partner}"
        if f"DELIVEREDIM,{self.partner}" in lines:
            return Finding(Verdict.PASS, "delivered", f"a message of {self.name} reached {to}, which acknowledged it")
        if f"FAILEDIM,{self.partner}" in lines:
            hint = "look whether both modems are in the water, within reach of each other, and agree in their settings"
            return Finding(Verdict.FAIL, "not-delivered", f"{to} has not acknowledged the message of {self.name}", hint)
        hint = "check again; the modem may still have been trying when the time was up"
        message = f"the modem of {self.name} has sent a message and does not tell what became of it"
        return Finding(Verdict.INCONCLUSIVE, "no-report", message, hint)

    def _kept(self, pieces: tuple[evologics.Piece, ...], level: float | None, refused: str | None) -> Finding:
        state = evologics.state(pieces)
        if state is not None and state != "INITIATION LISTEN":
            message = f"no message was sent: the modem of {self.name} does not listen ({state})"
            return Finding(Verdict.INCONCLUSIVE, "not-sent", message, "settle the item of the modem itself first")
        address = evologics.number(evologics.answer(pieces, "AT?AL"))
        if address is not None and self.declared is not None and address != self.declared:
            message = f"no message was sent: the modem of {self.name} has the acoustic address {address:.0f}, and"
            hint = "settle the item of the modem itself first"
            return Finding(Verdict.FAIL, "wrong-address", f"{message} {self.declared} is declared", hint)
        if level is not None and level not in _LEVELS:
            message = f"no message was sent: the source level of {self.name} is {level_words(int(level))}"
            hint = "have its crew set a level between 1 and 3 (3 is the quietest), and check again"
            return Finding(Verdict.INCONCLUSIVE, "too-loud", message, hint)
        if refused:
            message = f"the modem of {self.name} has not taken the message: `{refused[:60]}`"
            return Finding(Verdict.INCONCLUSIVE, "not-taken", message, "check again when the vehicle does not use it")
        message = (
            f"no message was sent: the modem of {self.name} did not tell an address and a source level that allow it"
        )
        hint = "check again when the modem receives nothing; a change of the level that is pending stops it, too"
        return Finding(Verdict.INCONCLUSIVE, "not-sent", message, hint)


def _address(declared: int | None) -> bytes:
    return rb"\d+" if declared is None else b"%d" % declared


def _is_send(piece: evologics.Piece) -> bool:
    return piece.command is not None and piece.command.partition(",")[0] == "AT*SENDIM"
