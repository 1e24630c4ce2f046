"""Why a modem tells nothing, in words: one that its vehicle holds is no broken one, and is never taken away from it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.results import Transcript, Trouble
from atlantis_netcfg.checklist.probes.step import Judged
from atlantis_netcfg.core.verdicts import Verdict
from atlantis_netcfg.declaration.model import AcousticDriver

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from atlantis_netcfg.checklist.probes.acoustic.modem import Modem
    from atlantis_netcfg.checklist.probes.results import Answer

__all__ = ["LANGUAGE", "not_understood", "said", "trouble", "two_modems", "whose_unknown"]

LANGUAGE = {AcousticDriver.EVOLOGICS: "an EvoLogics modem", AcousticDriver.SEATRAC: "a SeaTrac beacon"}
_IN_USE = (
    "look at the modem's topic in the vehicle's own software; stop that software only if the vehicle's crew agrees, "
    "and check again"
)


_WORDS: Mapping[Trouble | None, tuple[Verdict, str, str, str]] = {
    Trouble.REFUSED: (
        Verdict.INCONCLUSIVE,
        "in-use",
        "the modem of {name} turns us away at {where}: it is in use by the vehicle",
        _IN_USE,
    ),
    Trouble.BUSY: (
        Verdict.INCONCLUSIVE,
        "in-use",
        "the modem of {name} is in use: another program holds {where}",
        _IN_USE,
    ),
    Trouble.SILENT: (
        Verdict.INCONCLUSIVE,
        "silent",
        "nobody answers for the modem of {name} at {where}",
        "switch the modem on, and look whether its address is that of the declaration; or it is in use by the vehicle: "
        + _IN_USE,
    ),
    Trouble.UNREACHABLE: (
        Verdict.INCONCLUSIVE,
        "unreachable",
        "there is no way to the modem of {name} at {where}",
        "look at the vehicle's link to the site first: its Wi-Fi or its cable",
    ),
    Trouble.MISSING: (
        Verdict.FAIL,
        "no-port",
        "the serial port {where} for the modem of {name} does not exist",
        "plug the modem's cable in, or correct `device` in the declaration",
    ),
    Trouble.DENIED: (
        Verdict.INCONCLUSIVE,
        "denied",
        "we may not open {where} for the modem of {name}",
        "put the account that checks into the group `dialout` of that computer",
    ),
    Trouble.NO_PLACE: (
        Verdict.INCONCLUSIVE,
        "no-place",
        "the modem of {name} was not asked: {words}",
        "mend the way to the computer that asks first; nothing is known of the modem",
    ),
    None: (
        Verdict.INCONCLUSIVE,
        "in-use",
        "the modem of {name} takes the connection at {where} and says nothing: it is in use by the vehicle",
        _IN_USE,
    ),
}
"""Verdict, code, sentence and hint of a modem that has not said a word."""


def trouble(modem: Modem, name: str, transcript: Transcript) -> Finding | None:
    """Say why the modem of a row could not be read; None: it has said something."""
    if transcript.data:
        return None
    # Who serves one client only hangs up on the second, or refuses it: both mean the same here.
    met = Trouble.REFUSED if transcript.trouble is Trouble.CLOSED else transcript.trouble
    verdict, code, message, hint = _WORDS[met]
    words = transcript.words or "nobody could ask it"
    return Finding(verdict, code, message.format(name=name, where=modem.where, words=words), hint)


def said(modem: Modem, name: str, answer: Answer) -> Transcript | Judged:
    """Give what a modem has said, or the judgement of one that could not be read."""
    if not isinstance(answer, Transcript):
        raise TypeError(answer)
    finding = trouble(modem, name, answer)
    return answer if finding is None else Judged((finding,))


def not_understood(modem: Modem, name: str) -> Finding:
    """Say that somebody else's language is spoken, or that noise comes."""
    message = f"what answers for {name} at {modem.where} does not speak like {LANGUAGE[modem.driver]}"
    hint = (
        "compare `driver`, `port` and `baud` in the declaration with the modem; a wrong rate of a serial port is noise"
    )
    return Finding(Verdict.INCONCLUSIVE, "not-understood", message, hint)


def whose_unknown(modem: Modem, name: str) -> Finding:
    """Say that any modem would do: nothing declared tells this one from another's."""
    message = f"nothing tells whether what answers at {modem.where} is the modem of {name}"
    return Finding(Verdict.WARN, "whose-unknown", message, "declare its `acoustic_address` under `endpoints.acoustic`")


def two_modems(modem: Modem, name: str, addresses: Collection[int]) -> Finding:
    """Say that answers contradict each other."""
    text = " and ".join(map(str, sorted(addresses)))
    message = f"what answers for {name} at {modem.where} tells the acoustic addresses {text}: it is more than one modem"
    hint = "look what is connected to this end: one line serves one modem, and a program must not mix two of them"
    return Finding(Verdict.FAIL, "two-modems", message, hint)
