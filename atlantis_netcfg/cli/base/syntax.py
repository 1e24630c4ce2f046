"""Definition of a command's arguments as data: `site=coastal`, flags such as `--plan`, and their parsed values.

A command is two names of a module: `DRIFT = Command(...)` and `run_drift(arguments: Arguments) -> ExitCode`. The
definition feeds the parser, the help texts and the suggestions, so that they are always consistent. A command module
imports nothing heavy at its top: `provision --help` reads every definition.

Also parses a command line to `Arguments`; all errors of a line are reported together, each with its correction.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base import inventory_names
from atlantis_netcfg.core.errors import UsageError, nearest
from atlantis_netcfg.core.messages import arg, join, msg

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


_VALUES = {
    "site": inventory_names.Values.SITE,
    "device": inventory_names.Values.HOST,
    "vehicle": inventory_names.Values.VEHICLE,
    "partner": inventory_names.Values.PARTNER,
}
"""Argument name -> kind of its values in every command."""
_PLACEHOLDERS = {
    "address": "IP",
    "authority": "DIR",
    "contact": "TEXT",
    "distribution": "ROS",
    "endpoint": "NAME",
    "inventory": "DIR",
    "openvpn": "N.N",
    "recipient": "KEY",
    "system": "OS",
}
"""Argument name -> what help prints for its value, where the name in capitals is too long for the table."""
_LONG = 30
"""Choices that are longer than this are printed in the description of an argument, not in its usage."""


@dataclass(frozen=True, slots=True)
class Word:
    """A `name=value` word; `many` takes a comma list and may be given more than once."""

    name: str
    help: str
    is_required: bool = False
    many: bool = False
    choices: tuple[str, ...] = ()
    example: str = ""
    values: inventory_names.Values | None = None
    """Kind of its values, if it is not the one that its name implies."""
    bare: bool = False
    """Whether its value may be typed alone: `provision inventory init FOLDER`; with `many`, several."""

    @property
    def value_kind(self) -> inventory_names.Values | None:
        """Kind of its values for completion; None if they are not known."""
        return self.values or _VALUES.get(self.name)

    @property
    def usage(self) -> str:
        """The argument as printed in help."""
        choices = "|".join(self.choices)
        short = _PLACEHOLDERS.get(self.name, self.name.upper())
        value = short if not choices or len(choices) > _LONG else choices
        return f"{self.name}={value}{',…' if self.many else ''}"

    @property
    def hint(self) -> str:
        """The argument as suggested in a hint."""
        return f"{self.name}={self.example or (self.choices or (self.name.upper(),))[0]}"


@dataclass(frozen=True, slots=True)
class Flag:
    """A `--name` flag; with `takes` it needs a value, as `--name VALUE` or `--name=VALUE`.

    `harmless` means that with it the command changes no device, whatever else it does.
    """

    name: str
    help: str
    takes: str = ""
    short: str = ""
    harmless: bool = False

    @property
    def usage(self) -> str:
        """The flag as printed in help."""
        value = f" {self.takes}" if self.takes else ""
        return msg(
            f"-{arg(self.short)}, --{arg(self.name)}{arg(value)}" if self.short else f"--{arg(self.name)}{arg(value)}"
        )


INVENTORY = Word("inventory", "inventory folder (default: checkout's, or ./inventory)")
DEVICES = Word("device", "only these devices of the site", many=True, example="coastal-router")
VIA = Word("via", "the link you work over, if not the one in the inventory", example="4g")
JSON = Flag("json", "print one JSON object instead of text, also on errors")
STREAM = Flag("stream", "for `--json`: also one line per device when it ends; the object comes last")
WITHOUT_PROTECTION = Flag("without-protection", "change a device even without automatic rollback")
ACCEPT_COST = Flag("accept-cost", "accept traffic over a metered link (`--yes` does not)")
REMOVE_FOREIGN = Flag(
    "remove-foreign",
    "remove hundreds of foreign rows (`--yes` does not)",
)
ASK_VAULT_PASS = Flag("ask-vault-pass", "ask for the vault password, even if a file is set for it")
PROFILE = Flag("profile", "for `--rehearse`: link as measured by `measure link`", takes="RUN")
SUMMARY = Flag("summary", "only the number of changes for each device, and the cost")
VERBOSE = Flag("verbose", "show details of each step", short="v")
YES = Flag("yes", "do not ask before changing devices")
CHANGE = (ACCEPT_COST, WITHOUT_PROTECTION, REMOVE_FOREIGN, ASK_VAULT_PASS, JSON, VERBOSE)
"""Flags of every command that changes devices under automatic rollback."""

FRAME = (
    Flag("lang", "output language (default: from LANG)", takes="en|pt"),
    Flag("help", "show this help", short="h"),
)
"""Flags that every command takes, without declaring them."""


@dataclass(frozen=True, slots=True)
class CommandSpec:
    """Definition of a command; `changes`: it may alter a device, so the outcome of an interrupted one is unknown.

    `again` is the hint in that case, if `provision report runs` does not help. `plays` means that devices change only
    in plays: these finish cleanly when stopped, so that the report covers everything.
    """

    name: str
    summary: str
    words: tuple[Word, ...] = ()
    flags: tuple[Flag, ...] = ()
    details: str = ""
    changes: bool = False
    again: str = ""
    plays: bool = False

    @property
    def form(self) -> str:
        """The form in which the command is typed after `provision`; that of `run` is its first argument."""
        return "site=NAME" if self.name == "run" else self.name

    def word(self, name: str) -> Word | None:
        """Return the argument definition with that name; None if there is none."""
        return next((word for word in self.words if word.name == name), None)

    def flag(self, name: str) -> Flag | None:
        """Return the flag definition with that name; None if there is none."""
        return next((flag for flag in self.flags if flag.name == name), None)


@dataclass(frozen=True, slots=True)
class Arguments:
    """The values given to a command. A name that the command does not define raises KeyError: a bug."""

    command: CommandSpec
    words: Mapping[str, tuple[str, ...]]
    flags: Mapping[str, str | None]

    def word(self, name: str) -> str:
        """Return the value of a required argument."""
        (value,) = self._declared_word(name)
        return value

    def optional(self, name: str) -> str | None:
        """Return the value of an optional argument; None if it was not given."""
        values = self._declared_word(name)
        return values[0] if values else None

    def many(self, name: str) -> tuple[str, ...]:
        """Return all values of a `many` argument, in order; empty if it was not given."""
        return self._declared_word(name)

    def flag(self, name: str) -> bool:
        """Return whether the flag was given."""
        self._declared_flag(name)
        return name in self.flags

    def has_flag(self, flag: Flag) -> bool:
        """Return whether a flag was given that only some commands have."""
        return self.command.flag(flag.name) is not None and self.flag(flag.name)

    def value(self, name: str) -> str | None:
        """Return the value of a flag that takes one; None if it was not given."""
        self._declared_flag(name)
        return self.flags.get(name)

    def _declared_word(self, name: str) -> tuple[str, ...]:
        if self.command.word(name) is None:
            raise KeyError(name)
        return self.words.get(name, ())

    def _declared_flag(self, name: str) -> None:
        if self.command.flag(name) is None:
            raise KeyError(name)


class SeveralErrors(UsageError):
    """Several errors on one command line; `errors` holds them in the order of the arguments."""

    def __init__(self, errors: Sequence[UsageError]) -> None:
        super().__init__(join("\n", errors))
        self.errors = tuple(errors)


def parse(command: CommandSpec, words: Sequence[str]) -> Arguments:
    """Parse the arguments; raise UsageError (several: SeveralErrors) for unknown or missing ones."""
    reader = _WordReader(command)
    reader.read(list(words))
    if len(reader.errors) > 1:
        raise SeveralErrors(reader.errors)
    if reader.errors:
        raise reader.errors[0]
    return Arguments(command, {name: tuple(values) for name, values in reader.words.items()}, reader.flags)


class _WordReader:
    """Parser state of one command line."""

    def __init__(self, command: CommandSpec) -> None:
        self.command = command
        self.words: dict[str, list[str]] = {}
        self.flags: dict[str, str | None] = {}
        self.errors: list[UsageError] = []
        self._misspelt: set[str] = set()
        self._typed: list[str] = []

    def read(self, words: list[str]) -> None:
        self._typed = words
        rest = list(reversed(words))
        while rest:
            argument = rest.pop()
            if argument.startswith("-") and argument != "-":
                self._read_flag(argument, rest)
            elif "=" in argument.lstrip("="):
                self._read_word(argument, rest)
            else:
                self._refuse_bare(argument, rest)
        self._require_words()

    def _error(self, message: str, hint: str) -> None:
        self.errors.append(UsageError(message, hint=hint))

    def _read_word(self, argument: str, rest: list[str]) -> None:
        name, _, value = argument.partition("=")
        word = self.command.word(name)
        if word is None:
            self._unknown_word(argument, name, value)
        elif not value:
            self._refuse_spaces(word, argument, _bare(rest))
        else:
            self._take_word(word, argument, value.split(",") if word.many else [value], rest)

    def _take_word(self, word: Word, argument: str, values: list[str], rest: list[str]) -> None:
        self._misspelt.add(word.name)  # whatever is wrong with it, it is not missing
        if "" in values:
            correction = f"{word.name}={','.join(value for value in [*values, _bare(rest)] if value)}"
            self._error(
                msg(f"`{arg(argument)}` has an empty value in its list"),
                msg(f"write it without spaces: `{arg(correction)}`"),
            )
        elif word.name in self.words and not word.many:
            both = f"`{word.name}={self.words[word.name][0]}`, `{argument}`"
            self._error(msg(f"`{arg(word.name)}=` is given twice"), msg(f"keep one of {arg(both)}"))
        else:
            self._check_choices(word, argument, values)
            self.words.setdefault(word.name, []).extend(values)

    def _check_choices(self, word: Word, argument: str, values: list[str]) -> None:
        for value in values:
            if word.choices and value not in word.choices:
                near = nearest(value, word.choices)
                choices_text = msg(f"choose one of: {arg(join(', ', word.choices))}")
                self._error(
                    msg(f"`{arg(argument)}`: unknown value `{arg(value)}`"),
                    _suggest(near and f"{word.name}={near}", choices_text),
                )

    def _refuse_spaces(self, word: Word, argument: str, value: str) -> None:
        """Record the error of `site=`, and of `site = coastal` and similar, whose parts count as one error."""
        self._misspelt.add(word.name)
        correction = f"{word.name}={value}" if value else word.hint
        self._error(msg(f"`{arg(argument)}` has no value"), msg(f"write it without spaces: `{arg(correction)}`"))

    def _unknown_word(self, argument: str, name: str, value: str) -> None:
        near = nearest(name, [word.name for word in self.command.words])
        if near is not None:
            self._misspelt.add(near)
        flag = self.command.flag(name)
        suggestion = f"--{name} {value}".rstrip() if flag is not None and flag.takes else near and f"{near}={value}"
        message = msg(f"`{arg(argument)}`: unknown argument of `provision {arg(self.command.form)}`")
        self._error(message, _suggest(suggestion, self._help_hint()))

    def _read_flag(self, argument: str, rest: list[str]) -> None:
        name, separator, value = argument.lstrip("-").partition("=")
        flag = self._find_flag(argument, name)
        if flag is None:
            self._unknown_flag(argument, name, value or (_bare(rest) if self.command.word(name) else ""))
        elif not flag.takes:
            if separator:
                self._error(
                    msg(f"`{arg(argument)}`: `--{arg(flag.name)}` takes no value"), msg(f"type `--{arg(flag.name)}`")
                )
            self.flags[flag.name] = None
        else:
            self._take_flag(flag, value if separator else _bare(rest))

    def _take_flag(self, flag: Flag, value: str) -> None:
        if flag.name in self.flags:
            both = f"`--{flag.name} {self.flags[flag.name]}`, `--{flag.name} {value}`"
            self._error(msg(f"`--{arg(flag.name)}` is given twice"), msg(f"keep one of {arg(both)}"))
        elif not value:
            self._error(msg(f"`--{arg(flag.name)}` has no value"), msg(f"type `--{arg(flag.name)} {arg(flag.takes)}`"))
        self.flags[flag.name] = value

    def _find_flag(self, argument: str, name: str) -> Flag | None:
        if argument.startswith("--"):
            return self.command.flag(name)
        return next((flag for flag in self.command.flags if flag.short and flag.short == name), None)

    def _unknown_flag(self, argument: str, name: str, value: str) -> None:
        near = nearest(name, [flag.name for flag in self.command.flags])
        hint = near and f"--{near}"
        if name in {"plan", "save", "summary"} and self.command.name == "run" and self.command.flag(name) is None:
            hint = " ".join(["provision plan", *(each for each in self._typed if each != "--plan")])
        word = self.command.word(name)
        if word is not None:
            self._misspelt.add(name)
            hint = f"{name}={value}" if value else word.hint
        message = msg(f"`{arg(argument)}`: unknown option of `provision {arg(self.command.form)}`")
        self._error(message, _suggest(hint, self._help_hint()))

    def _refuse_bare(self, argument: str, rest: list[str]) -> None:
        word = self.command.word(argument)
        if word is not None:
            self._refuse_spaces(word, argument, _bare(rest).removeprefix("=") or _bare(rest))
            return
        alone = next(
            (word for word in self.command.words if word.bare and (word.many or word.name not in self.words)), None
        )
        if alone is not None:
            self._take_word(alone, argument, [argument], rest)
            return
        near = nearest(argument, [flag.name for flag in self.command.flags])
        hint = _suggest(self._suggest_word(argument, near) or (near and f"--{near}"), self._help_hint())
        self._error(msg(f"`{arg(argument)}`: unexpected argument of `provision {arg(self.command.form)}`"), hint)

    def _suggest_word(self, argument: str, flag: str | None) -> str | None:
        """Suggest the argument for a name in the inventory, or similar to a site's: `site=coastal` for `coastal`."""
        folder = inventory_names.folder_of(self._typed)
        kind = inventory_names.kind_of(folder, argument)
        if (
            kind is None
            and flag is None
            and (near := nearest(argument, inventory_names.names(folder, inventory_names.Values.SITE))) is not None
        ):
            kind, argument = inventory_names.Values.SITE, near
        word = next(
            (word for word in self.command.words if word.value_kind is not None and word.value_kind is kind), None
        )
        if word is None:
            return None
        self._misspelt.add(word.name)
        return f"{word.name}={argument}"

    def _require_words(self) -> None:
        for word in self.command.words:
            if word.is_required and word.name not in self.words and word.name not in self._misspelt:
                self._error(
                    msg(f"`{arg(word.name)}=` is missing: {arg(word.help)}"),
                    msg(f"add it, for example `{arg(word.hint)}`"),
                )

    def _help_hint(self) -> str:
        return msg(f"`provision {arg(self.command.name)} --help` lists its arguments and options")


def _bare(rest: list[str]) -> str:
    """Remove and return the next argument if it is neither a flag nor `name=value`; empty otherwise."""
    return rest.pop() if rest and not rest[-1].startswith("--") and "=" not in rest[-1].strip("=") else ""


def _suggest(near: str | None, otherwise: str) -> str:
    return msg(f"did you mean `{arg(near)}`?") if near else otherwise
