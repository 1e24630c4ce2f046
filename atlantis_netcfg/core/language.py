"""Language of messages: English or European Portuguese.

Messages are made, stored and sent in English: JSON, journals, signed checklists and logs have nothing else, and neither
exit codes nor program input depend on this module. They are translated when shown to a person, by `translate`, which
looks up the text around the values of messages (`core.messages`). No native speaker has read the Portuguese texts yet;
docs/pt/glossario.md has their terms.
"""

from __future__ import annotations

import os
import re
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg.core import messages
from atlantis_netcfg.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.core.translation import Translator


class Language(StrEnum):
    """Languages with a catalogue; the value is that of `--lang` and the first letters of `LANG`."""

    ENGLISH = "en"
    PORTUGUESE = "pt"


CATALOGUES = Path(__file__).parents[1] / "locale"
"""Folder of the catalogues in gettext's layout; written by `tools/messages.py`."""
_FOLDERS = {Language.PORTUGUESE: "pt_PT"}

_CONTRACTIONS = {
    Language.PORTUGUESE: {
        "de o": "do",
        "de a": "da",
        "de os": "dos",
        "de as": "das",
        "em o": "no",
        "em a": "na",
        "em os": "nos",
        "em as": "nas",
        "por o": "pelo",
        "por a": "pela",
        "por os": "pelos",
        "por as": "pelas",
        "a o": "ao",
        "a os": "aos",
    }
}
"""Contractions of a preposition and an article, where the article is the first word of a value."""

_current_language = Language.ENGLISH
_PROGRAM = os.environ.get("ATLANTIS_PROGRAM", "provision")
"""How this program was called; the launcher of a checkout sets it."""
_COMMAND = re.compile(r"(`|: +|^ *)provision (?=[a-zA-Z-])(?!itself|has|is|the )", re.MULTILINE)


def use(language: Language) -> None:
    """Set the language of this process."""
    global _current_language  # noqa: PLW0603 - a process speaks one language, as gettext's own does
    _current_language = language


def current() -> Language:
    """Return the current language."""
    return _current_language


def of_environment(environment: Mapping[str, str] = os.environ) -> Language:
    """Return the language of the first POSIX variable set: LC_ALL, LC_MESSAGES, LANG; else English."""
    for name in ("LC_ALL", "LC_MESSAGES", "LANG"):
        if value := environment.get(name, ""):
            return Language.PORTUGUESE if value.lower().startswith("pt") else Language.ENGLISH
    return Language.ENGLISH


def parse_language(name: str) -> Language:
    """Parse `--lang`, such as `pt` or `pt_PT`. Raises UsageError."""
    for language in Language:
        if name.lower().replace("-", "_").partition("_")[0] == language:
            return language
    raise UsageError(f"`--lang {name}`: language not available", hint="choose one of: en, pt")


def catalogue_file(language: Language) -> Path:
    """Return the path of a language's catalogue; English has none."""
    return CATALOGUES / _FOLDERS[language] / "LC_MESSAGES" / "provision.po"


@cache
def _translator(language: Language) -> Translator:
    from atlantis_netcfg.core import compiled_catalogue, translation  # noqa: PLC0415 - English needs none

    return translation.Translator(compiled_catalogue.load(catalogue_file(language)), _CONTRACTIONS[language])


def translate(text: str) -> str:
    """Translate a message, or an f-string with values in `arg(…)`; what is missing in the catalogue stays in English.

    Plain text may be several messages without values, one a line. Commands are shown as they are typed here.
    """
    message = messages.msg(text)
    return as_typed(
        message if _current_language is Language.ENGLISH else _translator(_current_language).translate(message)
    )


def as_typed(text: str) -> str:
    """Return a text whose commands begin as the user has called this program: `./provision` in a checkout."""
    text = str.__str__(text)
    return text if _PROGRAM == "provision" else _COMMAND.sub(rf"\1{_PROGRAM} ", text)
