"""Translation of messages into one language: exact look-up of the text around their values, line by line."""

from __future__ import annotations

import re
from string import Formatter
from typing import TYPE_CHECKING

from atlantis_netcfg.core import messages

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

_PREFIX = re.compile(r"^ *(?:-> |\d+\. )?")
"""Indentation, and the prefix of a hint or of a list entry."""
_PLACEHOLDER = re.compile(r"\{\{|\}\}|\{(\w+)\}")
_COMMAND = re.compile(r"(?:^|: *)provision [a-z]")
_PARSE = Formatter().parse
_NUMBER_SIGNS = str.maketrans(".,", ",\N{NO-BREAK SPACE}")


def number_values(msgid: str, translation: str) -> tuple[str, str]:
    """Return both texts with `{0}`, `{1}`, … for the names of the values, in the order of the msgid."""
    names = [match[1] for match in _PLACEHOLDER.finditer(msgid) if match[1]]
    places, place_by_name = iter(range(len(names))), {name: place for place, name in enumerate(names)}

    def number(text: str, place_of: Callable[[str], object]) -> str:
        return _PLACEHOLDER.sub(lambda match: f"{{{place_of(match[1])}}}" if match[1] else match[0], text)

    return number(msgid, lambda _: next(places)), number(translation, lambda name: place_by_name.get(name, name))


def _escape(text: str) -> str:
    return text.replace("{", "{{").replace("}", "}}")


class Translator:
    """The messages of one language.

    `catalogue`: translations by text, with `{0}`, `{1}`, … for the values (`number_values`).
    `contractions`: replacements for two words where a value begins with the second one, as `de o` becomes `do`.
    """

    def __init__(self, catalogue: Mapping[str, str], contractions: Mapping[str, str]) -> None:
        self._catalogue = catalogue
        self._contractions = contractions
        self._pairs = re.compile(rf"(?<![\w`])(?:{'|'.join(map(re.escape, contractions)) or '(?!)'})(?= \w)")

    def translate(self, text: str) -> str:
        """Return the text in this language; what is missing in the catalogue stays in English."""
        source = text.source if isinstance(text, messages.Message) else text
        lines: list[tuple[str, list[tuple[str, str]]]] = [("", [])]
        replacements = []
        for mark, part in messages.parse(source):
            if mark == messages.OLD:
                replacements.append(part.partition(messages.NEW)[::2])
            elif not mark:
                first, *rest = part.split("\n")
                lines[-1] = (lines[-1][0] + _escape(first), lines[-1][1])
                lines += [(_escape(line), []) for line in rest]
            else:
                line, values = lines[-1]
                lines[-1] = (f"{line}{{{len(values)}}}", [*values, (mark, part)])
        result = "\n".join(self._line(line, values) for line, values in lines)
        for old, new in replacements:
            in_english = old in result
            result = result.replace(*((old, new) if in_english else (self.translate(old), self.translate(new))))
        return result

    def _line(self, line: str, values: Sequence[tuple[str, str]]) -> str:
        """Translate a line; the blanks and the prefix around it are kept."""
        start = match.end() if (match := _PREFIX.match(line)) else 0
        text = line[start:].rstrip()
        translation = self._catalogue.get(text, "")
        if values or (translation and ("{" in text or "}" in text)):
            text_in_language = self._fill(translation or text, values)
        else:
            text_in_language = translation or text.replace("{{", "{").replace("}}", "}")
        return line[:start] + text_in_language + line[start + len(text) :]

    def _fill(self, template: str, values: Sequence[tuple[str, str]]) -> str:
        result, contracts = "", False
        for literal, name, _, _ in _PARSE(template):
            result += literal
            if name is not None:
                mark, part = values[int(name)]
                english = str.__str__(messages.Message(part))
                is_typed = result.count("`") % 2 == 1 or _COMMAND.search(result)
                value = english if is_typed else self._value(mark, part, english)
                contracts = contracts or value != english
                result += value
        return self._pairs.sub(lambda pair: self._contractions[pair[0]], result) if contracts else result

    def _value(self, mark: str, part: str, english: str) -> str:
        """Translate a value that is a message, or a text of two words and more; its padding is kept where possible."""
        if mark == messages.NUMBER:
            return english.translate(_NUMBER_SIGNS)
        if mark == messages.TEXT and " " not in english.strip():
            return english
        text = self.translate(messages.Message(part if mark == messages.MESSAGE else english))
        return text.rstrip().ljust(len(english)) if english.endswith("  ") else text
