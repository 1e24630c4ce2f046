"""Translation of messages into one language: exact look-up of the text around their values, line by line."""

from __future__ import annotations

import re
from functools import cached_property
from string import Formatter
from typing import TYPE_CHECKING

from atlantis_netcfg.core import messages

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

_PREFIX = re.compile(r"^ *(?:-> |\d+\. )?")
"""Indentation, and the prefix of a hint or of a list entry."""
_PLACEHOLDER = re.compile(r"\{\{|\}\}|\{(\w+)\}")
_WORDS = re.compile(r"[a-z]{2} ?[a-z]")
_COMMAND = re.compile(r"(?:^|: *)provision [a-z]")
_PARSE = Formatter().parse
_NUMBER_SIGNS = str.maketrans(".,", ",\N{NO-BREAK SPACE}")


def key(msgid: str) -> tuple[str, tuple[str, ...]]:
    """Return the text of a msgid with `{}` for each value, and the names of its values."""
    names: list[str] = []

    def replace_name(match: re.Match[str]) -> str:
        if match[1] is None:
            return match[0]
        names.append(match[1])
        return "{}"

    return _PLACEHOLDER.sub(replace_name, msgid), tuple(names)


def _escape(text: str) -> str:
    return text.replace("{", "{{").replace("}", "}}")


class Translator:
    """The messages of one language.

    `contractions`: replacements for two words where a value begins with the second one, as `de o` becomes `do`.
    `recognise`: translation of finished texts that come from code without marks; default: exact look-up of lines.
    """

    def __init__(
        self,
        catalogue: Mapping[str, str],
        contractions: Mapping[str, str],
        recognise: Callable[[str], str] | None = None,
    ) -> None:
        self._catalogue = catalogue
        self._contractions = contractions
        self._pairs = re.compile(rf"(?<![\w`])(?:{'|'.join(map(re.escape, contractions)) or '(?!)'})(?= \w)")
        self._recognise = recognise

    @cached_property
    def _templates(self) -> dict[str, tuple[tuple[str, ...], str]]:
        """By key: the names of the values, and the translation."""
        pairs = ((key(msgid), text) for msgid, text in self._catalogue.items() if "{" in msgid or "}" in msgid)
        return {text_key: (names, text) for (text_key, names), text in pairs}

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
                lines[-1][1].append((mark, part))
                lines[-1] = (f"{lines[-1][0]}{{}}", lines[-1][1])
        result = "\n".join(self._line(line, values) for line, values in lines)
        for old, new in replacements:
            in_english = old in result
            result = result.replace(*((old, new) if in_english else (self.translate(old), self.translate(new))))
        return result

    def _line(self, line: str, values: Sequence[tuple[str, str]]) -> str:
        """Translate a line; the blanks and the prefix around it are kept."""
        start = match.end() if (match := _PREFIX.match(line)) else 0
        text = line[start:].rstrip()
        has_braces = "{" in text or "}" in text
        if has_braces and (values or text in self._templates):
            names, template = self._templates.get(text, ((), text))
            text_in_language = self._fill(template, dict(zip(names, values, strict=False)), iter(values))
        else:
            plain = text.replace("{{", "{").replace("}}", "}") if has_braces else text
            text_in_language = "" if has_braces else self._catalogue.get(plain, "")
            if not text_in_language:
                text_in_language = self._recognise(plain) if self._recognise and _WORDS.search(plain) else plain
        return line[:start] + text_in_language + line[start + len(text) :]

    def _fill(self, template: str, by_name: Mapping[str, tuple[str, str]], rest: Iterator[tuple[str, str]]) -> str:
        result, contracts = "", False
        for literal, name, _, _ in _PARSE(template):
            result += literal
            if name is not None:
                mark, part = by_name[name] if name else next(rest)
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
