"""What a command takes, declared as data: words (`site=coastal`), flags (`--plan`), and the values a person gave them.

A command module holds one `COMMAND = Command(...)` and `run(arguments: Arguments) -> ExitCode`. The declaration feeds
the parser, the help texts and the near-miss hints, so that none of them can disagree. Nothing heavy is imported at the
top of a command module: `provision --help` reads every declaration.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.core.errors import ExitCode


@dataclass(frozen=True, slots=True)
class Word:
    """A `name=value` word; `many` takes a comma list and may be given more than once."""

    name: str
    help: str
    required: bool = False
    many: bool = False
    choices: tuple[str, ...] = ()
    example: str = ""

    @property
    def shown(self) -> str:
        """The word as help prints it."""
        value = "|".join(self.choices) or self.name.upper()
        return f"{self.name}={value}{',…' if self.many else ''}"

    @property
    def typed(self) -> str:
        """The word as a hint tells people to type it."""
        return f"{self.name}={self.example or (self.choices or (self.name.upper(),))[0]}"


@dataclass(frozen=True, slots=True)
class Flag:
    """A `--name` switch; with `takes` it wants a value, as `--name VALUE` or `--name=VALUE`.

    `harmless` says that with it the command changes no device, whatever else it does.
    """

    name: str
    help: str
    takes: str = ""
    short: str = ""
    harmless: bool = False

    @property
    def shown(self) -> str:
        """The flag as help prints it."""
        value = f" {self.takes}" if self.takes else ""
        return f"-{self.short}, --{self.name}{value}" if self.short else f"--{self.name}{value}"


INVENTORY = Word("inventory", "folder of the declaration; the checkout's own if left out")
ONLY = Word("only", "only these hosts of it", many=True, example="coastal-router")
VIA = Word("via", "the bearer over which you work, where it is not the declared one", example="4g")
JSON = Flag("json", "print one JSON object instead of text, on errors as well")
STREAM = Flag(
    "stream", "with --json: also one line for each device as soon as it has ended; the object is the last line"
)
UNPROTECTED = Flag(
    "without-protection", "change a device even though nothing would take the change back if it went wrong"
)
ACCEPT_COST = Flag("accept-cost", "allow traffic over a link that is paid by the byte; `--yes` does not allow it")
REMOVE_FOREIGN = Flag(
    "remove-foreign",
    "remove rows of others by the hundred from menus that are ours entirely; `--yes` does not say that",
)
ASK_VAULT_PASS = Flag("ask-vault-pass", "type the password of the inventory's vault, also where a file is named for it")
VERBOSE = Flag("verbose", "say more about each step", short="v")


@dataclass(frozen=True, slots=True)
class Command:
    """One command as a person meets it; `changes` says that it may alter a device, so an interrupted one is unknown.

    `again` says what to do then, where `provision runs` does not. `plays` says that devices change in plays alone:
    these settle when they are stopped, so that nothing is unknown beside what their report says.
    """

    name: str
    summary: str
    words: tuple[Word, ...] = ()
    flags: tuple[Flag, ...] = ()
    details: str = ""
    changes: bool = False
    again: str = ""
    plays: bool = False

    def word(self, name: str) -> Word | None:
        """The declared word of that name."""
        return next((word for word in self.words if word.name == name), None)

    def flag(self, name: str) -> Flag | None:
        """The declared flag of that name."""
        return next((flag for flag in self.flags if flag.name == name), None)


@dataclass(frozen=True, slots=True)
class Arguments:
    """The values given to a command. Asking for a name that the command did not declare is a KeyError: our fault."""

    command: Command
    words: Mapping[str, tuple[str, ...]]
    flags: Mapping[str, str | None]

    def word(self, name: str) -> str:
        """The value of a required word."""
        (value,) = self._declared_word(name)
        return value

    def optional(self, name: str) -> str | None:
        """The value of a word that may be missing."""
        values = self._declared_word(name)
        return values[0] if values else None

    def many(self, name: str) -> tuple[str, ...]:
        """All values of a `many` word, in the order given; empty when it was not given."""
        return self._declared_word(name)

    def flag(self, name: str) -> bool:
        """Whether the flag was given."""
        self._declared_flag(name)
        return name in self.flags

    def given(self, flag: Flag) -> bool:
        """Whether a flag was given that not every command has."""
        return self.command.flag(flag.name) is not None and self.flag(flag.name)

    def value(self, name: str) -> str | None:
        """The value of a flag that takes one; None when it was not given."""
        self._declared_flag(name)
        return self.flags.get(name)

    def _declared_word(self, name: str) -> tuple[str, ...]:
        if self.command.word(name) is None:
            raise KeyError(name)
        return self.words.get(name, ())

    def _declared_flag(self, name: str) -> None:
        if self.command.flag(name) is None:
            raise KeyError(name)


class CommandModule(Protocol):
    """What a module of this package must hold to be a command."""

    COMMAND: Command

    def run(self, arguments: Arguments) -> ExitCode:
        """Do it; raise NetcfgError to fail."""
