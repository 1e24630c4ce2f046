"""Value types without references: booleans, numbers, keywords, times; and the base class.

RouterOS stores references by id: a rename is visible everywhere, and a reference to a removed row is shown as that
row's `*ID`. The emulator does the same: a stored value has a token instead of the name.
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
    """The value does not have this type; `words` is the device's text, with `{}` for the argument's name."""

    def __init__(self, words: str = INVALID) -> None:
        super().__init__(words)
        self.words = words


class NamesValue(Protocol):
    """Name lookup; a space is a group of menus whose rows share names (`interface`, `pool`, ...)."""

    def id_of(self, space: str, name: str) -> int | None:
        """Return the id of the row with that name, or None."""

    def name_of(self, space: str, number: int) -> str | None:
        """Return the name of the row, or None if it was removed."""


@dataclass(frozen=True, slots=True)
class ValueType:
    """A value syntax; the base class accepts anything."""

    def parse(self, text: str, names: NamesValue) -> str:  # noqa: ARG002 - only references look names up
        """Return the stored form of `text`. Raises BadValue."""
        return text

    def normalise(self, text: str) -> str:
        """Return the console's conversion of a value before the command. Raises BadValue on a syntax error."""
        return text

    def code(self, text: str) -> str:
        """Return a typed value as `:parse` prints it in a command's code (7.23.3)."""
        return text

    def export(self, value: str) -> str:
        """Return the value in export format."""
        return value

    def show(self, value: str) -> str:
        """Return the value in API format; `spell` has inserted names before."""
        return value


def id_text(number: int) -> str:
    """Format an id as the device does: `*1F`."""
    return f"*{number:X}"


def reference(space: str, number: int) -> str:
    """Return the stored form of a reference."""
    return f"\x01{space}:{number:X}\x02"


def references(value: str) -> Iterator[tuple[str, int]]:
    """Yield the rows that a stored value references."""
    for space, number in _TOKEN.findall(value):
        yield space, int(number, 16)


def spell(value: str, names: NamesValue) -> str:
    """Replace references by names; a removed row is shown by its id."""
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
        """Return the text unchanged. Raises BadValue if it is too long or empty."""
        too_long = self.longest is not None and len(text.encode(errors="surrogateescape")) > self.longest
        if too_long or (not text and not self.empty):
            raise BadValue
        return text


@dataclass(frozen=True, slots=True)
class Bool(ValueType):
    """A boolean: `yes` on the console and in exports, `true` in the API."""

    def parse(self, text: str, names: NamesValue) -> str:  # noqa: ARG002
        """Accept both spellings."""
        if text not in _YES + _NO:
            raise BadValue("value of {} must be either yes or no")
        return "yes" if text in _YES else "no"

    def normalise(self, text: str) -> str:
        """Accept only the console's keywords, bare or quoted (7.23.3)."""
        if text not in (_YES[0], _NO[0]):
            raise BadValue
        return text

    def show(self, value: str) -> str:
        """Format the value as the API does."""
        return "true" if value == "yes" else "false"


@dataclass(frozen=True, slots=True)
class FlagValue(ValueType):
    """A flag that is present or absent, without value (`fib`, `blackhole`); `api_text`: the API's output."""

    api_text: str = ""

    def parse(self, text: str, names: NamesValue) -> str:  # noqa: ARG002
        """Accept the bare name, and the values that clients send instead."""
        if text not in ("", *_YES):
            raise BadValue
        return ""

    def show(self, value: str) -> str:  # noqa: ARG002 - it is there
        """Return the API's text for a present flag."""
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
    """A size in KiB: `2048KiB` in exports, `2048` in the API."""

    def parse(self, text: str, names: NamesValue) -> str:  # noqa: ARG002
        """Accept a size with or without unit."""
        match = re.fullmatch(r"(\d+)(?:KiB)?", text)
        if match is None:
            raise BadValue
        return f"{int(match[1])}KiB"

    def show(self, value: str) -> str:
        """Omit the unit, as the API does."""
        return value.removesuffix("KiB")


@dataclass(frozen=True, slots=True)
class Rate(ValueType):
    """Bits per second: `280k` equals `280000`; exports use the shorter form, the API the number."""

    def parse(self, text: str, names: NamesValue) -> str:  # noqa: ARG002
        """Normalise to the largest unit that leaves a whole number."""
        match = re.fullmatch(r"(\d+)([kMG]?)", text)
        if match is None:
            raise BadValue
        value = int(match[1]) * _RATE_UNITS[match[2]]
        unit = next(unit for unit in ("G", "M", "k", "") if value % _RATE_UNITS[unit] == 0)
        return f"{value // _RATE_UNITS[unit]}{unit}" if value else "0"

    def show(self, value: str) -> str:
        """Format the value as the API does."""
        return str(int(value[:-1]) * _RATE_UNITS[value[-1]]) if value[-1:].isalpha() else value


@dataclass(frozen=True, slots=True)
class Choice(ValueType):
    """One keyword of a fixed set."""

    words: tuple[str, ...]

    def parse(self, text: str, names: NamesValue) -> str:  # noqa: ARG002
        """Accept only the fixed keywords."""
        if text not in self.words:
            raise BadValue(NOT_OFFERED)
        return text


@dataclass(frozen=True, slots=True)
class Choices(ValueType):
    """Several keywords of a fixed set; `is_ordered`: printed in the set's order, as RouterOS prints bits."""

    words: tuple[str, ...]
    is_ordered: bool = True
    has_signs: bool = False
    """Each word may have its own `!`, as in tcp-flags."""

    def parse(self, text: str, names: NamesValue) -> str:  # noqa: ARG002
        """Accept a comma-separated list; an empty text is the empty set."""
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
        """Keep the sign and normalise the value."""
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
        """Accept texts that match the expression."""
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
        """Interpret `2.2` as seconds (7.23.3)."""
        return interval(float(text)) if _FRACTION.fullmatch(text) else text

    def code(self, text: str) -> str:
        """Format as a clock: `00:00:02.200`, `1w1d00:00:00`."""
        value = seconds(text)
        return text if value is None else _format_duration(round(value * 1000))


@dataclass(frozen=True, slots=True)
class Moment(ValueType):
    """A date (`2026-01-31`, before 7.10 `jan/31/2026`) or a time of day (`12:30:00`, `9:00`), or one of `words`."""

    words: tuple[str, ...] = ()

    def parse(self, text: str, names: NamesValue) -> str:  # noqa: ARG002
        """Accept the formats of all versions; the user of the value distinguishes them."""
        if text in self.words or re.fullmatch(r"\d{4}-\d{2}-\d{2}|[a-z]{3}/\d{2}/\d{4}", text):
            return text
        if clock := _DAYTIME.fullmatch(text):
            return ":".join(part.zfill(2) for part in clock.groups(default="0"))
        raise BadValue


def seconds(text: str) -> float | None:
    """Parse a time interval to seconds; None if invalid."""
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


def _format_duration(milliseconds: int) -> str:
    whole, rest = divmod(milliseconds, 1000)
    weeks, whole = divmod(whole, 604800)
    days, whole = divmod(whole, 86400)
    front = (f"{weeks}w" if weeks else "") + (f"{days}d" if days else "")
    return f"{front}{whole // 3600:02}:{whole // 60 % 60:02}:{whole % 60:02}" + (f".{rest:03}" if rest else "")


def interval(value: float) -> str:
    """Format seconds as a RouterOS interval: `1w`, `10m`, `1s500ms`, `0s`."""
    milliseconds = round(value * 1000)
    whole, rest = divmod(milliseconds, 1000)
    text = ""
    for unit, size in _UNITS:
        count, whole = divmod(whole, size)
        text += f"{count}{unit}" if count else ""
    return text + (f"{rest}ms" if rest else "") or "0s"
