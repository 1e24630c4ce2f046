"""Catalogue of translations for one language, keyed by English messages with or without values.

Messages arrive as finished text: `3 changes left`. The catalogue has them with placeholders, `{changes} changes left`
(gettext's python-brace-format). The literal parts identify the message. The values are extracted, translated if they
are messages themselves, and inserted into the translation. A value of a single word is never translated (it is a name,
a number or a verdict), nor is text between backquotes. Unknown text stays unchanged, and no text is ever lost.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from string import Formatter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

_SURE = 10
"""Literal letters from which a message is recognised whatever its values; with fewer, values must be known too."""
_FEW = 6
"""Below this many literal letters, values must be data or known messages: `{name} of {site}` fits many sentences."""
_JOINTS = ("; ", ". ", ": ", " : ", " (")
"""Separators that our code puts between messages."""
_REFUSAL = "failure: "
"""Prefix of most RouterOS error messages, which are not translated."""
_COMMAND_PREFIX = "advised_command_"
_WORD = re.compile(r"\w+")
_OWN_WORD = re.compile(r"(?<![\w\0])\w+(?![\w\0])")
"""A literal word that is not adjacent to a value; NUL stands for the values."""
_MOST_TRIED = 300
"""Maximum number of look-ups for one line; what remains after that stays in English."""
_LONGEST = 600
"""Maximum length of a text in which separators are searched: a line from a device can be a whole script."""
_PROSE = re.compile(r"(?<![\w./+-])(?!(?:ms|us|min|km|bytes)\b)[a-z]{2,}(?![\w./+-])")
"""A lower-case word that is neither a unit nor part of a name."""
_MARK = re.compile(r"^ *(?:-> |\d+\. )")
"""Prefix of a hint or of a list entry."""
_COLUMNS = re.compile(r"(?<=\S)( {2,})(?=\S)")
_COMMAND = re.compile(r"(?<=`)provision [^`]*(?=`)|(?<=: )\s*provision [a-z][^`]*$")
"""A command suggested in a hint; the site and the inventory folder may already be filled in."""
_PARSE = Formatter().parse


@dataclass(frozen=True)
class Template:
    """A message with placeholders."""

    literals: tuple[str, ...]
    """Literal text before, between and after the values: one part more than there are values."""
    names: tuple[str, ...]
    translation: str

    @classmethod
    def of(cls, msgid: str, translation: str) -> Template:
        """Parse a message into literals and placeholders; a command in it becomes a placeholder."""
        commands = _COMMAND.findall(msgid) if "provision " in msgid else ()
        for place, command in enumerate(dict.fromkeys(commands)):
            msgid = msgid.replace(command, f"{{{_COMMAND_PREFIX}{place}}}")
            translation = translation.replace(command, f"{{{_COMMAND_PREFIX}{place}}}")
        literals, names = [""], []
        for literal, name, _, _ in _PARSE(msgid):
            literals[-1] += literal
            if name is not None:
                names.append(name)
                literals.append("")
        return cls(tuple(literals), tuple(names), translation)

    @cached_property
    def letters(self) -> int:
        """Number of letters in the literal parts."""
        return sum(map(str.isalpha, "".join(self.literals)))

    @cached_property
    def pattern(self) -> re.Pattern[str]:
        """Regular expression that matches the message."""
        return re.compile("(.*?)".join(map(re.escape, self.literals)))

    @cached_property
    def verbatim(self) -> tuple[bool, ...]:
        """For each value, whether it is a command or between backquotes."""
        quote_flags = ("".join(self.literals[: place + 1]).count("`") % 2 == 1 for place in range(len(self.names)))
        return tuple(
            name.startswith(_COMMAND_PREFIX) or inside for name, inside in zip(self.names, quote_flags, strict=True)
        )

    def words(self) -> Iterable[str]:
        """Return literal words that appear as whole words in every text of this message."""
        result: list[str] = _OWN_WORD.findall("\0".join(self.literals))
        return result

    def fill(self, values: Sequence[str]) -> str:
        """Return the translation with the values inserted."""
        value_by_name = dict(zip(self.names, values, strict=True))
        pieces = []
        for literal, name, _, _ in _PARSE(self.translation):
            pieces.append(literal + (value_by_name.get(name, "") if name is not None else ""))
        return "".join(pieces)


class Catalogue:
    """All messages of one language; `translate` returns the text for the user.

    `contractions`: replacements for two words where a value begins with the second one, as `de o` becomes `do`.
    """

    def __init__(self, messages: Mapping[str, str], contractions: Mapping[str, str] | None = None) -> None:
        self._contractions = contractions or {}
        pairs = "|".join(map(re.escape, self._contractions))
        self._pairs = re.compile(rf"(?<![\w`])(?:{pairs})(?= \w)") if pairs else None
        self._whole: dict[str, str] = {}
        templates = []
        for msgid, translation in messages.items():
            if "{" not in msgid and "}" not in msgid:
                self._whole[msgid] = translation
                if "provision " not in msgid or not _COMMAND.search(msgid):
                    continue
            template = Template.of(msgid, translation)
            if template.names:
                templates.append(template)
            else:
                self._whole[template.literals[0]] = template.fill(())
        # Most letters of its own first, then most signs; of as many, in the order of their texts.
        templates.sort(key=lambda item: (-item.letters, -sum(map(len, item.literals)), item.literals))
        self._ranks = {id(template): rank for rank, template in enumerate(templates)}
        self._by_word, self._others = _index(templates)
        self._known: dict[str, str | None] = {}
        self._found: dict[str, str | None] = {}
        self._tried = 0
        """Number of look-ups for the current line, limited because a line with many separators would take too long."""
        self._unsure: set[str] = set()
        """Texts with an unknown value, or with a value that may be two messages joined by a comma."""
        self._lists: dict[str, str | None] = {}

    def translate(self, text: str) -> str:
        """Translate each line; surrounding blanks are kept."""
        return "\n".join(map(self._line, text.split("\n")))

    def _line(self, line: str) -> str:
        text = _MARK.sub("", line).strip()
        if not text:
            return line
        self._tried = 0
        start = line.index(text)
        return line[:start] + (self._text(text) or self._columns(text)) + line[start + len(text) :]

    def _columns(self, text: str) -> str:
        """Translate the cells of a table, keeping their columns aligned where there is room."""
        pieces = _COLUMNS.split(text)
        for place in range(0, len(pieces), 2):
            cell = pieces[place]
            pieces[place] = self._sentence(cell) or cell
            if place + 1 < len(pieces):
                width = len(cell) + len(pieces[place + 1])
                pieces[place + 1] = " " * max(2, width - len(pieces[place]))
        return "".join(pieces)

    def _text(self, text: str) -> str | None:
        """Translate a message, or joined messages; None if no part is known."""
        if text in self._known:
            return self._known[text]
        return self._remember(self._known, text, self._look_up(text))

    def _remember(self, cache: dict[str, str | None], text: str, result: str | None) -> str | None:
        """Cache and return the result, unless the search limit was reached and the result may be incomplete."""
        if self._tried <= _MOST_TRIED:
            cache[text] = result
        return result

    def _look_up(self, text: str) -> str | None:
        message = self._message(text)
        if message is not None and text not in self._unsure:
            return message
        if len(text) > _LONGEST:
            return message
        return self._list(text) or message or self._translate_joint(text)

    def _message(self, text: str) -> str | None:
        if text in self._found:
            return self._found[text]
        self._tried += 1
        if self._tried > _MOST_TRIED:
            return self._whole.get(text)
        return self._remember(self._found, text, self._whole.get(text) or self._fill_template(text))

    def _fill_template(self, text: str) -> str | None:
        for template in self._candidates(text):
            if len(text) > _LONGEST and len("".join(template.literals)) * 4 < len(text):
                continue
            match = template.pattern.fullmatch(text)
            values = None if match is None else self._values(template, match.groups())
            if match is not None and values is not None:
                if None in values or any(map(self._may_be_a_list, match.groups())):
                    self._unsure.add(text)
                new_values = [
                    value if translation is None else translation
                    for value, translation in zip(match.groups(), values, strict=True)
                ]
                result = template.fill(new_values)
                return result if new_values == list(match.groups()) else self._contract(result)
        return None

    def _may_be_a_list(self, value: str) -> bool:
        return ", " in value and not _is_data(value) and value.strip() not in self._whole

    def _contract(self, text: str) -> str:
        return self._pairs.sub(lambda pair: self._contractions[pair[0]], text) if self._pairs else text

    def _candidates(self, text: str) -> list[Template]:
        candidates = list(self._others)
        for word in set(_WORD.findall(text)):
            candidates.extend(self._by_word.get(word, ()))
        return sorted(candidates, key=lambda template: self._ranks[id(template)])

    def _values(self, template: Template, values: Sequence[str]) -> list[str | None] | None:
        """Translate the values; None for unknown ones.

        Returns None instead of a list if the template has few literal letters: then an unknown value means another
        message.
        """
        read: list[str | None] = []
        for value, verbatim in zip(values, template.verbatim, strict=True):
            if verbatim or (" " not in value.strip() and template.letters >= _FEW):
                read.append(value)
                continue
            translation = self._value(value)
            if translation is None and (template.letters < _SURE or not _is_whole(value)):
                return None
            read.append(translation)
        return read

    def _value(self, value: str) -> str | None:
        text = value.strip()
        if _is_data(text) or text.startswith(_REFUSAL):
            return value
        translation = self._text(text) if " " in text else None
        return None if translation is None else value.replace(text, translation, 1)

    def _list(self, text: str) -> str | None:
        """Translate messages joined by `, `; all must be known, except data such as `12.4 kB`."""
        if ", " not in text:
            return None
        if text in self._lists:
            return self._lists[text]
        if self._tried > _MOST_TRIED:
            return None
        return self._remember(self._lists, text, self._translate_list(text))

    def _translate_list(self, text: str) -> str | None:
        if text in self._whole:
            return None
        for match in reversed(list(re.finditer(", ", text))):
            left, right = text[: match.start()], text[match.end() :]
            if self._tried > _MOST_TRIED:
                return None
            if left.count("`") % 2:
                continue
            first, rest = self._unit(left), self._unit(right)
            rest = self._piece(f", {right}") or (None if rest is None else f", {rest}")
            if first is not None and rest is not None and (first, rest) != (left, f", {right}"):
                return f"{first}{rest}"
        return None

    def _translate_joint(self, text: str) -> str | None:
        for joint in _JOINTS:
            for match in re.finditer(re.escape(joint), text):
                if self._tried > _MOST_TRIED:
                    return None
                if text.count("`", 0, match.start()) % 2 == 0:
                    result = self._parts(text[: match.start()], joint, text[match.end() :])
                    if result is not None:
                        return result
        return None

    def _parts(self, left: str, joint: str, right: str) -> str | None:
        if joint == " (":
            return self._in_parentheses(left, right)
        if joint == ". ":
            left, joint = f"{left}.", " "
        first, rest = self._sentence(left), self._sentence(right)
        joint_piece = self._piece(f"{joint}{right}") if joint == "; " else None
        if joint_piece is None and first is None and rest is None:
            return None
        return f"{first or left}{joint_piece or f'{joint}{rest or right}'}"

    def _in_parentheses(self, left: str, right: str) -> str | None:
        if not right.endswith(")"):
            return None
        inner = right[:-1]
        first, rest = self._unit(left), self._unit(inner)
        rest = self._piece(f"({inner})") or (None if rest is None else f"({rest})")
        if first is None or rest is None or (first, rest) == (left, f"({inner})"):
            return None
        return f"{first} {rest}"

    def _unit(self, text: str) -> str | None:
        """Translate a unit that is known as a whole: data, a message, or a list, with an optional parenthesis."""
        if _is_data(text):
            return text
        left, joint, right = text.partition(" (")
        piece = self._piece(text)
        sure = None if text in self._unsure else piece
        return self._list(text) or sure or (self._in_parentheses(left, right) if joint else None)

    def _sentence(self, text: str) -> str | None:
        """Translate a part of a text: one message, or joined messages."""
        return self._list(text) or self._piece(text) or (self._translate_joint(text) if " " in text.strip() else None)

    def _piece(self, text: str) -> str | None:
        """Translate one message of several words."""
        return self._message(text) if " " in text.strip() else None


def _is_whole(text: str) -> bool:
    """Return whether a text may be a value: its parentheses and backquotes are balanced."""
    return text.count("(") == text.count(")") and text.count("`") % 2 == 0


def _is_data(text: str) -> bool:
    """Return whether a text is only numbers, units and upper-case names."""
    return _PROSE.search(text) is None


def _index(templates: Sequence[Template]) -> tuple[dict[str, list[Template]], list[Template]]:
    """Index templates by their rarest word; return those without words separately."""
    words = {id(template): set(template.words()) for template in templates}
    number = Counter(word for word_set in words.values() for word in word_set)
    by_word: dict[str, list[Template]] = {}
    others = []
    for template in templates:
        word_set = words[id(template)]
        if word_set:
            by_word.setdefault(min(word_set, key=lambda word: (number[word], word)), []).append(template)
        else:
            others.append(template)
    return by_word, others
