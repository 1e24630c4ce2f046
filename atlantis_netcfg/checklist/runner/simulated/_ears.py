"""The ears of a rehearsal: the same questions, asked of what stands for the site's devices on this computer."""

from __future__ import annotations

import os
import shlex
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import (
    Discover,
    Discovered,
    Listen,
    Offered,
    Place,
    Probing,
    Ran,
    Run,
    Transcript,
    Trouble,
)
from atlantis_netcfg.checklist.probes.results import Offer
from atlantis_netcfg.checklist.runner._laptop import ask_here
from atlantis_netcfg.checklist.runner.no_result import unanswered
from atlantis_netcfg.emulator.linux import NOT_FOUND

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from atlantis_netcfg.checklist.probes import Answer, Question
    from atlantis_netcfg.checklist.runner._ears import Asked, Ears, Heard
    from atlantis_netcfg.checklist.runner.simulated.endpoints import Stand
    from atlantis_netcfg.emulator.linux import Computer

__all__ = ["RehearsedEars"]

_NOBODY = "nothing stands for it in a rehearsal"


@dataclass(frozen=True, slots=True)
class RehearsedEars:
    """Streams are listened to by the real program; what programs of a gateway would print is emulated."""

    routers: Ears
    """The real site's, whose devices are the twins."""
    computer: Computer | None
    """Stands for the gateway, and for this computer as far as its programs are asked; None: the site has none."""
    stands: Sequence[Stand]

    async def ask(self, place: Place, host: str | None, questions: Asked, result: Heard) -> Mapping[str, Answer]:
        """Ask all questions of one place in one turn; see `Ears.ask`."""
        if place is Place.ROUTER:
            return await self.routers.ask(place, host, questions, result)
        streams = [(key, found) for key, request in questions if (found := self._moved(request)) is not None]
        answers: dict[str, Answer] = {}
        names = {key for key, _ in streams}
        for key, question in questions:
            if key not in names:
                answers[key] = self._answer(question)
                result(key, answers[key])
        if streams:
            asked = dict(questions)

            def told(key: str, answer: Answer) -> None:
                result(key, self._sent(asked[key], answer))

            ended = await ask_here(streams, told)
            answers.update({key: self._sent(asked[key], answer) for key, answer in ended.items()})
        return answers

    def _sent(self, question: Question, answer: Answer) -> Answer:
        """A datagram comes from where the thing would be that its twin stands for."""
        if not isinstance(answer, Transcript) or not isinstance(question, Listen) or not answer.senders:
            return answer
        stand = next(item for item in self.stands if item.means(question))
        return replace(answer, senders=(stand.address,) * len(answer.senders))

    def _moved(self, question: Question) -> Listen | None:
        """Give a stream at the place where its twin really is; None: it is no stream, or nothing stands for it."""
        if not isinstance(question, Listen):
            return None
        stand = next((item for item in self.stands if item.means(question)), None)
        return None if stand is None else replace(question, **stand.place())

    def _answer(self, question: Question) -> Answer:
        if self.computer is None or isinstance(question, Listen):
            return unanswered(question, _NOBODY)
        if isinstance(question, Run):
            return self._ran(question, self.computer)
        if isinstance(question, Probing):
            return self._offered(question, self.computer)
        if isinstance(question, Discover):
            return self._discovered(question, self.computer)
        return unanswered(question, _NOBODY)

    @staticmethod
    def _ran(question: Run, computer: Computer) -> Ran:
        requested = time.time()
        rc, out, err = computer.answer(question.argv)
        trouble, words = None, ""
        if rc == NOT_FOUND:
            trouble, words = Trouble.MISSING, f"there is no program {shlex.quote(question.argv[0])}"
        return Ran(trouble, words, rc, out, err, computer.now, requested, time.time())

    @staticmethod
    def _discovered(question: Discover, computer: Computer) -> Discovered:
        prefix = os.urandom(12)
        found = computer.participants(question.domain, question.address, prefix)
        if found is None:
            return Discovered(Trouble.UNREACHABLE, f"{question.address}: Cannot assign requested address")
        return Discovered(None, "", prefix, found)

    @staticmethod
    def _offered(question: Probing, computer: Computer) -> Offered:
        found = computer.offers(question.interface, question.cards)
        if found is None:
            return Offered(Trouble.MISSING, f"this computer has no interface {question.interface}")
        offers = (Offer(offer.server, offer.mac.lower(), offer.address, offer.router) for offer in found)
        return Offered(None, "", tuple(offers))
