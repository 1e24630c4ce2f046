"""The program that listens, at whatever place: packed with its questions, and read line by line."""

from __future__ import annotations

import asyncio
import json
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes.agent import batch, program, read_result
from atlantis_netcfg.checklist.runner.no_result import unanswered
from atlantis_netcfg.checklist.runner.remote_process import Carrier

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.checklist.probes import Answer
    from atlantis_netcfg.checklist.runner._ears import OnAnswer, Questions


@dataclass(slots=True)
class Listener:
    """One turn of the program at one place."""

    questions: Questions
    tell: OnAnswer
    """Called in the loop in which `hear` runs."""
    grace_s: float
    """What the way there may take on top of the questions."""
    answers: dict[str, Answer] = field(default_factory=dict)
    _requests: float = 0.0
    _faults: list[RuntimeError] = field(default_factory=list)

    async def hear(self, carry: Callable[[Carrier], str]) -> dict[str, Answer]:
        """Let the program run; `carry` blocks until it has ended, and gives the words for what was not answered.

        Raises RuntimeError if the program itself has failed at a question, once all others are answered and told.
        """
        made, loop = batch(self.questions), asyncio.get_running_loop()
        by_key, words = dict(self.questions), ["it did not answer"]

        def line(text: bytes) -> None:
            loop.call_soon_threadsafe(self._line, text, time.time())

        carrier = Carrier(program(made.asked), line, made.within_s + self.grace_s)
        self._requests = time.time()
        await carrier.beside(lambda: words.append(carry(carrier)))
        if self._faults:
            raise self._faults[0]
        rest = {key: unanswered(by_key[key], words[-1]) for key in by_key if key not in self.answers}
        return {**self.answers, **rest}

    def _line(self, text: bytes, now: float) -> None:
        """Take a line; a broken one says nothing, and its question counts as not answered."""
        by_key = dict(self.questions)
        try:
            result = json.loads(text)
            question = by_key[result["key"]]
            answer = read_result(result, question, self._requests, now)
        except RuntimeError as fault:
            self._faults.append(fault)
            return
        except (ValueError, LookupError, TypeError, RecursionError):
            return
        self.answers[result["key"]] = answer
        self.tell(result["key"], answer)
