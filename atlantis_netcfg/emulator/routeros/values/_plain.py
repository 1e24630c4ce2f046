"""Values that mean the same on every router: yes or no, numbers, words, times.

What every kind of value does, and how a stored value points at a row instead of at its name.

RouterOS keeps references by id: a rename shows everywhere, and a reference to a removed row is shown as that row's
`*ID`. So does the twin: a stored value holds a token in place of the name.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Iterator


INVALID = "invalid value for argument {}"
NOT_OFFERED = "input does not match any value of {}"
_TOKEN = re.compile("\x01([a-z0-9/-]+):([0-9A-F]+)\x02")


class BadValue(ValueError):
    """The value is not of this kind; `words` is the device's text, `{}` stands for the argument's name."""

    def __init__(self, words: str = INVALID) -> None:
        super().__init__(words)
        self.words = words


class NamesValue(Protocol):
    """Who is called what: spaces are groups of menus whose rows share their names (`interface`, `pool`, ...)."""

    def id_of(self, space: str, name: str) -> int | None:
        """Return the id of the row of that name, None if there is none."""

    def name_of(self, space: str, number: int) -> str | None:
        """Return the name of the row, None if it has gone."""


@dataclass(frozen=True, slots=True)
class ValueType:
    """A value syntax; the base takes anything."""

    def parse(self, text: str, names: NamesValue) -> str:  # noqa: ARG002 - only references look names up
        """Return `text` as it is stored. Raises BadValue."""
        return text

    def normalise(self, text: str) -> str:
        """Return what the console makes of a value before the command sees it. Raises BadValue: a syntax error."""
        return text

    def code(self, text: str) -> str:
        """Return a typed value as `:parse` prints it within the code of a command (7.23.3)."""
        return text

    def export(self, value: str) -> str:
        """Return the value as an export prints it."""
        return value

    def show(self, value: str) -> str:
        """Return the value as the API prints it; names are put in by `spell` before."""
        return value


def id_text(number: int) -> str:
    """Write an id as the device does: `*1F`."""
    return f"*{number:X}"


def reference(space: str, number: int) -> str:
    """Make the stored form of a reference."""
    return f"\x01{space}:{number:X}\x02"


def references(value: str) -> Iterator[tuple[str, int]]:
    """Yield the rows that a stored value points at."""
    for space, number in _TOKEN.findall(value):
        yield space, int(number, 16)


def spell(value: str, names: NamesValue) -> str:
    """Put the names in; a row that has gone is shown by its id."""
    if "\x01" not in value:
        return value

    def name(match: re.Match[str]) -> str:
        number = int(match[2], 16)
        row_name = names.name_of(match[1], number)
        return id_text(number) if row_name is None else row_name

    return _TOKEN.sub(name, value)


_UNITS = (("w", 604800), ("d", 86400), ("h", 3600), ("m", 60), ("s", 1))
_UNIT_SECONDS = {**dict(_UNITS), "ms": 0.001}
_SPAN = re.compile(r"(\d+)(ms|[wdhms])")
_CLOCK = re.compile(r"(?:(\d+)w)?(?:(\d+)d ?)?(\d{1,2}):(\d{2})(?::(\d{2})(?:\.(\d{1,3}))?)?")
_DAYTIME = re.compile(r"([01]?\d|2[0-3]):([0-5]?\d)(?::([0-5]?\d))?")
_FRACTION = re.compile(r"\d+\.\d{1,3}")
_RATE_UNITS = {"": 1, "k": 1000, "M": 1000_000, "G": 1000_000_000}
_YES = ("yes", "true")
_NO = ("no", "false")


@dataclass(frozen=True, slots=True)
class Text(ValueType):
    """Any text, at most `longest` bytes; `empty=False`: at least one character."""

    longest: int | None = None
    empty: bool = True

    def parse(self, text: str, names: NamesValue) -> str:  # noqa: ARG002
        """Take the text as it is."""
        too_long = self.longest is not None and len(text.encode(errors="surrogateescape")) > self.longest
        if too_long or (not text and not self.empty):
            raise BadValue
        return text


@dataclass(frozen=True, slots=True)
class Bool(ValueType):
    """A boolean: the console and exports say `yes`, the API says `true`."""

    def parse(self, text: str, names: NamesValue) -> str:  # noqa: ARG002
        """Take both spellings."""
        if text not in _YES + _NO:
            raise BadValue("value of {} must be either yes or no")
        return "yes" if text in _YES else "no"

    def normalise(self, text: str) -> str:
        """Take only the console's own words, bare or quoted (7.23.3)."""
        if text not in (_YES[0], _NO[0]):
            raise BadValue
        return text

    def show(self, value: str) -> str:
        """Spell it as the API does."""
        return "true" if value == "yes" else "false"


@dataclass(frozen=True, slots=True)
class FlagValue(ValueType):
    """An argument that is there or not, without value (`fib`, `blackhole`); `api_text` is what the API prints."""

    api_text: str = ""

    def parse(self, text: str, names: NamesValue) -> str:  # noqa: ARG002
        """Take the bare name, and what clients write in its place."""
        if text not in ("", *_YES):
            raise BadValue
        return ""

    def show(self, value: str) -> str:  # noqa: ARG002 - it is there
        """Say that it is there."""
        return self.api_text


@dataclass(frozen=True, slots=True)
class Int(ValueType):
    """A whole number, or one of `words`; `hexadecimal` numbers are printed as `0x8000`."""

    least: int = 0
    most: int = 4294967295
    words: tuple[str, ...] = ()
    hexadecimal: bool = False

    def parse(self, text: str, names: NamesValue) -> str:  # noqa: ARG002
        """Normalise the number."""
        if text in self.words:
            return text
        match = re.fullmatch(r"(0x)?([0-9A-Fa-f]+)", text)
        if match is None or not (match[1] or match[2].isdecimal()):
            raise BadValue
        number = int(match[2], 16 if match[1] else 10)
        if not self.least <= number <= self.most:
            raise BadValue("value of {} out of range " + f"({self.least}..{self.most})")
        return f"0x{number:X}" if self.hexadecimal else str(number)


@dataclass(frozen=True, slots=True)
class Size(ValueType):
    """A size in KiB: exports say `2048KiB`, the API says `2048`."""

    def parse(self, text: str, names: NamesValue) -> str:  # noqa: ARG002
        """Take it with and without its unit."""
        match = re.fullmatch(r"(\d+)(?:KiB)?", text)
        if match is None:
            raise BadValue
        return f"{int(match[1])}KiB"

    def show(self, value: str) -> str:
        """Leave the unit out, as the API does."""
        return value.removesuffix("KiB")


@dataclass(frozen=True, slots=True)
class Rate(ValueType):
    """Bits per second: `280k` and `280000` are the same, and exports say the shorter; the API says the number."""

    def parse(self, text: str, names: NamesValue) -> str:  # noqa: ARG002
        """Normalise it to the largest unit that leaves a whole number."""
        match = re.fullmatch(r"(\d+)([kMG]?)", text)
        if match is None:
            raise BadValue
        value = int(match[1]) * _RATE_UNITS[match[2]]
        unit = next(unit for unit in ("G", "M", "k", "") if value % _RATE_UNITS[unit] == 0)
        return f"{value // _RATE_UNITS[unit]}{unit}" if value else "0"

    def show(self, value: str) -> str:
        """Spell it as the API does."""
        return str(int(value[:-1]) * _RATE_UNITS[value[-1]]) if value[-1:].isalpha() else value


@dataclass(frozen=True, slots=True)
class Choice(ValueType):
    """One of a fixed set of words."""

    words: tuple[str, ...]

    def parse(self, text: str, names: NamesValue) -> str:  # noqa: ARG002
        """Take no other word."""
        if text not in self.words:
            raise BadValue(NOT_OFFERED)
        return text


@dataclass(frozen=True, slots=True)
class Choices(ValueType):
    """Several of a fixed set of words; `is_ordered`: printed in the set's order, as RouterOS prints bits."""

    words: tuple[str, ...]
    is_ordered: bool = True
    has_signs: bool = False
    """Each word may have its own `!` (tcp-flags)."""

    def parse(self, text: str, names: NamesValue) -> str:  # noqa: ARG002
        """Take a comma-separated list; empty is the empty set."""
        words = text.split(",") if text else []
        plain = [word.removeprefix("!") if self.has_signs else word for word in words]
        if any(word not in self.words for word in plain) or len(set(plain)) != len(plain):
            raise BadValue(NOT_OFFERED)
        if self.is_ordered:
            words.sort(key=lambda word: self.words.index(word.removeprefix("!")))
        return ",".join(words)


@dataclass(frozen=True, slots=True)
class Not(ValueType):
    """A value with an optional `!` before it."""

    kind: ValueType

    def parse(self, text: str, names: NamesValue) -> str:
        """Keep the sign, normalise the rest."""
        sign = "!" if text.startswith("!") else ""
        body = self.kind.parse(text.removeprefix("!"), names)
        if sign and not body:
            raise BadValue
        return sign + body

    def normalise(self, text: str) -> str:
        """Keep the sign."""
        sign = "!" if text.startswith("!") else ""
        return sign + self.kind.normalise(text.removeprefix("!"))

    def code(self, text: str) -> str:
        """Keep the sign."""
        sign = "!" if text.startswith("!") else ""
        return sign + self.kind.code(text.removeprefix("!"))


@dataclass(frozen=True, slots=True)
class Pattern(ValueType):
    """A value with a small syntax of its own, given as a regular expression."""

    expression: str

    def parse(self, text: str, names: NamesValue) -> str:  # noqa: ARG002
        """Take what fits."""
        if re.fullmatch(self.expression, text) is None:
            raise BadValue
        return text


@dataclass(frozen=True, slots=True)
class Time(ValueType):
    """A time interval, printed as `1d2h3m4s`; or one of `words`. Bounds are seconds."""

    least: float = 0
    most: float = 4294967295
    words: tuple[str, ...] = ()

    def parse(self, text: str, names: NamesValue) -> str:  # noqa: ARG002
        """Normalise `90`, `1m30s` and `00:01:30` to `1m30s`."""
        if text in self.words:
            return text
        value = seconds(text)
        if value is None:
            raise BadValue
        if not self.least <= value <= self.most:
            raise BadValue("value of {} out of range " + f"({interval(self.least)}..{interval(self.most)})")
        return interval(value)

    def normalise(self, text: str) -> str:
        """Read `2.2` as seconds (7.23.3)."""
        return interval(float(text)) if _FRACTION.fullmatch(text) else text

    def code(self, text: str) -> str:
        """Spell it as a clock: `00:00:02.200`, `1w1d00:00:00`."""
        value = seconds(text)
        return text if value is None else _clock(round(value * 1000))


@dataclass(frozen=True, slots=True)
class Moment(ValueType):
    """A date (`2026-01-31`, before 7.10 `jan/31/2026`) or a time of day (`12:30:00`, `9:00`), or one of `words`."""

    words: tuple[str, ...] = ()

    def parse(self, text: str, names: NamesValue) -> str:  # noqa: ARG002
        """Take the forms of any version; whoever uses the value knows which it is."""
        if text in self.words or re.fullmatch(r"\d{4}-\d{2}-\d{2}|[a-z]{3}/\d{2}/\d{4}", text):
            return text
        if clock := _DAYTIME.fullmatch(text):
            return ":".join(part.zfill(2) for part in clock.groups(default="0"))
        raise BadValue


def seconds(text: str) -> float | None:
    """Read a time interval; None if it is none."""
    if re.fullmatch(r"\d+", text):
        return float(text)
    if clock := _CLOCK.fullmatch(text):
        weeks, days, hours, minutes, rest, fraction = clock.groups(default="0")
        whole = int(weeks) * 604800 + int(days) * 86400 + int(hours) * 3600 + int(minutes) * 60 + int(rest)
        return whole + int(fraction.ljust(3, "0")) / 1000
    parts = _SPAN.findall(text)
    if not parts or "".join(number + unit for number, unit in parts) != text:
        return None
    return float(sum(int(number) * _UNIT_SECONDS[unit] for number, unit in parts))


def _clock(milliseconds: int) -> str:
    whole, rest = divmod(milliseconds, 1000)
    weeks, whole = divmod(whole, 604800)
    days, whole = divmod(whole, 86400)
    front = (f"{weeks}w" if weeks else "") + (f"{days}d" if days else "")
    return f"{front}{whole // 3600:02}:{whole // 60 % 60:02}:{whole % 60:02}" + (f".{rest:03}" if rest else "")


def interval(value: float) -> str:
    """Write seconds as RouterOS prints an interval: `1w`, `10m`, `1s500ms`, `0s`."""
    milliseconds = round(value * 1000)
    whole, rest = divmod(milliseconds, 1000)
    text = ""
    for unit, size in _UNITS:
        count, whole = divmod(whole, size)
        text += f"{count}{unit}" if count else ""
    return text + (f"{rest}ms" if rest else "") or "0s"
