"""A person at a terminal: questions, answers, and the word with which all of it is left for another time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from atlantis_netcfg.checklist import Refused
from atlantis_netcfg.checklist.confirmations import named
from atlantis_netcfg.core import printable
from atlantis_netcfg.core.suggest import nearest

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

T = TypeVar("T")
LATER = "later"
"""Typed in answer to any question: what is answered stays, the rest is open."""


class PromptAborted(Exception):
    """The person goes on another time."""


class Prompt:
    """Where somebody is asked; `ask` and `say` are those of a terminal, unless a test brings its own."""

    def __init__(self, ask: Callable[[str], str] = input, say: Callable[[str], None] = print) -> None:
        self._ask = ask
        self._say = say
        self._name = ""

    def say(self, text: str = "") -> None:
        """Print lines; what came from a device or a file cannot move the cursor."""
        self._say(printable.lines(text))

    def ask(self, question: str) -> str:
        """One answer, which may be empty. Raises Later."""
        try:
            answer = self._ask(f"{printable.lines(question)} ").strip()
        except EOFError:
            raise PromptAborted from None
        if answer.lower() == LATER:
            raise PromptAborted
        return answer

    def choose(self, question: str, words: Mapping[str, T], default: str = "") -> T:
        """One of these words, or what `default` means for an empty answer; a first letter is enough if it is alone."""
        while True:
            typed = self.ask(f"{question} [{', '.join(words)}, {LATER}]").lower() or default
            known = [word for word in words if typed and word.startswith(typed)]
            if typed in words or len(known) == 1:
                return words[typed if typed in words else known[0]]
            near = nearest(typed, words)
            self.say(f"  type one of: {', '.join(words)}, {LATER}{f' (`{near}`?)' if near else ''}")

    def agrees(self, question: str) -> bool:
        """Whether the whole word is given: a slip of the finger is no consent."""
        return self.ask(f"{question} Type yes, or anything else for no:").lower() == "yes"

    def needs(self, question: str) -> str:
        """An answer that is not empty."""
        while not (answer := self.ask(question)):
            self.say(f"  something has to stand here; `{LATER}` leaves it open")
        return answer

    @property
    def name(self) -> str:
        """Who answers: asked once."""
        while not self._name:
            try:
                self._name = named(self.needs("Your name, as it shall stand in the report:"))
            except Refused as refused:
                self.say(f"  {refused}: {refused.hint}")
        return self._name

    def files(self) -> tuple[Path, ...]:
        """Photos or files that show it; none with an empty answer."""
        found: list[Path] = []
        while typed := self.ask("Photo or file that shows it (a path; empty: none or no more):"):
            path = Path(typed).expanduser()
            if path.is_file():
                found.append(path)
            else:
                self.say(f"  there is no file {typed}")
        return tuple(found)
