"""The words of an API sentence, sorted by what they are (Manual, API: API words)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.answers import Category, Trap

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(slots=True)
class Sentence:
    """A command with its arguments; `unset` are names that came as `!name` or `=!name=`."""

    menu: str
    command: str
    arguments: dict[str, str] = field(default_factory=dict)
    unset: list[str] = field(default_factory=list)
    queries: list[str] = field(default_factory=list)
    tag: str = ""

    @property
    def path(self) -> str:
        """Menu and command in one."""
        return f"{self.menu.rstrip('/')}/{self.command}"

    @classmethod
    def read(cls, words: Sequence[str]) -> Sentence:
        """Sort the words. Raises Trap on the first that is none; of an argument given twice the last counts."""
        path, *rest = words
        if not path.startswith("/") or path.endswith("/"):
            raise Trap("no such command", Category.MISSING)
        menu, _, command = path.rpartition("/")
        sentence = cls(menu or "/", command)
        for word in rest:
            sentence._take(word)
        return sentence

    def _take(self, word: str) -> None:
        if word.startswith("."):
            name, _, value = word.partition("=")
            if name != ".tag":
                raise Trap(f"unknown parameter {name}")
            self.tag = value
        elif word.startswith("?"):
            self.queries.append(word[1:])
        elif word.startswith("=!"):
            self.unset.append(word[2:].partition("=")[0])
        elif word.startswith("="):
            name, _, value = word[1:].partition("=")
            self.arguments[name] = value
        elif word.startswith("!"):
            self.unset.append(word[1:])
        else:
            raise Trap(f"unknown parameter {word}")
