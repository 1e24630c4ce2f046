"""Prompts of `provision inventory init`: `<` goes back one question, and kept answers are not asked again.

Going back replays all answers but the last, so that it works across blocks, sites and list entries alike.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from atlantis_netcfg.core import printable
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

BACK = "<"
CLEAR = "-"
_LONGEST = 2000
"""Maximum length of an answer; a public SSH key of 8192 bits has 1,400 characters."""
_LONGEST_DEFAULT = 40
_T = TypeVar("_T")


class InvalidAnswer(ValueError):
    """An answer that cannot be used; the message says what to type."""


class _StepBack(Exception):
    """The person wants to return to the question before."""


class Prompter:
    """Asks questions, and keeps the answers as they were typed."""

    def __init__(
        self,
        ask: Callable[[str], str],
        tell: Callable[[str], None],
        keep: Callable[[Sequence[tuple[str, str]]], None] = lambda _: None,
        kept_answers: Sequence[tuple[str, str]] = (),
    ) -> None:
        self.ask = ask
        self.tell = tell
        self.keep = keep
        """Called with all answers after each one."""
        self.answers: list[tuple[str, str]] = []
        """Key and typed text of each answer so far, in order."""
        self.pending = list(kept_answers)
        """Answers that are replayed before anything is asked."""
        self.earlier: dict[str, str] = {}
        """Answers that were taken back, by key; they are the defaults now."""
        self._heading = self._shown_heading = ""

    def run(self, questions: Callable[[], _T]) -> _T:
        """Ask all questions; start again with all answers but the last after each step back."""
        while True:
            try:
                return questions()
            except _StepBack:
                key, text = self.answers.pop()
                self.earlier[key] = text
                self.pending, self.answers = self.answers, []

    def start_block(self, heading: str) -> None:
        """Show a heading above the next question."""
        self._heading = heading

    def remark(self, words: str) -> None:
        """Tell something about the answers so far, unless they are only replayed."""
        if not self.pending:
            self.tell(words)

    def answer(self, key: str, question: str, default: str, parse: Callable[[str], _T], note: str = "") -> _T:
        """Ask until `parse` accepts the answer; it raises InvalidAnswer, and gets an empty text for the default."""
        if self.pending:
            kept_key, text = self.pending.pop(0)
            try:
                if kept_key == key:
                    value = parse(text)
                    self.answers.append((key, text))
                    return value
            except InvalidAnswer:
                pass
            # The questions have changed since: what is left becomes defaults.
            self.earlier.update([(kept_key, text), *self.pending])
            self.pending.clear()
        for words in (self._heading if self._heading != self._shown_heading else "", note):
            if words:
                self.tell(words)
        self._shown_heading = self._heading
        return self._ask_until_valid(key, question, default, parse)

    def _ask_until_valid(self, key: str, question: str, default: str, parse: Callable[[str], _T]) -> _T:
        earlier = self.earlier.get(key, "")
        default_text = earlier if len(earlier) <= _LONGEST_DEFAULT else f"{earlier[: _LONGEST_DEFAULT - 1]}…"
        default_text = printable.line(default_text) or translate(default)
        prompt = f"{translate(question)} [{default_text}]: " if default_text else f"{translate(question)}: "
        while True:
            text = self.ask(prompt).strip()
            if text == BACK:
                if self.answers:
                    raise _StepBack
                self.tell("This is the first question.")
                continue
            if earlier:
                text = "" if text == CLEAR else text or earlier
            try:
                _require_text(text)
                value = parse(text)
            except InvalidAnswer as error:
                self.tell(str(error))
                continue
            self.answers.append((key, text))
            self.keep(self.answers)
            return value


def _require_text(text: str) -> None:
    if len(text) > _LONGEST:
        raise InvalidAnswer(msg(f"An answer has at most {arg(_LONGEST)} characters."))
    if not text.isprintable() or "\ufffd" in text:  # which stands for bytes that are no text
        raise InvalidAnswer("The answer contains unprintable characters: type it again.")
