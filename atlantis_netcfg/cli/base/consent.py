"""Prompts of the command line, and the answers that they accept: the same everywhere.

Two kinds of prompts expect yes or no:

- `yes_or_no`: the answer alone has no effect; `y` and `n` are enough.
- `whole_word`: devices change, money is spent, things move or somebody signs; only the whole word agrees.

Case is ignored. English words are always accepted, and with Portuguese as language, Portuguese ones too. An empty or
wrong answer agrees to nothing: the prompt is repeated, and the third wrong answer counts as no. The end of the input
counts as no. Ctrl-C stops the command.
"""

from __future__ import annotations

import sys
import unicodedata
from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base.output import signal_of
from atlantis_netcfg.core import language, printable
from atlantis_netcfg.core.errors import DeviceError, UsageError
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join
from atlantis_netcfg.operations.common.costs import unpaid

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

YES, NO, PAY, REMOVE = "yes", "no", "pay", "remove"
_PORTUGUESE = {
    YES: "sim",
    NO: "não",
    "but": "mas",
    "unclear": "incerto",
    "skip": "saltar",
    "later": "depois",
    "back": "voltar",
    "again": "repetir",
    "override": "assumir",
    "on": "continuar",
    "open": "aberto",
    "seen": "visto",
}
"""Words of a person's answers, in English -> in Portuguese."""
_SHORT = {YES: ("y",), NO: ("n",), "sim": ("s",), "não": ("n", "nao")}
_TRIES = 3
_ROOM = 62
"""Columns for a question with its answer words; `(item 7 of 37)` precedes it, and the answer follows."""


class ConsentRefusal(DeviceError):
    """The user declined: no device was changed."""


def shown_word(word: str) -> str:
    """Return an answer word in the language of the prompt."""
    return _PORTUGUESE.get(word, word) if language.current() is language.Language.PORTUGUESE else word


def taken_words(word: str) -> tuple[str, ...]:
    """Return the words accepted as this answer."""
    return tuple(dict.fromkeys((word, shown_word(word))))


def plain(answer: str) -> str:
    """Normalise an answer: whitespace around it and case are ignored."""
    return unicodedata.normalize("NFC", answer).strip().lower()


def read_line(question: str) -> str | None:
    """Read a line from the user; None at the end of input. Raises ConsentRefusal at Ctrl-C: nothing was sent."""
    try:
        return input(printable.lines(question))
    except EOFError:
        return None
    except KeyboardInterrupt as stop:
        raise ConsentRefusal(f"interrupted by {arg(signal_of(stop))} at the prompt; nothing was changed") from stop


def yes_or_no(question: str, read: Callable[[str], str | None] = read_line, say: Callable[[str], None] = print) -> bool:
    """Ask about something without effect on devices or cost: `y` or `n` is enough."""
    words = f"[{shown_word(YES)}, {shown_word(NO)}]"
    return _decide(f"{translate(question)} {words} ", _with_short_forms(YES), translate("  type yes or no"), read, say)


def whole_word(
    question: str,
    read: Callable[[str], str | None] = read_line,
    say: Callable[[str], None] = print,
    *,
    word: str = YES,
) -> bool:
    """Ask about something with consequences: only the whole word agrees, as the prompt says."""
    display_word = shown_word(word)
    how = translate(f"Type {arg(display_word)} (the whole word) to continue, or {arg(shown_word(NO))}:")
    again = translate(f"  type the whole word {arg(display_word)}, or {arg(shown_word(NO))}")
    shown_question = translate(question)
    gap = " " if len(f"{shown_question} {how}") <= _ROOM else "\n  "
    return _decide(f"{shown_question}{gap}{how} ", taken_words(word), again, read, say)


def _with_short_forms(word: str) -> tuple[str, ...]:
    return tuple(item for alternative in taken_words(word) for item in (alternative, *_SHORT.get(alternative, ())))


def _decide(
    question: str,
    agreeing: Sequence[str],
    again: str,
    read: Callable[[str], str | None],
    say: Callable[[str], None],
) -> bool:
    for _ in range(_TRIES):
        answer = read(question)
        if answer is None or plain(answer) in _with_short_forms(NO):
            return False
        if plain(answer) in agreeing:
            return True
        say(again)
    return False


def require_agreement(question: str) -> None:
    """Ask for consent. Raises ConsentRefusal, or UsageError if there is no terminal."""
    if not sys.stdin.isatty():
        raise UsageError(
            "no terminal to confirm these changes; nothing was changed",
            hint="review the changes, then run the same command with `--yes`",
        )
    if not whole_word(question):
        raise ConsentRefusal("not confirmed; nothing was changed")


def pay(words: Sequence[str], *, is_accepted: bool, as_json: bool) -> None:
    """Show the data volume over metered links, and ask unless `is_accepted`. Raises CostRefusal."""
    if words and not is_accepted:
        confirm_cost(words, ask=not as_json)
    elif words and not as_json:
        _show_costs(words)


def _show_costs(words: Sequence[str]) -> None:
    for each in words:
        print(translate(f"Traffic: {arg(each)}"), flush=True)


def confirm_cost(words: Sequence[str], *, ask: bool) -> None:
    """Ask for consent to the cost. Raises CostRefusal, also without prompting if `ask` is false."""
    if not ask or not sys.stdin.isatty():
        raise unpaid(words)
    _show_costs(words)
    if not whole_word("Accept the cost?", word=PAY):
        raise unpaid(words)


def confirm_removal(words: Sequence[str], *, ask: bool) -> None:
    """Ask for consent to remove rows. Raises ConsentRefusal, or UsageError without a terminal."""
    if not ask or not sys.stdin.isatty():
        raise UsageError(
            f"no terminal to confirm this; nothing was changed: {arg(join('; ', words))}",
            hint="review them with `--plan`, then run the same command with `--yes --remove-foreign`",
        )
    for each in words:
        print(translate(each))
    if not whole_word("Remove them?", word=REMOVE):
        raise ConsentRefusal("not confirmed; nothing was changed")
